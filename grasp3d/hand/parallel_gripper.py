"""Grippers of two fingers that move along one axis."""

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from grasp3d.contact.sensor import Sensor
from grasp3d.errors import SettingError
from grasp3d.hand.finger_faces import Corners, problem_of_face
from grasp3d.settings import GraspModel, Radians

if TYPE_CHECKING:
    from grasp3d.arrays import Floats

LARGEST = 10.0
"""Largest length of a gripper [m]: more is a length in millimetres."""

AXES: dict[str, tuple[float, float, float]] = {
    "x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0),
    "-x": (-1.0, 0.0, 0.0), "-y": (0.0, -1.0, 0.0), "-z": (0.0, 0.0, -1.0),
}  # fmt: skip
"""Unit vectors of the axes of a hand's own frame, by name."""

UNIFORM_PRESSURE = 2.0 / 3.0
"""Torsional moment of an evenly pressed disc, per friction, normal force and radius."""


@dataclass(frozen=True, kw_only=True)
class ParallelGripper:
    """A gripper of two fingers that move along one axis; lengths in metres.

    Its frame has the origin at the tool centre point (TCP), midway between the centres of the pads,
    or of round tips; z is the approach direction, from the palm toward the object; x is the closing
    axis, from finger 1 to finger 2; y = z x x. Each finger is a box of thickness x width x length
    along x, y and z; the palm is a box behind the fingers.

    Flat pads are on the inner faces of the fingers, at their ends. Round tips are balls at the ends
    of the fingers, which reach up to the centres of the balls.

    Attributes:
        name: Name in tables and files.
        min_opening: Smallest distance between the contacts [m].
        max_opening: Largest one, the stroke [m].
        finger_thickness: Size of a finger along x [m].
        finger_width: Size of a finger along y [m].
        finger_length: From the palm to the end of a finger [m].
        pad_width: Size of a flat pad along y [m], at most that of the finger.
        pad_height: Size of a flat pad along z [m], at most the length of the finger.
        tip_radius: Radius of round tips [m]; 0: flat pads.
        inner_faces: Faces of the inner side of finger 1, which touch the object when jaws close: of
            each the corners (x, y, z) in the gripper's frame, with the pad's plane at x = 0 and
            the others behind it, x <= 0 [m]; each face is flat and convex. Finger 2 mirrors them.
            Empty: the flat pad alone.
        tip_thickness: Size of a finger along x at its pad [m]; None: that of the whole finger.
        palm_thickness: Size of the palm along x [m], at least the stroke.
        palm_width: Size of the palm along y [m].
        palm_length: Size of the palm along z [m].
        compliance: Depth to which the object presses into pads or tips [m].
        clearance: Distance between each finger and the object before the fingers close [m].
        max_force: Greatest force of each finger [N]; None: not stated.
        sensor_resolution: Resolution alpha of the fingertips [rad]; None: not stated.
        receptive_field: Length of the arc within which round tips do not distinguish contacts [m],
            from which alpha follows; None: not stated.
        base_to_tcp: From the origin of the hand's own frame to the TCP, along z [m].
        base_axes: The closing and the approach axis as axes of the hand's own frame, the one of
            its robot description, such as ("-y", "z").
        joint_names: Names of the finger joints in simulators.
        joint_scale: Change of each joint per metre of opening.
        joint_closed: Value of each joint at an opening of 0.
        source: Where the lengths come from.

    Example:
        >>> from grasp3d.hand.parallel_gripper import ParallelGripper
        >>> gripper = ParallelGripper(
        ...     name="mine", max_opening=0.08, finger_thickness=0.01, finger_width=0.02,
        ...     finger_length=0.045, pad_width=0.02, pad_height=0.02,
        ...     palm_thickness=0.1, palm_width=0.06, palm_length=0.05,
        ... )
        >>> gripper.limits
        (0.0, 0.076)
        >>> ParallelGripper.preset("franka").max_force
        70.0
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

    def __post_init__(self) -> None:
        for name in (
            "max_opening", "finger_thickness", "finger_width", "finger_length", "palm_thickness",
            "palm_width", "palm_length",
        ):  # fmt: skip
            self._check(name, positive=True)
        for name in (
            "min_opening", "pad_width", "pad_height", "tip_radius", "compliance", "clearance",
            "base_to_tcp",
        ):  # fmt: skip
            self._check(name, positive=False)
        self._check_sizes()
        self._check_touch()
        one, two = self.base_axes if len(self.base_axes) == 2 else ("", "")
        if not {one, two} <= AXES.keys() or one[-1] == two[-1]:
            raise SettingError(
                f"gripper {self.name!r}: base_axes must be two axes at right angles of "
                f"{', '.join(AXES)}; got {list(self.base_axes)}"
            )
        joints = len(self.joint_names)
        if not len(self.joint_scale) == len(self.joint_closed) == joints:
            raise SettingError(
                f"gripper {self.name!r}: joint_scale and joint_closed must have a number for each "
                f"of the {joints} joint_names"
            )

    def _check(self, name: str, *, positive: bool) -> None:
        value = getattr(self, name)
        if not (isinstance(value, int | float) and math.isfinite(value) and value >= 0.0):
            raise SettingError(
                f"gripper {self.name!r}: {name} must be a length in metres of at least 0; "
                f"got {value!r}"
            )
        if positive and value == 0.0:
            raise SettingError(f"gripper {self.name!r}: {name} must be above 0")
        if value > LARGEST:
            raise SettingError(
                f"gripper {self.name!r}: {name} must be in metres, at most {LARGEST:g}; "
                f"got {value:g}: is it in millimetres?"
            )

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

    def _check_touch(self) -> None:
        if self.max_force is not None and not 0.0 < self.max_force < math.inf:
            raise SettingError(
                f"gripper {self.name!r}: max_force must be a finite force above 0 [N]; "
                f"got {self.max_force:g}"
            )
        if self.receptive_field is not None:
            if self.sensor_resolution is not None or self.tip_radius == 0.0:
                raise SettingError(
                    f"gripper {self.name!r}: a receptive_field needs round tips (tip_radius), and "
                    "replaces sensor_resolution"
                )
            Sensor(self.receptive_field, self.tip_radius)
        if self.sensor_resolution is not None:
            GraspModel(sensor_resolution=self.sensor_resolution)

    @classmethod
    def preset(cls, name: str) -> "ParallelGripper":
        """A gripper that is known by name; see `grasp3d.hand.presets`.

        Args:
            name: franka (or panda), robotiq_2f85, robotiq_2f140, wsg50 or tactile.

        Raises:
            SettingError: No preset has that name.
        """
        from grasp3d.hand.presets import preset

        return preset(name)

    @classmethod
    def from_file(
        cls,
        path: str | Path,
        *,
        fingers: tuple[str, str] | None = None,
        palm: str | None = None,
        tcp: float | None = None,
    ) -> "ParallelGripper":
        """A gripper described in a file; see `grasp3d.hand.gripper_files.read_gripper`.

        Args:
            path: A file that `write_gripper` wrote (.json), a URDF (.urdf) or a MuJoCo model
                (.xml, .mjcf).
            fingers: URDF and MuJoCo: names of the links, or bodies, of the two fingers.
            palm: URDF and MuJoCo: name of the link whose geometry is the palm; None: the one that
                carries the fingers, with what is fixed to it.
            tcp: URDF and MuJoCo: from the origin of the link that carries the fingers to the TCP,
                along the approach axis [m]; None: the middle of the flat pads.

        Raises:
            SettingError: It is no such file, or describes no gripper of two sliding fingers.
        """
        from grasp3d.hand.gripper_files import read_gripper

        return read_gripper(path, fingers=fingers, palm=palm, tcp=tcp)

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
    def resolution(self) -> float | None:
        """Sensor resolution alpha [rad]; None: not stated."""
        if self.receptive_field is not None:
            return Sensor(self.receptive_field, self.tip_radius).resolution
        return self.sensor_resolution

    def torsion_radius(self, friction: float) -> float:
        """Torsion radius of a pad that touches with its whole area [m]; 0 for round tips.

        That of an evenly pressed disc of the pad's area: 2/3 x friction x radius. A real contact
        is smaller, and holds less.

        Args:
            friction: Coulomb coefficient, above 0.
        """
        radius = math.sqrt(self.pad_width * self.pad_height / math.pi)
        return UNIFORM_PRESSURE * friction * radius

    def touching(self, model: GraspModel) -> GraspModel:
        """The model with the gripper's sensor resolution, if it states one."""
        alpha = self.resolution
        return model if alpha is None else replace(model, sensor_resolution=alpha)
