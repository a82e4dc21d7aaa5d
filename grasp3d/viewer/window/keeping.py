"""What a window writes: the labelled surface and pictures, under names that are free."""

from pathlib import Path

import pyvista
from PIL import Image

from grasp3d.system.files import written_whole
from grasp3d.viewer.scene.pictures import copied, saved_as
from grasp3d.viewer.session.session import Session


def save_labels(session: Session) -> None:
    """Write the surface with its labels into the working folder, in the background; say where.

    Raises:
        GraspError: There are none yet.
    """
    session.save_soon(_free(session, "labeled", ".ply"))


def save_view(session: Session, camera: pyvista.Camera, width: int, height: int) -> None:
    """Draw what is seen, with a legend, into a file in the working folder, and say where.

    Args:
        session: What is shown.
        camera: From where.
        width: Of the picture [pixels].
        height: Of the picture [pixels].

    Raises:
        OutputError: The file cannot be written.
    """
    path = _free(session, "view", ".png")
    drawn = copied(session, camera, width, height)
    with written_whole(path) as part:
        Image.fromarray(drawn).save(part, format="PNG")
    session.tell(f"saved: {path}")


def _free(session: Session, kind: str, suffix: str) -> Path:
    """A name in the working folder that no file has."""
    name = Path(saved_as(session, kind, suffix))
    path, number = Path.cwd() / name, 1
    while path.exists():
        number += 1
        path = path.with_name(f"{name.stem}_{number}{suffix}")
    return path
