"""The vertex that a click hits."""

import threading

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.viewer.session.state import Section
from grasp3d.viewer.subjects.subject import Subject


def prepare_picking(subject: Subject, before: Subject | None) -> None:
    """Build the ray tracer for clicks in the background, or reuse that of the same geometry.

    Args:
        subject: The surface.
        before: The surface displayed before.
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
    """Find the vertex nearest to the hit of a ray, among the corners of the face that is hit.

    Args:
        subject: The surface.
        origin: Start of the ray, in the mesh's frame, shape (3,).
        direction: Direction of the ray, shape (3,), of any length.
        section: A section; its hidden part cannot be hit.

    Returns:
        The vertex; None if the ray hits nothing.
    """
    direction = direction / np.linalg.norm(direction)
    reach = np.inf
    if section is not None:
        point, normal = section.plane(subject.bounds)
        height, climb = float(normal @ (origin - point)), float(normal @ direction)
        crossing = -height / climb if climb else np.inf
        if height < 0.0:
            if climb <= 0.0:
                return None
            origin = origin + crossing * direction
        elif climb < 0.0:
            reach = crossing
    start = subject.normalized(origin)
    toward = np.asarray(direction, dtype=np.float32)[None]
    hit = subject.rays.hits(np.asarray(start, dtype=np.float32)[None], toward)
    face, distance = int(hit["primID"][0]), float(hit["tfar"][0]) * subject.size
    if face < 0 or distance > reach:
        return None
    corners = subject.faces[face]
    gaps = np.linalg.norm(subject.vertices[corners] - (origin + distance * direction), axis=1)
    return int(corners[np.argmin(gaps)])
