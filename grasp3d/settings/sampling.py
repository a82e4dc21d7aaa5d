"""Settings of the search for grasps, and the memory and time that it takes."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, TypeAlias

from grasp3d.errors import MeshError, SearchCoverageError, SettingError
from grasp3d.settings.checks import LARGEST_SEED, check_choice, check_range
from grasp3d.settings.grasp_model import MAX_SEARCHED_FINGERS, GraspModel
from grasp3d.settings.parsing import IN_PYTHON
from grasp3d.settings.units import Length, LengthSettings, Radians, describe_length

Grip = Literal["squeeze", "expand", "both"]
CandidatePoints = Literal["surface", "vertices"]
MIN_RAYS, MAX_RAYS = 8, 65_536
MIN_CANDIDATES, MAX_CANDIDATES = 8, 4096
ANGLE_ROUNDING = 1e-9
"""Angle by which a cone may exceed the searched cone and still count as covered [rad]."""


@dataclass(frozen=True)
class Sampling(LengthSettings):
    """How far and how finely to search for grasps.

    A length is in metres, or has a unit: '80mm', '8cm', '3in'; see `Length`.

    Attributes:
        search_angle: Largest critical friction angle that is searched for, up to 90 degrees; for
            two fingers the half-angle of the cone of directions about the inward normal. none: just
            what friction and resolution need. Wider: the surface can be labelled again, without a
            new search, for any friction and resolution with atan(friction) + alpha/2 up to this
            angle. Narrower: a limit to the search.
        tolerance: Step size at which a search by rays or random steps stops around a vertex's best
            grasp. It is not an error of sensor or gripper.
        min_opening: Smallest distance between any two contacts, a length. Contacts of three or more
            fingers are at least 1/100 of the object's size apart, or 1/10 of max_opening if that is
            less.
        max_opening: Largest distance between any two contacts, a length: the gripper's stroke, or
            the reach of the robot's hand.
        grip: Two fingers. squeeze: they are outside, pushing toward each other; expand: inside a
            ring or a mug, pushing apart; both: whichever is better.
        rays: Two fingers that expand: directions tested from every vertex before the search is
            refined, 8 to 65536. For fingers that squeeze the whole surface is searched.
        candidates: Three fingers and more: candidate points for every other finger before the
            search is refined, spread evenly over the surface within reach of a vertex, 8 to 4096.
            If candidate points are vertices, all of them are tested where there are at most four
            times as many.
        candidate_points: Three fingers and more: where the other fingers may be. surface: anywhere
            on it; vertices: at the mesh's vertices only.
        seed: Three fingers and more: random seed of the candidate points and of the search; the
            same seed gives the same labels.

    Example:
        A gripper that opens to 80 mm, and a search that is wide enough to label the surface again
        with a friction of up to 1 and a fine sensor:

        >>> import math
        >>> import grasp3d
        >>> sampling = grasp3d.Sampling(max_opening="80mm", search_angle=math.radians(50.0))
        >>> grasp3d.Sampling(rays=4)
        Traceback (most recent call last):
            ...
        grasp3d.errors.SettingError: rays must be from 8 to 65536; got 4

        A hand that spans 150 mm, on a ball:

        >>> import trimesh
        >>> hand = grasp3d.Sampling(max_opening="150mm", candidates=16)
        >>> ball = grasp3d.load_mesh(trimesh.creation.icosphere(1, 0.04), unit="m", max_edge=0.1)
        >>> labels = grasp3d.label_surface(ball, grasp3d.GraspModel(fingers=3), sampling=hand)
        >>> labels.sampling.max_opening, labels.partners.shape
        (0.15, (42, 2, 3))
    """

    search_angle: Annotated[Radians | None, IN_PYTHON] = None
    tolerance: Annotated[Radians, IN_PYTHON] = 1e-3
    grip: Grip = "squeeze"
    min_opening: Length[float] = Length(0.0)
    max_opening: Length[float] = Length(math.inf)
    rays: Annotated[int, IN_PYTHON] = 64
    candidates: Annotated[int, IN_PYTHON] = 64
    candidate_points: Annotated[CandidatePoints, IN_PYTHON] = "surface"
    seed: Annotated[int, IN_PYTHON] = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.search_angle is not None:
            most = math.pi / 2.0
            check_range("search angle", self.search_angle, 0.0, most, ends="(]", degrees=True)
        most = math.radians(5.0)
        check_range("tolerance", self.tolerance, 0.0, most, ends="(]", degrees=True)
        check_choice("grip", self.grip, Grip)
        low, high = self.min_opening, self.max_opening
        if not (0.0 <= low <= high and low < math.inf and high > 0.0):
            low_text, high_text = map(describe_length, (low, high))
            raise SettingError(
                "openings must satisfy 0 <= min_opening <= max_opening, and max_opening above 0; "
                f"got {low_text} and {high_text}"
            )
        check_range("rays", self.rays, MIN_RAYS, MAX_RAYS)
        check_range("candidates", self.candidates, MIN_CANDIDATES, MAX_CANDIDATES)
        check_choice("candidate points", self.candidate_points, CandidatePoints)
        check_range("seed", self.seed, 0, LARGEST_SEED)


GivenSampling: TypeAlias = Sampling | Mapping[str, Any] | None
"""Settings of a search as functions take them; a dict of their fields is accepted, too."""


def check_search_settings(model: GraspModel, sampling: Sampling) -> None:
    """Refuse too few or too many fingers, and three or more fingers that push apart.

    Raises:
        SettingError: The number of fingers is refused.
    """
    check_range("fingers", model.fingers, 2, MAX_SEARCHED_FINGERS)
    if model.fingers > 2 and sampling.grip != "squeeze":
        raise SettingError(f"grip {sampling.grip} is for two fingers; got {model.fingers}")


def search_cone(model: GraspModel, sampling: Sampling | None = None) -> float:
    """Largest critical friction angle that is searched for [rad].

    For two fingers it is the half-angle of the cone of directions that are searched for opposing
    contacts. A contact in a direction at beta + alpha/2 or more from the normal makes no grasp
    better than U, so no ray is needed there.

    Args:
        model: Friction and sensor resolution.
        sampling: Settings of the search; None: there is no search angle.
    """
    if sampling is not None and sampling.search_angle is not None:
        return sampling.search_angle
    return min(model.possible_angle, math.pi / 2.0)


def check_search_angle(sampling: Sampling, needed: float) -> None:
    """Refuse a search angle that is too small for the largest friction and resolution.

    Raises:
        SettingError: The search angle is too small.
    """
    angle = sampling.search_angle
    if angle is not None and angle < needed - ANGLE_ROUNDING:
        raise SettingError(
            "search angle must be at least atan(friction) + alpha/2 for the largest friction and "
            f"alpha, {math.degrees(needed):.4g} degrees; got {math.degrees(angle):.4g}"
        )


def not_covered(what: str, needed: float, searched: float) -> SearchCoverageError:
    """Return the error for an angle [rad] beyond the one up to which grasps were searched."""
    return SearchCoverageError(
        f"{what} is {math.degrees(needed):.4g} degrees, but grasps were searched only up to "
        f"{math.degrees(searched):.4g}; label the surface again with "
        f"Sampling(search_angle={min(needed, math.pi / 2.0):.4g})"
    )


BASE = 0.3
"""Memory of a process that labels a very small mesh [GB]."""

PER_VERTEX = 1.6e-6, 1.2e-6
"""Memory for each vertex [GB]: for two fingers, and for each further finger."""

SECONDS = {2: 1e-4, 3: 1.1e-3, 4: 2.5e-3, 5: 3e-3}
"""Time for each vertex with the default search, for labels and epsilon, on one processor [s]."""


@dataclass(frozen=True)
class Cost:
    """Expected cost of labelling a mesh with exact labels, within a factor of about two."""

    memory: float
    """Largest memory of the process [GB]."""
    seconds: float
    """Time without compilation [s]."""
    more: bool
    """Whether it takes several times as long as `seconds`, for hulls at extreme normals or epsilon
    of soft fingers."""


def labelling_cost(
    vertices: int, model: GraspModel, sampling: Sampling, *, threads: int = 1
) -> Cost:
    """Estimate the cost of the labels and epsilon of a surface.

    Args:
        vertices: Number of vertices after refinement.
        model: The model, of which mainly the number of fingers matters.
        sampling: The search, of which `candidates` matters, and `rays` unless two fingers squeeze.
        threads: Number of processors used.
    """
    fingers = min(model.fingers, max(SECONDS))
    if fingers > 2:
        effort = sampling.candidates / Sampling.candidates
    else:  # fingers that squeeze use branch and bound, without rays
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
        remedy: Advice other than to raise the limit, for the message.
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
