"""Stroke and shape of a parallel gripper: two fingers that move along one axis, and a palm."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from grasp3d.errors import SettingError
from grasp3d.hand.finger_faces import Corners, problem_of_face

if TYPE_CHECKING:
    from grasp3d.settings.sampling import Grip

LARGEST = 10.0
"""Largest length of a gripper [m]: more is a length in millimetres."""

UNIFORM_PRESSURE = 2.0 / 3.0
"""Torsional moment of an evenly pressed disc, per friction, normal force and radius."""


@dataclass(frozen=True, kw_only=True)
class Jaws:
    """Fingers with flat pads or round tips that move along one axis, and a palm [m].

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

    def __post_init__(self) -> None:
        for name in (
            "max_opening", "finger_thickness", "finger_width", "finger_length", "palm_thickness",
            "palm_width", "palm_length",
        ):  # fmt: skip
            check_metres(self.name, name, getattr(self, name), positive=True)
        for name in (
            "min_opening", "pad_width", "pad_height", "tip_radius", "compliance", "clearance",
        ):  # fmt: skip
            check_metres(self.name, name, getattr(self, name))
        self._check_sizes()

    def _check_sizes(self) -> None:
        """Refuse sizes that contradict each other."""
        for small, large in (
            ("min_opening", "max_opening"), ("pad_width", "finger_width"),
            ("pad_height", "finger_length"), ("max_opening", "palm_thickness"),
        ):  # fmt: skip
            if getattr(self, small) > getattr(self, large):
                raise SettingError(
                    f"gripper {self.name!r}: {small} ({getattr(self, small):g}) must be at most "
                    f"{large} ({getattr(self, large):g})"
                )
        if not self.min_opening + 2.0 * self.clearance < self.max_opening:
            raise SettingError(
                f"gripper {self.name!r}: the stroke of {self.max_opening - self.min_opening:g} m "
                f"must be larger than the clearance on both sides, 2 x {self.clearance:g} m"
            )
        if self.tip_thickness is not None and not 0 < self.tip_thickness <= self.finger_thickness:
            raise SettingError(
                f"gripper {self.name!r}: tip_thickness must be above 0 and at most "
                f"finger_thickness ({self.finger_thickness:g} m); got {self.tip_thickness:g}"
            )
        self._check_inner_faces()
        flat = self.tip_radius == 0.0
        if flat != (self.pad_width > 0.0 and self.pad_height > 0.0):
            raise SettingError(
                f"gripper {self.name!r}: it needs either flat pads (pad_width and pad_height) or "
                "round tips (tip_radius)"
            )
        if not flat and self.finger_thickness > 2.0 * self.tip_radius:
            raise SettingError(
                f"gripper {self.name!r}: finger_thickness ({self.finger_thickness:g}) must be at "
                f"most the diameter of the round tips, {2.0 * self.tip_radius:g}"
            )

    def _check_inner_faces(self) -> None:
        """Refuse faces that are not those of a finger with flat pads."""
        if self.inner_faces and self.tip_radius:
            raise SettingError(
                f"gripper {self.name!r}: inner_faces are those of flat pads; round tips have none"
            )
        for number, face in enumerate(self.inner_faces, start=1):
            problem = problem_of_face(face)
            if problem:
                raise SettingError(f"gripper {self.name!r}: face {number} of inner_faces {problem}")

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


def check_metres(gripper: str, name: str, value: object, *, positive: bool = False) -> None:
    """Refuse what is no length of a gripper.

    Args:
        gripper: Name of the gripper.
        name: Name of the length.
        value: The length [m].
        positive: Whether 0 is refused, too.

    Raises:
        SettingError: It is no length in metres.
    """
    if not (isinstance(value, int | float) and math.isfinite(value) and value >= 0.0):
        raise SettingError(
            f"gripper {gripper!r}: {name} must be a length in metres of at least 0; got {value!r}"
        )
    if positive and value == 0.0:
        raise SettingError(f"gripper {gripper!r}: {name} must be above 0")
    if value > LARGEST:
        raise SettingError(
            f"gripper {gripper!r}: {name} must be in metres, at most {LARGEST:g}; "
            f"got {value:g}: is it in millimetres?"
        )
