"""Compiling kernels ahead, so that no later run waits for it, and once before the jobs of a run."""

import functools
import itertools
import json
import os
import subprocess
import sys
import tempfile
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from grasp3d.errors import GraspError, OutputError, SettingError
from grasp3d.settings import MAX_SEARCHED_FINGERS, GraspModel, Sampling, whole_number
from grasp3d.system.compiling import NotCompiledError, announcement, compilations, logger
from grasp3d.system.context import running, unreported
from grasp3d.system.isolation import call, end_idle
from grasp3d.system.names import printable

if TYPE_CHECKING:
    from grasp3d.mesh import ObjectMesh

PAIR = 2

_FACES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
     [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
)  # fmt: skip
"""Faces of a cube with its corners in lexicographic order; those of the solid are distorted."""

_FACING = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
"""Inward normals of two opposite contacts, which are at the opposite points."""

_THIN = np.arctan(0.5) - 1e-12
"""Angle of normals off the line with which friction 0.5 is hardly enough [rad]."""

_CHILD = """
import json, logging, sys
level, settings, sys.path = map(json.loads, sys.argv[1:])
logging.getLogger("grasp3d.compiling").setLevel(level)
from grasp3d.batch.warmup import warmup
from grasp3d.system.context import running
print(json.dumps(warmup(**settings)))
"""
"""Program of a process that compiles into another folder, which kernels choose when loaded."""


class Kernels(NamedTuple):
    """Which kernels jobs need, as `compile_kernels` takes them."""

    fingers: int
    gripper: bool = False
    forces: bool = False


def warmup(
    fingers: int = PAIR,
    *,
    gripper: bool = False,
    forces: bool = False,
    cache: str | os.PathLike[str] | None = None,
) -> tuple[str, ...]:
    """Compile the kernels for two fingers, or for that and more, unless they are compiled already.

    Kernels are compiled when they are first needed, once per installation, and a line about it
    goes to the logger `grasp3d.compiling`, once per process: to standard error, where no logging is
    configured. Compiling ahead serves images of containers, and clusters.

    Args:
        fingers: Largest number of fingers of the grasps, 2 to 5; four and five fingers have the
            same kernels.
        gripper: Whether the kernels for grippers are compiled too.
        forces: Whether the kernels for grip forces are compiled too, as a load needs them.
        cache: Folder for the machine code, which runs find where NUMBA_CACHE_DIR names it, also if
            they can only read it; None: the folder of this user.

    Returns:
        The names of the kernels that were compiled, as 'MODULE.FUNCTION'; empty: all of them were
        compiled before.

    Raises:
        SettingError: The number of fingers is outside its range.
        OutputError: No file can be written in the folder.

    Example:
        >>> import grasp3d
        >>> compiled = grasp3d.warmup()
        >>> grasp3d.warmup()
        ()
    """
    if not PAIR <= whole_number("fingers", fingers, PAIR) <= MAX_SEARCHED_FINGERS:
        raise SettingError(f"fingers must be from 2 to {MAX_SEARCHED_FINGERS}; got {fingers}")
    if cache is not None:
        return _warmup_into(Path(cache), fingers=fingers, gripper=gripper, forces=forces)
    before = len(compilations.kernels)
    for count in sorted({PAIR, fingers}):
        compile_kernels(count, gripper, forces)
    return tuple(compilations.kernels[before:])


def _warmup_into(folder: Path, **settings: int) -> tuple[str, ...]:
    """Call `warmup` in a process for which NUMBA_CACHE_DIR is the folder."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        raise OutputError(
            f"cannot write machine code to {printable(str(folder))}: {error.strerror}; "
            "choose a folder that can be written"
        ) from error
    arguments = [json.dumps(value) for value in (logger.level, settings, sys.path)]
    child = subprocess.run(  # noqa: S603, this interpreter
        [sys.executable, "-c", _CHILD, *arguments],
        env={**os.environ, "NUMBA_CACHE_DIR": str(folder.absolute())},
        stdout=subprocess.PIPE, text=True, check=False,
    )  # fmt: skip
    if child.returncode:
        raise OutputError(
            f"the kernels were not compiled into {printable(str(folder))}: the process ended with "
            f"code {child.returncode}; see its lines above"
        )
    return tuple(json.loads(child.stdout))


@functools.cache
def compile_first(kernels: Kernels, *, children: int = 1) -> None:
    """Compile kernels in a child process, unless they are compiled; the line is logged here.

    This process needs none of them, and otherwise every worker would compile them with its first
    mesh, within its limits and time.

    Args:
        kernels: The kernels.
        children: Child processes that load the kernels at the same time, if they are compiled.
    """
    interrupted = threading.Event()

    def missing() -> str:
        return call(missing_line, kernels, cancelled=interrupted.is_set)

    with suppress(GraspError):  # the jobs report the same failure
        with ThreadPoolExecutor(children) as threads:
            try:
                lines = [
                    line.result() for line in [threads.submit(missing) for _ in range(children)]
                ]
            except BaseException:  # the other children are ended, too
                interrupted.set()
                raise
        if lines[0]:
            logger.warning(lines[0])
            call(compile_kernels, *kernels)
            end_idle()  # the child has taken more memory than one that labels


def missing_line(kernels: Kernels) -> str:
    """Load kernels; returns the line to log where some are not compiled."""
    from grasp3d._kernels.compiling.machine_code import cache_folder

    try:
        with compilations.refused():
            compile_kernels(*kernels)
    except NotCompiledError:
        return announcement(stored=cache_folder() is not None)
    return ""


@functools.cache
@running(threads=1)
@unreported()
def compile_kernels(fingers: int, gripper: bool = False, forces: bool = False) -> None:
    """Call every kernel that commands and functions need for a number of fingers.

    Args:
        fingers: Number of fingers of the grasps; 0: only meshes are prepared.
        gripper: Whether a gripper must reach the grasps.
        forces: Whether grip forces of the grasps are needed, under a load.
    """
    solid = _solid()
    if not fingers:
        return
    from grasp3d.batch.report import thumbnail
    from grasp3d.grasps.distinct import best_grasps
    from grasp3d.grasps.evaluation import evaluate_grasps
    from grasp3d.surface.labelling import label_surface
    from grasp3d.surface.scanning import scan_surface

    _solid(patch_radius=0.1)
    _locate()
    model = GraspModel(fingers=fingers)
    sampling = Sampling(grip="both") if fingers == PAIR else None
    labels = label_surface(solid, model, sampling=sampling)
    if fingers == PAIR:  # squeezing alone has a search of its own
        label_surface(solid, model)
    if gripper:
        _reach(solid, model, sampling)
    labels.compute("epsilon_range")
    thumbnail(labels)
    _grow_hulls()
    contacts = best_grasps(labels, 1).contacts.points[0]  # (n, 3)
    evaluate_grasps(solid, contacts, model)
    scan_surface(solid, model, fixed=contacts[1:]).compute("epsilon_range")
    if forces:
        compile_forces()


@functools.cache
def _locate() -> None:
    """Label two grasps with uncertain contact locations."""
    from grasp3d.contact.contacts import Contacts
    from grasp3d.stability.classification import classify

    classify(Contacts([-_FACING] * 2, [_FACING] * 2), 0.1, location_error=[0.1, 0.2])


def _grow_hulls() -> None:
    """Compute epsilon of pairs with polygonal cones, which have no solver of their own.

    The wrenches of two hard fingers have rank 5, those of two soft ones rank 6.
    """
    from grasp3d.contact.contacts import Contacts
    from grasp3d.quality.closure import force_closure
    from grasp3d.quality.ferrari_canny import epsilon

    for torsion_radius in (0.0, 0.2):
        epsilon(Contacts(-_FACING, _FACING, 0.5, torsion_radius), edges=8)
    # The line is only just inside the cones: the hull is too thin for the usual proof of closure.
    cosine, sine = np.cos(_THIN), np.sin(_THIN)
    force_closure(Contacts(-_FACING, [[cosine, sine, 0.0], [-cosine, sine, 0.0]], 0.5))


def _reach(mesh: "ObjectMesh", model: GraspModel, sampling: Sampling | None) -> None:
    """Label grasps that a gripper reaches, and those that it closes on, reached or not."""
    from grasp3d.grasps.evaluation import evaluate_grasps
    from grasp3d.grasps.poses import GraspPoses
    from grasp3d.hand.jaw_reach import reach_grasps
    from grasp3d.hand.parallel_gripper import ParallelGripper
    from grasp3d.hand.table import Approach
    from grasp3d.surface.labelling import label_surface

    tactile = ParallelGripper.preset("tactile")
    pairs = model.fingers == PAIR
    # From above many best grasps are not reached: others are searched for, and not always found.
    above = Approach(np.array([0.0, 0.0, -1.0]), within=0.3) if pairs else None
    labels = label_surface(mesh, model, sampling=sampling, hand=tactile, approach=above)
    if pairs:
        corners = labels.mesh.vertices[None, :PAIR], labels.mesh.normals[None, :PAIR]
        reach_grasps(labels.mesh, *corners, tactile)
        poses = GraspPoses(poses=np.stack([np.eye(4)] * 2), unit=mesh.unit)
        evaluate_grasps(labels.mesh, poses, labels.model, hand=tactile)


def compile_forces() -> None:
    """Resist tasks of each kind with hard and soft fingers, not all of which do."""
    from grasp3d.contact.contacts import Contacts
    from grasp3d.quality.force_ranges import force_range
    from grasp3d.quality.tasks import Weight

    tasks = (Weight(1.0, direction=(0.0, 0.0, -1.0), within=0.1), Weight(1.0, center_radius=0.1))
    for torsion_radius in (0.0, 0.2):
        contacts = Contacts(-_FACING, _FACING, 0.5, torsion_radius)
        for task in (*tasks, [0.0, 0.0, -1.0, 0.0, 0.0, 0.0]):
            force_range(contacts, task, 0.1)


def _solid(patch_radius: float = 0.0) -> "ObjectMesh":
    """A small solid without symmetry, whose best grasps rays find by refinement alone."""
    from grasp3d.mesh import load_mesh

    corners = np.array(list(itertools.product((0.0, 1.0), repeat=3)))
    corners += 0.1 * np.sin(np.arange(24.0)).reshape(8, 3)
    return load_mesh((corners, _FACES), unit="in", max_edge=0.6, patch_radius=patch_radius)
