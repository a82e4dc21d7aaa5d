"""Estimates of the memory and time that labelling a mesh takes, and their limits."""

from dataclasses import dataclass

from grasp3d.errors import MeshError
from grasp3d.settings import GraspModel, Sampling

BASE = 0.3
"""Memory of a process that labels a very small mesh [GB]."""

PER_VERTEX = 1.6e-6, 1.2e-6
"""Memory for each vertex [GB]: for two fingers, and for each further finger."""

SECONDS = {2: 1e-4, 3: 1.1e-3, 4: 2.5e-3, 5: 3e-3}
"""Time for each vertex with the default search, for labels and epsilon, on one processor [s]."""


@dataclass(frozen=True)
class Cost:
    """Expected cost of labelling a mesh, for exact labels within a factor of about two."""

    memory: float
    """Largest memory of the process [GB]."""
    seconds: float
    """Time without compilation [s]."""
    more: bool
    """Whether it takes several times as long as `seconds`: hulls of extreme normals, or epsilon of
    soft fingers."""


def labelling_cost(
    vertices: int, model: GraspModel, sampling: Sampling, *, threads: int = 1
) -> Cost:
    """Estimate the cost of the labels and epsilon of a surface.

    Args:
        vertices: Number of vertices after refinement.
        model: Mainly its number of fingers matters.
        sampling: Its number of candidates matters, and that of rays unless two fingers squeeze.
        threads: Number of processors that are used.
    """
    fingers = min(model.fingers, max(SECONDS))
    if fingers > 2:
        effort = sampling.candidates / Sampling.candidates
    else:  # the time of branch and bound, which fingers that squeeze have, is not that of the rays
        effort = 1.0 if sampling.grip == "squeeze" else sampling.rays / Sampling.rays
    two_fingers, per_finger = PER_VERTEX
    return Cost(
        memory=BASE + vertices * (two_fingers + per_finger * (fingers - 2)),
        seconds=vertices * SECONDS[fingers] * effort / threads,
        more=model.method == "extremes" or model.soft,
    )


def check_cost(vertices: int, max_memory: float, mesh: str, remedy: str, fingers: int = 2) -> None:
    """Refuse a surface whose labelling would exceed a memory limit.

    Args:
        vertices: Number of vertices after refinement, or an estimate.
        max_memory: Memory limit [GB].
        mesh: Name of the mesh, for the message.
        remedy: What to do about it besides raising the limit, for the message.
        fingers: Number of fingers of a grasp.

    Raises:
        MeshError: Labelling would exceed the limit.
    """
    needed = labelling_cost(vertices, GraspModel(fingers=fingers), Sampling()).memory
    if needed > max_memory:
        raise MeshError(
            f"{mesh}: {vertices:,} vertices would take about {needed:.3g} GB, and max_memory is "
            f"{max_memory:g} GB; {remedy}, or raise max_memory (--max-memory)"
        )
