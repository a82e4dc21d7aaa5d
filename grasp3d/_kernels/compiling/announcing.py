"""Log lines before kernels are compiled, and runs that stop where one would have to be.

Numba reports every compilation that its cache does not save. The lines go to the logger
`grasp3d.compiling`; without any logging configured, Python writes them to standard error.
"""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from numba.core import event

from grasp3d._kernels.compiling.machine_code import cache_folder

logger = logging.getLogger("grasp3d.compiling")

PAIR, TRIPLE = 2, 3


@dataclass(frozen=True)
class Phase:
    """Kernels that are usually compiled one after the other."""

    work: str
    """What they do, for the line."""
    seconds: int
    """Time to compile them, as measured on one core of a server [s]."""
    kernels: tuple[str, ...]
    """Kernels that are called from Python, as MODULE.FUNCTION."""

    @property
    def compiled(self) -> bool:
        """Whether machine code of all the kernels is stored, for whatever processor."""
        folder = cache_folder()
        return folder is not None and all(
            any(folder.glob(f"{kernel}-*.nbc")) for kernel in self.kernels
        )


SHORTEST = 2
"""Time to compile from which a line is logged [s]."""

MESHES = Phase("meshes", 2, ("normal_sets.order_normal_sets",))
PATCHES = Phase(
    "contact patches",
    2,
    ("patches.measure_distances", "patches.patch_vectors", "patches.reset_front"),
)
TWO_FINGERS = Phase(
    "two fingers",
    10,
    (
        "crease_contacts.bound_creases",
        "crease_contacts.faces_of_corners",
        "exact_descent.descend_exactly",
        "face_tree.face_tree",
        "surface_contacts.write_normals_of_all",
    ),
)
RAYS = Phase(
    "searches by rays",
    10,
    (
        "antipodal_descent.descend",
        "antipodal_directions.seed_rays",
        "antipodal_neighbours.neighbour_rays",
        "antipodal_refinement.exploring_rays",
        "antipodal_refinement.refining_rays",
        "ray_crossings.evaluate_crossings",
        "ray_tracing.write_rays",
    ),
)
LOCATIONS = Phase(
    "uncertain contact locations", 2, ("pair_lines.locate_pairs", "pair_lines.pair_angles")
)
THREE_FINGERS = Phase(
    "three fingers",
    10,
    (
        "multifinger.search_three_fingers",
        "coplanar_contacts.critical_of_sets",
        "coplanar_contacts.critical_of_three",
    ),
)
MORE_FINGERS = Phase("four fingers and more", 30, ("multifinger.search_more_fingers",))
WRENCHES = Phase("wrenches of contacts", 1, ("contact_axes.write_axes",))
EPSILON_OF_PAIRS = Phase("epsilon of two fingers", 4, ("pair_epsilon.pair_epsilons",))
EPSILON = Phase("epsilon", 10, ("wrench_problem.epsilons",))
EPSILON_OF_ANY_RANK = Phase(
    "epsilon in fewer than six dimensions", 15, ("wrench_problem.epsilons_of_any_rank",)
)
SCANS = Phase("scans", 1, ("scanning.scan",))
PICTURES = Phase("pictures of batches", 1, ("visible_faces.draw_surface",))
GRIPPERS = Phase(
    "grippers",
    15,
    (
        "box_tree.box_tree",
        "pose_collisions.collide_poses",
        "reachable_partners.explain_pairs",
        "reachable_partners.keep_reached",
        "reachable_partners.search_reachable",
        "reaching.reach_pairs",
        "reaching.reach_tips",
    ),
)
CLOSING = Phase("closing jaws", 25, ("closing.close_on",))
FORCES = Phase(
    "grip forces",
    25,
    ("grip_force.task_forces", "grip_force.wrench_forces", "tasks.reach"),
)
PHASES = (
    MESHES, PATCHES, TWO_FINGERS, RAYS, LOCATIONS, THREE_FINGERS, MORE_FINGERS, WRENCHES,
    EPSILON_OF_PAIRS, EPSILON, EPSILON_OF_ANY_RANK, SCANS, PICTURES, GRIPPERS, CLOSING, FORCES,
)  # fmt: skip


class NotCompiledError(Exception):
    """A kernel would have to be compiled, in a run that must not."""


class Announcer(event.Listener):
    """Logs a line before the first compilation of each phase of this process."""

    def __init__(self, package: str) -> None:
        self._package = package
        self._depth = 0  # kernels compile those that they call; Numba holds its lock meanwhile
        self.compiled: list[Phase] = []
        """Phases in which this process has compiled kernels."""
        self.refusing = False
        """Whether a compilation is refused with `NotCompiledError`."""

    def on_start(self, event: Any) -> None:
        """Announce a compilation."""
        self._depth += 1
        kernel = event.data["dispatcher"].py_func
        package, _, module = kernel.__module__.rpartition(".")
        if self._depth == 1 and f"{package}.".startswith(f"{self._package}."):
            if self.refusing:
                raise NotCompiledError(kernel.__name__)
            self._announce(f"{module}.{kernel.__qualname__}")

    def on_end(self, event: Any) -> None:  # noqa: ARG002, Numba's interface
        """Note the end of a compilation."""
        self._depth -= 1

    def _announce(self, kernel: str) -> None:
        for phase in PHASES:
            if kernel in phase.kernels and phase not in self.compiled:
                self.compiled.append(phase)
                if phase.seconds >= SHORTEST:
                    logger.warning(announcement(phase.work, phase.seconds))


announcer = Announcer(__package__.rpartition(".")[0])


def announcement(work: str, seconds: int) -> str:
    """Line about a compilation that is going to begin.

    Args:
        work: What the kernels do.
        seconds: Time that it takes [s].
    """
    often = (
        "in every process: no folder can be written for them (set NUMBA_CACHE_DIR)"
        if cache_folder() is None
        else "once per installation (grasp3d warmup does it ahead)"
    )
    return f"grasp3d: compiling kernels for {work}, about {seconds} s, {often}"


def seconds_missing(fingers: int, *, gripper: bool = False, forces: bool = False) -> int:
    """Time to compile the kernels for a number of fingers that are not compiled yet [s].

    Args:
        fingers: Number of fingers; 0: only meshes are prepared.
        gripper: Whether a gripper must reach the grasps.
        forces: Whether grip forces of the grasps are needed.
    """
    phases = [MESHES]
    if fingers:  # a search for more fingers starts from the grasps of two
        phases += [PATCHES, TWO_FINGERS, RAYS, LOCATIONS, WRENCHES, EPSILON_OF_PAIRS]
        phases += [EPSILON, EPSILON_OF_ANY_RANK, PICTURES]
        phases += [SCANS] if fingers == PAIR else [THREE_FINGERS]
        phases += [MORE_FINGERS] if fingers > TRIPLE else []
        phases += [GRIPPERS, CLOSING] if gripper else []
        phases += [FORCES] if forces else []
    return sum(phase.seconds for phase in phases if not phase.compiled)


def all_compiled(run: Callable[[], object]) -> bool:
    """Whether all kernels that a function calls are compiled; it ends at the first that is not."""
    announcer.refusing = True
    try:
        run()
    except NotCompiledError:
        return False
    finally:
        announcer.refusing = False
    return True
