"""Lengths and abilities of a parallel gripper: two fingers that move along one axis, a palm."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain
from typing import TYPE_CHECKING, Self

from grasp3d.contact.sensor import Sensor
from grasp3d.errors import SettingError
from grasp3d.settings import GraspModel, Radians
from grasp3d.system.documents import check_text, described, number_of

if TYPE_CHECKING:
    from grasp3d.arrays import Floats
    from grasp3d.settings.sampling import Grip

Corners = tuple[tuple[float, float, float], ...]
"""Corners of a face in the gripper's frame [m]."""

MOST_CORNERS = 12
"""Most corners of a face."""

FLATNESS = 1e-4
"""Largest distance of a corner from the plane of its face [m]."""

LARGEST_COORDINATE = 1.0
"""Largest coordinate of a corner [m]."""

LARGEST = 10.0
"""Largest length of a gripper [m]: more is a length in millimetres."""

POSITIVE = (
    "max_opening", "finger_thickness", "finger_width", "finger_length", "palm_thickness",
    "palm_width", "palm_length",
)  # fmt: skip
LENGTHS = (
    "min_opening", "pad_width", "pad_height", "tip_radius", "compliance", "clearance",
    "base_to_tcp",
)  # fmt: skip
"""Lengths of a gripper: those that are above 0, and the others."""

AT_MOST = (
    ("min_opening", "max_opening"), ("pad_width", "finger_width"),
    ("pad_height", "finger_length"), ("max_opening", "palm_thickness"),
)  # fmt: skip
"""Lengths that are at most as large as others."""

UNIFORM_PRESSURE = 2.0 / 3.0
"""Torsional moment of an evenly pressed disc, per friction, normal force and radius."""


AXES: dict[str, tuple[float, float, float]] = {
    "x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0),
    "-x": (-1.0, 0.0, 0.0), "-y": (0.0, -1.0, 0.0), "-z": (0.0, 0.0, -1.0),
}  # fmt: skip
"""Unit vectors of the axes of a hand's own frame, by name."""


@dataclass(frozen=True, kw_only=True)
class Jaws:
    """Fingers with flat pads or round tips that move along one axis, and a palm; lengths in metres.

    The frame, and what each field means, are those of `ParallelGripper`.
    """

    name: str
    max_opening: float
    min_opening: float = 0.0
    finger_thickness: float
    finger_width: float
    finger_length: float
    pad_width: float = 0.0
    pad_height: float = 0.0
    tip_radius: float = 0.0
    inner_faces: tuple[Corners, ...] = ()
    tip_thickness: float | None = None
    palm_thickness: float
    palm_width: float
    palm_length: float
    compliance: float = 0.001
    clearance: float = 0.002
    max_force: float | None = None
    sensor_resolution: Radians | None = None
    receptive_field: float | None = None
    base_to_tcp: float = 0.0
    base_axes: tuple[str, str] = ("x", "z")
    joint_names: tuple[str, ...] = ()
    joint_scale: tuple[float, ...] = ()
    joint_closed: tuple[float, ...] = ()
    source: str = ""

    def opening_to(self, opening: float) -> Self:
        """The same gripper with another stroke [m], and a palm that is wide enough for it."""
        palm = max(opening, self.palm_thickness)
        return replace(self, max_opening=opening, palm_thickness=palm)

    def __post_init__(self) -> None:
        for problem in chain(self._wrong_sizes(), self._wrong_tips(), self._wrong_frame()):
            raise SettingError(f"gripper {self.name!r}: {problem}")
        if self.receptive_field is not None:
            Sensor(self.receptive_field, self.tip_radius)
        if self.sensor_resolution is not None:
            GraspModel(sensor_resolution=self.sensor_resolution)

    def _wrong_sizes(self) -> Iterator[str]:
        """Sizes that cannot be, or contradict each other, one sentence each."""
        for name in (*POSITIVE, *LENGTHS):
            yield from problems_of_length(name, getattr(self, name), positive=name in POSITIVE)
        for small, large in AT_MOST:
            few, most = getattr(self, small), getattr(self, large)
            if few > most:
                yield f"{small} ({few:g}) must be at most {large} ({most:g})"
        stroke = self.max_opening - self.min_opening
        if not 2.0 * self.clearance < stroke:
            yield (
                f"the stroke of {stroke:g} m must be larger than the clearance on both sides, "
                f"2 x {self.clearance:g} m"
            )
        most = self.finger_thickness
        if self.tip_thickness is not None and not 0 < self.tip_thickness <= most:
            yield f"tip_thickness must be above 0 and at most finger_thickness ({most:g} m)"

    def _wrong_tips(self) -> Iterator[str]:
        """What fingertips cannot be, one sentence each."""
        flat, thick, diameter = not self.round_tips, self.finger_thickness, 2.0 * self.tip_radius
        if flat != (self.pad_width > 0.0 and self.pad_height > 0.0):
            yield "it needs either flat pads (pad_width and pad_height) or round tips (tip_radius)"
        if not flat and thick > diameter:
            most = f"the diameter of the round tips, {diameter:g}"
            yield f"finger_thickness ({thick:g}) must be at most {most}"
        if not flat and self.inner_faces:
            yield "inner_faces are those of flat pads; round tips have none"
        for number, face in enumerate(self.inner_faces, start=1):
            if problem := problem_of_face(face):
                yield f"face {number} of inner_faces {problem}"
        if self.max_force is not None and not 0.0 < self.max_force < math.inf:
            yield f"max_force must be a finite force above 0 [N]; got {self.max_force:g}"
        if self.receptive_field is not None and (flat or self.sensor_resolution is not None):
            yield "a receptive_field needs round tips (tip_radius), and replaces sensor_resolution"

    def _wrong_frame(self) -> Iterator[str]:
        """Texts that are none, axes that are no frame, joints without numbers."""
        for text in (self.name, self.source, *self.joint_names):
            try:
                check_text(text)
            except ValueError as error:
                yield str(error)
        one, two = self.base_axes if len(self.base_axes) == 2 else ("", "")
        if not {one, two} <= AXES.keys() or one[-1] == two[-1]:
            names, got = ", ".join(AXES), [*self.base_axes]
            yield f"base_axes must be two axes at right angles of {names}; got {got}"
        count = len(self.joint_names)
        if not len(self.joint_scale) == len(self.joint_closed) == count:
            what = f"a number for each of the {count} joint_names"
            yield f"joint_scale and joint_closed must have {what}"

    @property
    def round_tips(self) -> bool:
        """Whether the fingers have round tips instead of flat pads."""
        return self.tip_radius > 0.0

    @property
    def end(self) -> float:
        """Position of the fingers' ends along z, relative to the TCP [m]."""
        return 0.0 if self.round_tips else 0.5 * self.pad_height

    @property
    def limits(self) -> tuple[float, float]:
        """Smallest and largest opening that a grasp may have, with clearance on both sides [m]."""
        return self.min_opening, self.max_opening - 2.0 * self.clearance

    @property
    def size(self) -> float:
        """About how large the whole gripper is [m]."""
        return self.finger_length + self.palm_length + self.palm_thickness

    def distances(self, grip: "Grip") -> tuple[float, float]:
        """Smallest and largest distance of the contacts of a grasp that may be reached [m].

        The stroke allows no others; round tips that touch at an angle are nearer to each other, and
        contacts of internal grasps have the fingers between them.

        Args:
            grip: How the fingers may press.
        """
        inside = 0.0 if grip == "squeeze" else 2.0 * self.finger_thickness
        least, most = self.limits
        return least, most + inside + 2.0 * self.tip_radius

    @property
    def base_pose(self) -> "Floats":
        """Matrix that takes coordinates of the hand's own frame to the gripper's, shape (4, 4).

        Its translation is in metres.
        """
        import numpy as np

        closing, approach = (np.array(AXES[name]) for name in self.base_axes)
        pose = np.eye(4)
        pose[:3, :3] = np.stack([closing, np.cross(approach, closing), approach])
        pose[2, 3] = -self.base_to_tcp
        return pose

    @property
    def touch_area(self) -> float:
        """Area of a pad, or of the cap of a round tip that its compliance presses in [m^2]."""
        if self.round_tips:
            return 2.0 * math.pi * self.tip_radius * self.compliance
        return self.pad_width * self.pad_height

    def torsion_radius(self, friction: float) -> float:
        """Torsion radius of a pad that touches with its whole area [m]; 0 for round tips.

        That of an evenly pressed disc of the pad's area: 2/3 x friction x radius. A real contact
        is smaller, and holds less.

        Args:
            friction: Coulomb coefficient, above 0.
        """
        radius = math.sqrt(self.pad_width * self.pad_height / math.pi)
        return UNIFORM_PRESSURE * friction * radius


def problems_of_length(name: str, value: object, *, positive: bool) -> Iterator[str]:
    """Why a value is no length of a gripper, in metres; positive: nor may it be 0."""
    metres = math.nan if isinstance(value, str) else number_of(value)
    if not 0.0 <= metres < math.inf:
        yield f"{name} must be a length in metres of at least 0; got {described(value)}"
    if positive and metres == 0.0:
        yield f"{name} must be above 0"
    if metres > LARGEST:
        yield (
            f"{name} must be in metres, at most {LARGEST:g}; got {metres:g}: is it in millimetres?"
        )


IN_METRES = "hands and grippers are given in metres"
"""Why the unit of a mesh must be known where there is one, for errors."""


def problem_of_face(face: Corners) -> str | None:
    """What keeps a face from being one that a jaw touches with; None: nothing does.

    Args:
        face: Its corners in order, as in `ParallelGripper.inner_faces`.

    Example:
        >>> from grasp3d.hand.jaws import problem_of_face
        >>> print(problem_of_face(((0.0, 0.0, 0.0), (0.0, 0.01, 0.0), (0.001, 0.0, 0.01))))
        has a corner with x = 0.001; it must be at most 0, behind the plane of the pad
    """
    if not 3 <= len(face) <= MOST_CORNERS:
        return f"must have 3 to {MOST_CORNERS} corners; got {len(face)}"
    if any(len(corner) != 3 for corner in face):
        return "must have corners of three numbers, x, y and z"
    if not all(abs(value) <= LARGEST_COORDINATE for corner in face for value in corner):
        return f"must have coordinates in metres, at most {LARGEST_COORDINATE:g}"
    if (behind := max(corner[0] for corner in face)) > 0.0:
        return (
            f"has a corner with x = {behind:g}; it must be at most 0, behind the plane of the pad"
        )
    return _problem_of_outline(face)


def _problem_of_outline(face: Corners) -> str | None:
    """Whether a face is flat, and convex seen along x."""
    turns = [_turn(face, i) for i in range(len(face))]
    if not (min(turns) > 0.0 or max(turns) < 0.0):
        return "must be convex, with its corners in order and none on a side"
    (x0, y0, z0), (x1, y1, z1), (x2, y2, z2) = face[:3]
    for x, y, z in face[3:]:
        a = ((y - y0) * (z2 - z0) - (z - z0) * (y2 - y0)) / turns[1]
        b = ((y1 - y0) * (z - z0) - (z1 - z0) * (y - y0)) / turns[1]
        off = x - x0 - a * (x1 - x0) - b * (x2 - x0)
        if abs(off) > FLATNESS:
            return f"must be flat; a corner is {1e3 * abs(off):.3g} mm off the plane of the others"
    return None


def _turn(face: Corners, i: int) -> float:
    """Twice the signed area of the triangle of a corner and its neighbours, seen along x."""
    (_, ay, az), (_, by, bz), (_, cy, cz) = face[i - 1], face[i], face[(i + 1) % len(face)]
    return (by - ay) * (cz - bz) - (bz - az) * (cy - by)
