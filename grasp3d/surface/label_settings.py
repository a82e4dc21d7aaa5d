"""The settings that labelled files hold: what the labels were computed with."""

import json
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from grasp3d.hand.scene import Scene, scene_settings
from grasp3d.mesh import ObjectMesh
from grasp3d.quality.loads import load_settings
from grasp3d.settings import GraspModel, Sampling
from grasp3d.settings.parsing import plain_values
from grasp3d.stability.label import Label, Mode
from grasp3d.surface.grasp_numbers import EPSILON_RTOL
from grasp3d.system.versions import package_version

if TYPE_CHECKING:
    from grasp3d.surface.labels import SurfaceLabels

INFINITE = "infinite_"
"""Start of the names of arrays that hold where values, which are nan here, are infinite."""

SETTING = "setting_"
"""Start of the names of settings beside arrays, some of which have the name of a setting."""

GIVEN_ANGLE = "given_angle"
"""Key in the setting `search` of the `search_angle` that was given; None: that of the model."""

Values = dict[str, str | float | int | None]


def settings_of(labels: "SurfaceLabels") -> Values:
    """Settings and versions that the labels were computed with; angles in radians."""
    mesh, search = labels.mesh, labels.search
    u_means = "no_grasp_found" if labels.mode == "label" else "surely_unstable"
    return {
        "version": package_version(),
        **chosen_settings(mesh, labels.model, labels.sampling, labels.mode, labels.scene),
        **({} if labels.load is None else load_settings(labels.load)),
        "search_angle": search.cone,
        "rays_traced": search.rays,
        "candidates_evaluated": search.evaluated,
        "file_vertices": mesh.file_vertices,
        "torque_scale": mesh.torque_scale,
        "epsilon_rank": labels.model.epsilon_rank,
        "epsilon_rtol": EPSILON_RTOL,
        "epsilon_min": labels.model.tilts,
        "epsilon_max": "sampled_tilts" if labels.model.method == "extremes" else "upper_bound",
        **({} if labels.load_result is None else labels.load_result.settings()),
        "label_codes": f"{Label.U:d}=U({u_means}) {Label.M:d}=M(cannot_tell) {Label.S:d}=S(stable)",
    }


def complete_settings(labels: "SurfaceLabels") -> Values:
    """The same with what a prepared mesh has beside its arrays, and the extent of the search."""
    mesh, sampling = labels.mesh, labels.sampling
    angle = None if sampling is None else sampling.search_angle
    surface: dict[str, Any] = {
        "center": mesh.center.tolist(),
        "size": mesh.size,
        "center_mass": mesh.center_mass.tolist(),
        "volume": mesh.volume,
        "report": asdict(mesh.report),
    }
    return {
        **settings_of(labels),
        "surface": json.dumps(surface),
        "search": json.dumps({**asdict(labels.search), GIVEN_ANGLE: angle}),
    }


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
