"""The settings that labelled files hold: what the labels were computed with."""

from grasp3d.hand.scene import Scene, scene_settings
from grasp3d.mesh import ObjectMesh
from grasp3d.settings import GraspModel, Sampling
from grasp3d.settings.parsing import plain_values
from grasp3d.stability.label import Mode

SETTING = "setting_"
"""Start of the names of settings beside arrays, some of which have the name of a setting."""

GIVEN_ANGLE = "given_angle"
"""Key in the setting `search` of the `search_angle` that was given; None: that of the model."""

Values = dict[str, str | float | int | None]


def chosen_settings(
    mesh: ObjectMesh,
    model: GraspModel,
    sampling: Sampling | None,
    mode: Mode,
    scene: Scene | None = None,
) -> Values:
    """Those of the settings that the user chooses, known before the mesh is labelled.

    Those of a load are `load_settings`.
    """
    return {
        "source": _ascii(mesh.report.source),
        "mode": mode,
        **plain_values(model),
        **({} if sampling is None else plain_values(sampling)),
        **plain_values(mesh.options),
        "region": _ascii(str(mesh.options.region)),
        "unit": mesh.file_unit or "unknown",
        "lengths": mesh.unit or "unknown",
        **scene_settings(scene),
    }


def _ascii(text: str) -> str:
    """A text as one line of ASCII characters, as headers need."""
    return text.encode("unicode_escape", "surrogateescape").decode("ascii")
