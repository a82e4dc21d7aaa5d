"""What labelling a mesh will take: memory and time, told and bounded before the work."""

from dataclasses import dataclass

from grasp3d.errors import MeshError
from grasp3d.settings import GraspModel, Sampling

BASE = 0.3
"""Memory of a process that has labelled next to nothing [GB]."""

PER_VERTEX = 2e-6, 1.2e-6
"""Memory for each vertex [GB]: for two fingers, and for each finger more."""

SECONDS = {2: 4e-4, 3: 1.1e-3, 4: 2.5e-3, 5: 3e-3}
"""Time for each vertex with the usual search, labels and epsilon, on one processor [s]."""


@dataclass(frozen=True)
class Cost:
    """What labelling a mesh is expected to take, for exact labels within a factor of about two."""

    memory: float
    """Largest memory of the process [GB]."""
    seconds: float
    """Time, once everything is compiled [s]."""
    more: bool
    """It will take several times as long: hulls of extreme normals, or epsilon of soft fingers or
    with the forces limited one by one."""


def labelling_cost(
    vertices: int, model: GraspModel, sampling: Sampling, *, threads: int = 1
) -> Cost:
    """Estimate what labels and epsilon of a surface will take.

    Args:
        vertices: After refinement.
        model: Its number of fingers decides most.
        sampling: Its rays or candidates count for the rest.
        threads: Processors that share the work.
    """
    usual = Sampling()
    fingers = min(model.fingers, max(SECONDS))
    share = sampling.rays / usual.rays
    if model.fingers > 2:
        share = sampling.candidates / usual.candidates
    first, more = PER_VERTEX
    return Cost(
        memory=BASE + vertices * (first + more * (fingers - 2)),
        seconds=vertices * SECONDS[fingers] * share / threads,
        more=model.method == "extremes"
        or model.torsion_radius > 0.0
        or model.actuation == "per_finger",
    )


def check_cost(vertices: int, max_memory: float, where: str, cure: str, fingers: int = 2) -> None:
    """Refuse a surface that cannot be labelled within so much memory.

    Args:
        vertices: After refinement, or as many as are expected.
        max_memory: What may be taken [GB].
        where: Name of the mesh.
        cure: What else would help, besides more memory.
        fingers: Of a grasp.

    Raises:
        MeshError: It would take more.
    """
    needed = labelling_cost(vertices, GraspModel(fingers=fingers), Sampling()).memory
    if needed > max_memory:
        raise MeshError(
            f"{where}: {vertices:,} vertices would take about {needed:.3g} GB, and max_memory is "
            f"{max_memory:g} GB; {cure}, or raise max_memory (--max-memory)"
        )
