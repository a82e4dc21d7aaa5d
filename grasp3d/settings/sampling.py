"""How candidate grasps are searched for: pairs of contacts, or contacts of more fingers."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Annotated, Any, ClassVar, Literal, Self, TypeAlias

from grasp3d.errors import SearchCoverageError, SettingError
from grasp3d.settings.checks import check_choice, check_range, check_seed
from grasp3d.settings.grasp_model import (
    MAX_SEARCHED_FINGERS,
    GraspModel,
)
from grasp3d.settings.parsing import IN_PYTHON, Group, Main
from grasp3d.settings.units import Length, LengthSettings, Radians, describe_length

Grip = Literal["squeeze", "expand", "both"]
CandidatePoints = Literal["surface", "vertices"]
MIN_RAYS, MAX_RAYS = 8, 65_536
MIN_CANDIDATES, MAX_CANDIDATES = 8, 4096
ANGLE_ROUNDING = 1e-9
"""Angle by which a cone may exceed the cone that was searched and still count as covered [rad]."""


@dataclass(frozen=True)
class SearchSettings(LengthSettings):
    """How far, and how finely, candidate grasps of any number of fingers are searched for.

    Attributes:
        search_angle: Largest critical friction angle that is searched for, up to 90 degrees; for
            two fingers the half-angle of the cone of directions about the inward normal. none: just
            what friction and resolution need. Wider: the surface can be labelled again, without a
            new search, for any friction and resolution with atan(friction) + alpha/2 up to this
            angle. Narrower: a limit to the search.
        tolerance: How fine the search is, no error of sensor or gripper: step size at which it
            stops around a vertex's best grasp, where it is by rays or random steps.
    """

    span: ClassVar[str]
    """What the distance between the contacts of a grasp is called."""

    least: ClassVar[str]
    """Name of the field with its smallest value."""

    search_angle: Annotated[Radians | None, IN_PYTHON] = None
    tolerance: Annotated[Radians, IN_PYTHON] = 1e-3

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.search_angle is not None:
            most = math.pi / 2.0
            check_range("search angle", self.search_angle, 0.0, most, ends="(]", degrees=True)
        most = math.radians(5.0)
        check_range("tolerance", self.tolerance, 0.0, most, ends="(]", degrees=True)

    @classmethod
    def own_names(cls) -> tuple[str, ...]:
        """Names of the fields for this number of fingers alone."""
        return tuple(one.name for one in fields(cls) if one.name not in _COMMON)

    @property
    def own_changes(self) -> tuple[str, ...]:
        """Those of them that differ from their defaults."""
        defaults = type(self)()
        return tuple(
            name for name in self.own_names() if getattr(self, name) != getattr(defaults, name)
        )

    @property
    def common(self) -> dict[str, Any]:
        """The values of the fields for any number of fingers, by name."""
        return {name: getattr(self, name) for name in _COMMON}

    def fitted(self, fingers: int) -> "AnySampling":
        """Settings for a number of fingers: these, or where they are for another, the defaults.

        Those have the same fields for any number of fingers.

        Raises:
            SettingError: A field differs from its default that does not apply.
        """
        kind = sampling_kind(fingers)
        if isinstance(self, kind):
            return self
        if self.own_changes:
            raise SettingError(
                f"{self.own_changes[0]} does not apply to {fingers} fingers; use one of "
                f"{', '.join(kind.own_names())}"
            )
        return kind(**self.common)

    def limited(self, most: float) -> Self:
        """The same search, for contacts within another distance of each other.

        Args:
            most: The largest distance.
        """
        least = getattr(self, self.least)
        least = None if least is None else min(least, most)
        limits: dict[str, Any] = {self.least: least, "max_opening": most}
        return replace(self, **limits)


_COMMON = (*(one.name for one in fields(SearchSettings)), "max_opening")
"""Names of the fields for any number of fingers."""


@dataclass(frozen=True)
class Sampling(SearchSettings):
    """How candidate grasps of two fingers are searched for.

    A length is in metres, or has a unit: '80mm', '8cm', '3in'; see `Length`.

    It has a search angle and a tolerance as well, see `SearchSettings`.

    Attributes:
        rays: Two fingers: directions tested from every vertex before the search is refined, 8 to
            65536. Fingers that squeeze need few: branch and bound searches the whole surface.
        grip: Two fingers. squeeze: they are outside, pushing toward each other; expand: inside a
            ring or a mug, pushing apart; both: whichever is better.
        min_opening: Two fingers: smallest distance between the contacts, a length.
        max_opening: Largest distance between any two contacts, a length: the gripper's stroke, or
            the reach of the robot's hand.

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
    """

    span: ClassVar[str] = "opening"
    least: ClassVar[str] = "min_opening"

    rays: Annotated[int, IN_PYTHON] = 64
    grip: Grip = "squeeze"
    min_opening: Annotated[Length[float], Group("hand")] = Length(0.0)
    max_opening: Annotated[
        Length[float], Group("hand"), Main("stroke of the gripper, such as 80mm")
    ] = Length(math.inf)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("rays", self.rays, MIN_RAYS, MAX_RAYS)
        check_choice("grip", self.grip, Grip)
        _check_limits("openings", self)


@dataclass(frozen=True)
class MultifingerSampling(SearchSettings):
    """How candidate grasps of three fingers and more are searched for.

    A length is in metres, or has a unit: '80mm', '8cm', '3in'; see `Length`.

    It has a search angle and a tolerance as well, see `SearchSettings`.

    Attributes:
        candidates: Three fingers and more: candidate points for every other finger before the
            search is refined, spread evenly over the surface within reach of a vertex, 8 to 4096.
            If candidate points are vertices, all of them are tested where there are at most four
            times as many.
        min_separation: Three fingers and more: smallest distance between any two contacts, a
            length; none: 1/100 of the object's size, but at most 1/10 of max_opening.
        max_opening: Largest distance between any two contacts, a length: the reach of the hand.
        candidate_points: Three fingers and more: where the other fingers may be. surface: anywhere
            on it; vertices: at the mesh's vertices only.
        seed: Three fingers and more: random seed of the candidate points and of the search; the
            same seed gives the same labels.

    Example:
        A hand that spans 150 mm, on a ball:

        >>> import trimesh
        >>> import grasp3d
        >>> sampling = grasp3d.MultifingerSampling(max_opening="150mm", candidates=16)
        >>> ball = grasp3d.load_mesh(trimesh.creation.icosphere(1, 0.04), unit="m", max_edge=0.1)
        >>> labels = grasp3d.label_surface(ball, grasp3d.GraspModel(fingers=3), sampling=sampling)
        >>> labels.sampling.max_opening, labels.partners.shape
        (0.15, (42, 2, 3))
    """

    span: ClassVar[str] = "spread"
    least: ClassVar[str] = "min_separation"

    candidates: int = 64
    min_separation: Length[float | None] = Length(None)
    max_opening: Length[float] = Length(math.inf)
    candidate_points: CandidatePoints = "surface"
    seed: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("candidates", self.candidates, MIN_CANDIDATES, MAX_CANDIDATES)
        _check_limits("distances", self)
        check_choice("candidate points", self.candidate_points, CandidatePoints)
        check_seed("seed", self.seed)


AnySampling: TypeAlias = Sampling | MultifingerSampling
"""Settings of a search, for the number of fingers of its grasps."""


GivenSampling: TypeAlias = AnySampling | Mapping[str, Any] | None
"""Settings of a search as functions take them: also a dict of their fields."""


def sampling_kind(fingers: int) -> type[AnySampling]:
    """The class of the settings of a search for a number of fingers."""
    return Sampling if fingers == 2 else MultifingerSampling


def given_sampling(model: GraspModel, sampling: GivenSampling) -> AnySampling | None:
    """Settings of a search for a model as functions take them; see `Settings.given`."""
    if sampling is None or isinstance(sampling, SearchSettings):
        return sampling
    return sampling_kind(model.fingers).given("sampling", sampling)


def check_search_settings(model: GraspModel, sampling: AnySampling) -> None:
    """Refuse settings of a search for another number of fingers.

    Raises:
        SettingError: Too few or too many fingers, or settings for another number.
    """
    check_range("fingers", model.fingers, 2, MAX_SEARCHED_FINGERS)
    kind = sampling_kind(model.fingers)
    if not isinstance(sampling, kind):
        names = ", ".join(one.name for one in fields(kind))
        raise SettingError(
            f"sampling for {model.fingers} fingers must be {kind.__name__}(...), with {names}; "
            f"got {type(sampling).__name__}(...)"
        )


def search_cone(model: GraspModel, sampling: AnySampling | None = None) -> float:
    """Largest critical friction angle that is searched for [rad].

    For two fingers it is the half-angle of the cone of directions in which opposing contacts are
    searched for: one in a direction beta + alpha/2 or more from the normal makes no grasp better
    than U, so no ray is needed there.

    Args:
        model: Friction and sensor resolution.
        sampling: Settings of the search; None: without a search angle.
    """
    if sampling is not None and sampling.search_angle is not None:
        return sampling.search_angle
    return min(model.possible_angle, math.pi / 2.0)


def check_search_angle(sampling: AnySampling, needed: float, of: str = "") -> None:
    """Refuse a search angle that is less than that of the largest friction and resolution.

    Raises:
        SettingError: It is.
    """
    angle = sampling.search_angle
    if angle is not None and angle < needed - ANGLE_ROUNDING:
        raise SettingError(
            "search angle must be at least atan(friction) + alpha/2 for the largest friction and "
            f"alpha{of}, {math.degrees(needed):.4g} degrees; got {math.degrees(angle):.4g}"
        )


def not_covered(what: str, needed: float, searched: float, fingers: int) -> SearchCoverageError:
    """The error of an angle that exceeds the one up to which grasps were searched, in radians."""
    return SearchCoverageError(
        f"{what} is {math.degrees(needed):.4g} degrees, but grasps were searched only up to "
        f"{math.degrees(searched):.4g}; label the surface again with "
        f"{sampling_kind(fingers).__name__}(search_angle={min(needed, math.pi / 2.0):.4g})"
    )


def _check_limits(what: str, sampling: AnySampling) -> None:
    """Refuse limits of a distance that no distance meets."""
    least = sampling.least
    limits = getattr(sampling, least), sampling.max_opening
    low, high = limits[0] or 0.0, limits[1]
    if not (0.0 <= low <= high and low < math.inf and high > 0.0):
        low_text, high_text = map(describe_length, limits)
        raise SettingError(
            f"{what} must satisfy 0 <= {least} <= max_opening, and max_opening above 0; got "
            f"{low_text} and {high_text}"
        )
