"""Saving labels and pictures from a window, under unused file names."""

from pathlib import Path

import pyvista
from PIL import Image

from grasp3d.system.files import atomic_write
from grasp3d.viewer.scene.pictures import file_name, render_copy
from grasp3d.viewer.session.session import Session


def save_labels(session: Session) -> None:
    """Write the labels into the working folder in the background; a message reports the path.

    Raises:
        GraspError: There are no labels yet.
    """
    session.save_in_background(_unused_path(session, "labeled", ".ply"))


def save_view(session: Session, camera: pyvista.Camera, width: int, height: int) -> None:
    """Write a picture with a legend into the working folder; a message reports the path.

    Args:
        session: The session.
        camera: Camera of the view.
        width: Width of the picture [pixels].
        height: Height of the picture [pixels].

    Raises:
        OutputError: The file cannot be written.
    """
    path = _unused_path(session, "view", ".png")
    picture = render_copy(session, camera, width, height)
    with atomic_write(path) as part:
        Image.fromarray(picture).save(part, format="PNG")
    session.show_message(f"saved: {path}")


def _unused_path(session: Session, kind: str, suffix: str) -> Path:
    """A path in the working folder at which there is no file."""
    name = Path(file_name(session, kind, suffix))
    path, number = Path.cwd() / name, 1
    while path.exists():
        number += 1
        path = path.with_name(f"{name.stem}_{number}{suffix}")
    return path
