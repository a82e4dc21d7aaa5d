"""The fields that labelled files must have."""

from collections.abc import Iterator
from pathlib import Path

from grasp3d.errors import OutputError
from grasp3d.export.fields import Field
from grasp3d.export.vertex_fields import SURFACE, VERTICES
from grasp3d.settings import GraspModel
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.system.names import printable

OPTIONAL = ("payload", "label_with_force", "free_angles", "color", "area")
"""Fields that follow from others, or depend on more than whether there is a load or a gripper."""


def needed_fields(
    model: GraspModel, *, complete: bool, gripper: bool, load: bool
) -> Iterator[Field]:
    """The fields that a file must have.

    Args:
        model: The model of its labels.
        complete: Whether its format has every field; otherwise it is a PLY.
        gripper: Whether a gripper must reach the grasps.
        load: Whether there is a load.
    """
    present = {
        "always": True,
        "errors": not model.is_uniform,
        "gripper": gripper,
        "joints": False,
        "load": load,
    }
    for field in (*VERTICES, *SURFACE):
        in_format = complete or bool(field.ply) or field.name == "faces"
        if in_format and present[field.when] and field.name not in OPTIONAL:
            yield field


def check_complete(path: str | Path, labels: SurfaceLabels, *, complete: bool) -> None:
    """Refuse to write labels that lack what a reader of the file would need.

    They were read from a PLY, which does not contain the opposing contacts.

    Args:
        path: The file that is written.
        labels: The labels.
        complete: As in `needed_fields`.

    Raises:
        OutputError: A field is not known.
    """
    if labels.grasps.known_contacts is not None:
        return
    needed = needed_fields(
        labels.model, complete=complete, gripper=labels.scene is not None,
        load=labels.load is not None,
    )  # fmt: skip
    for field in needed:
        if field not in SURFACE and field.values_of(labels) is None:
            why = (
                f"{field.name} is not known of labels that were read from a PLY and changed; "
                "label the mesh again, or write a GLB"
                if field.ply
                else f"the labels were read from a PLY, which has no {field.name}; write a PLY or "
                "GLB, or label the mesh again"
            )
            raise OutputError(f"{printable(str(path))}: {why}")
