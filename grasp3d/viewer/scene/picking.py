"""Which vertex a ray from the eye meets."""

import threading

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.viewer.session.state import Section
from grasp3d.viewer.subjects.subject import Subject


def prepare(subject: Subject, before: Subject | None) -> None:
    """Make ready for clicks in the background; the same surface need not be prepared again.

    Args:
        subject: The surface.
        before: What was shown until now.
    """
    if (
        before is not None
        and before.vertices is subject.vertices
        and before.faces is subject.faces
        and "rays" in vars(before)
    ):
        vars(subject).setdefault("center", before.center)
        vars(subject).setdefault("rays", before.rays)
    else:
        threading.Thread(target=lambda: subject.rays, daemon=True).start()


def vertex_at(
    subject: Subject, origin: Floats, direction: Floats, section: Section | None = None
) -> int | None:
    """Find the corner, nearest to where a ray meets the surface, of the face that it meets.

    Args:
        subject: The surface.
        origin: Where the ray begins, in the mesh's frame, shape (3,).
        direction: Where it goes, shape (3,), of any length.
        section: What is in front of it is not met.

    Returns:
        The vertex; None where the ray misses.
    """
    direction = direction / np.linalg.norm(direction)
    reach = np.inf
    if section is not None:
        place, normal = section.plane(subject.bounds)
        height, climb = float(normal @ (origin - place)), float(normal @ direction)
        crossing = -height / climb if climb else np.inf
        if height < 0.0:
            if climb <= 0.0:
                return None
            origin = origin + crossing * direction
        elif climb < 0.0:
            reach = crossing
    start = subject.normalized(origin)
    toward = np.asarray(direction, dtype=np.float32)[None]
    answer = subject.rays.hits(np.asarray(start, dtype=np.float32)[None], toward)
    face, away = int(answer["primID"][0]), float(answer["tfar"][0]) * subject.size
    if face < 0 or away > reach:
        return None
    corners = subject.faces[face]
    gaps = np.linalg.norm(subject.vertices[corners] - (origin + away * direction), axis=1)
    return int(corners[np.argmin(gaps)])
