"""Labels of a surface with other arrays over the vertices."""

from typing import Any

from grasp3d import SurfaceLabels


def with_arrays(labels: SurfaceLabels, **changed: Any) -> SurfaceLabels:
    """The same labels with other arrays over the vertices, or another mesh.

    Args:
        labels: The labels.
        changed: Arguments of `SurfaceLabels.of_vertices` by name.
    """
    arguments: dict[str, Any] = {
        "mesh": labels.mesh,
        "model": labels.model,
        "angles": (labels.critical_angle, labels.critical_angle_best),
        "partner_points": labels.partner_points,
        "grip": labels.grip,
        "reason": labels.reason,
        "reach": labels.reach,
        "sampling": labels.sampling,
        "mode": labels.mode,
        "search": labels.search,
        "scene": labels.scene,
        "load": labels.load,
    }
    arguments |= changed
    return SurfaceLabels.of_vertices(arguments.pop("mesh"), arguments.pop("model"), **arguments)


def with_known(labels: SurfaceLabels, **known: Any) -> SurfaceLabels:
    """Add known values to labels, as if they came from a file."""
    vars(labels).update(known)
    return labels
