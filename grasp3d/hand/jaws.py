"""Lengths and limits of a parallel gripper: two fingers that move along one axis, and a palm."""

import json
import math
from collections.abc import Iterator
from dataclasses import MISSING, dataclass, fields, replace
from itertools import chain
from typing import Any, Self, get_type_hints

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.errors import SettingError
from grasp3d.hand.choices import AXES
from grasp3d.settings import GraspModel, Radians
from grasp3d.system.documents import check_text, typed

Corners = tuple[tuple[float, float, float], ...]
"""Corners of a face in the gripper's frame [m]."""

MOST_CORNERS = 12
"""Most corners of a face."""

FLATNESS = 1e-4
"""Largest distance of a corner from the plane of its face [m]."""

LARGEST_COORDINATE = 1.0
"""Largest coordinate of a corner [m]."""

LARGEST = 10.0
"""Largest length of a gripper [m]; a larger one is probably in millimetres."""

AT_MOST = (
    ("min_opening", "max_opening"), ("pad_width", "finger_width"),
    ("pad_height", "finger_length"), ("max_opening", "palm_thickness"),
)  # fmt: skip
"""Pairs of lengths, of which the first must not exceed the second."""

UNIFORM_PRESSURE = 2.0 / 3.0
"""Torsional moment of an evenly pressed disc, per friction, normal force and radius."""

_KINDS: dict[Any, str] = {
    str: "a text",
    float: "a number",
    float | None: "a number or null",
    tuple[str, ...]: "a list of texts",
    tuple[str, str]: "a list of two texts",
    tuple[float, ...]: "a list of numbers",
    tuple[Corners, ...]: "a list of faces, each a list of corners [x, y, z]",
}
"""Descriptions of the types of fields."""

IN_METRES = "hands and grippers are given in metres"
"""Why the unit of a mesh must be known where there is a hand, for error messages."""


@dataclass(frozen=True, kw_only=True)
class Jaws:
    """Fingers with flat pads or round tips that move along one axis, and a palm; lengths in metres.

    `ParallelGripper` describes the frame and the fields.
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
        for name, kind in get_type_hints(Jaws).items():
            try:
                object.__setattr__(self, name, typed(value := getattr(self, name), kind))
            except (TypeError, OverflowError) as error:
                got = json.dumps(value, default=repr)[:40]
                problem = f"gripper {self.name!r}: {name} must be {_KINDS[kind]}; got {got}"
                raise SettingError(problem) from error
        for problem in chain(self._wrong_sizes(), self._wrong_tips(), self._wrong_frame()):
            raise SettingError(f"gripper {self.name!r}: {problem}")
        if self.sensor_resolution is not None:
            GraspModel(sensor_resolution=self.sensor_resolution)

    def _wrong_sizes(self) -> Iterator[str]:
        """Yield a sentence for each length that is impossible or contradicts another."""
        for field in (one for one in fields(self) if one.type is float):
            name, metres = field.name, getattr(self, field.name)
            if not 0.0 <= metres < math.inf:
                yield f"{name} must be a length in metres of at least 0; got {metres:g}"
            if metres == 0.0 and field.default is MISSING:
                yield f"{name} must be above 0"
            if metres > LARGEST:
                largest = f"in metres, at most {LARGEST:g}; got {metres:g}"
                yield f"{name} must be {largest}: is it in millimetres?"
        for small, large in AT_MOST:
            few, most = getattr(self, small), getattr(self, large)
            if few > most:
                yield f"{small} ({few:g} m) must be at most {large} ({most:g} m)"
        stroke, least = self.max_opening - self.min_opening, f"2 x {self.clearance:g} m"
        if not 2.0 * self.clearance < stroke:
            least = f"larger than the clearance on both sides, {least}"
            yield f"the stroke of {stroke:g} m must be {least}"

    def _wrong_tips(self) -> Iterator[str]:
        """Yield a sentence for each fault of the fingertips, faces and force."""
        thick, tip, diameter = self.finger_thickness, self.tip_thickness, 2.0 * self.tip_radius
        if tip is not None and not 0 < tip <= thick:
            yield f"tip_thickness must be above 0 and at most finger_thickness ({thick:g} m)"
        if self.round_tips and thick > diameter:
            limit = f"the diameter of the round tips, {diameter:g} m"
            yield f"finger_thickness ({thick:g} m) must be at most {limit}"
        if self.round_tips == (self.pad_width > 0.0 and self.pad_height > 0.0):
            yield "it needs either flat pads (pad_width and pad_height) or round tips (tip_radius)"
        if self.round_tips and self.inner_faces:
            yield "inner_faces are those of flat pads; round tips have none"
        for number, face in enumerate(self.inner_faces, start=1):
            yield from (f"face {number} of inner_faces {one}" for one in _problems_of_face(face))
        if self.max_force is not None and not 0.0 < self.max_force < math.inf:
            yield f"max_force must be a finite force above 0 N; got {self.max_force:g}"

    def _wrong_frame(self) -> Iterator[str]:
        """Yield a sentence for each fault of the texts, axes and joints."""
        for text in (self.name, self.source, *self.joint_names):
            try:
                check_text(text)
            except ValueError as error:
                yield str(error)
        axes, count = self.base_axes, len(self.joint_names)
        if len({axis[-1] for axis in axes if axis in AXES}) != 2:
            yield f"base_axes must be two axes at right angles of {', '.join(AXES)}; got {[*axes]}"
        if not len(self.joint_scale) == len(self.joint_closed) == count:
            numbers = f"a number for each of the {count} joint_names"
            yield f"joint_scale and joint_closed must have {numbers}"

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
        """Approximate size of the whole gripper [m]."""
        return self.finger_length + self.palm_length + self.palm_thickness

    def distances(self) -> tuple[float, float]:
        """Smallest and largest distance between the contacts of a grasp that can be reached [m].

        They follow from the stroke; round tips that touch at an angle are closer than the contacts.
        """
        least, most = self.limits
        return least, most + 2.0 * self.tip_radius

    @property
    def base_pose(self) -> Floats:
        """Matrix from the hand's own frame to the gripper's [m], shape (4, 4)."""
        closing, approach = (np.array(AXES[name]) for name in self.base_axes)
        pose = np.eye(4)
        pose[:3, :3] = np.stack([closing, np.cross(approach, closing), approach])
        pose[2, 3] = -self.base_to_tcp
        return pose

    def check_fingers(self, count: int) -> None:
        """Check that grasps have two fingers.

        Raises:
            SettingError: The number is not two.
        """
        if count != 2:
            raise SettingError(f"{self.name!r} has two fingers, not {count} (--fingers)")

    @property
    def touch_area(self) -> float:
        """Area of a pad, or of the cap of a round tip that its compliance presses in [m^2]."""
        if self.round_tips:
            return 2.0 * math.pi * self.tip_radius * self.compliance
        return self.pad_width * self.pad_height

    def torsion_radius(self, friction: float) -> float:
        """Torsion radius of a pad that touches with its whole area [m]; 0 for round tips.

        It is that of an evenly pressed disc with the pad's area: 2/3 x friction x radius. A real
        contact is smaller and holds less.

        Args:
            friction: Coulomb coefficient, above 0.
        """
        radius = math.sqrt(self.pad_width * self.pad_height / math.pi)
        return UNIFORM_PRESSURE * friction * radius


def _problems_of_face(face: Corners) -> Iterator[str]:
    """Yield a phrase for each fault of a face of `ParallelGripper.inner_faces`."""
    if not 3 <= len(face) <= MOST_CORNERS:
        yield f"must have 3 to {MOST_CORNERS} corners; got {len(face)}"
    if any(len(corner) != 3 for corner in face):
        yield "must have corners of three numbers, x, y and z"
    points = np.array(face, dtype=np.float64)
    if not (np.abs(points) <= LARGEST_COORDINATE).all():
        yield f"must have coordinates in metres, at most {LARGEST_COORDINATE:g}"
    if (behind := points[:, 0].max()) > 0.0:
        yield f"has a corner with x = {behind:g}; it must be at most 0, behind the plane of the pad"
    before, after = points - np.roll(points, 1, axis=0), np.roll(points, -1, axis=0) - points
    turns = before[:, 1] * after[:, 2] - before[:, 2] * after[:, 1]
    if not (turns.min() > 0.0 or turns.max() < 0.0):
        yield "must be convex, with its corners in order and none on a side"
    columns = np.column_stack([np.ones(len(points)), points[:, 1:]])
    plane = np.linalg.solve(columns[:3], points[:3, 0])
    if (off := np.abs(points[:, 0] - columns @ plane).max()) > FLATNESS:
        yield f"must be flat; a corner is {1e3 * off:.3g} mm off the plane of the others"
