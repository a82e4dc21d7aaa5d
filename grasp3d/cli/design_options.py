"""Options of `grasp3d design` on frictions, joints, further errors, and the object."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from grasp3d.cli.options import Flag, LengthOption, SensorResolution
from grasp3d.contact.sensor import JointEncoders
from grasp3d.errors import SettingError
from grasp3d.settings.lengths import Unit, length_in_unit
from grasp3d.settings.uncertainty import Interval, friction_interval

_BETWEEN = ".."


_INTERVAL: tyro.constructors.PrimitiveConstructorSpec[Any] = (
    tyro.constructors.PrimitiveConstructorSpec(
        nargs=1,
        metavar=f"NUMBER|LOW{_BETWEEN}HIGH",
        instance_from_str=lambda words: friction_interval(words[0]),
        is_instance=lambda value: isinstance(value, tuple),
        str_from_instance=lambda value: [friction_text(value)],
    )
)

FrictionList = Annotated[
    tuple[Annotated[Interval, _INTERVAL], ...],
    tyro.conf.arg(
        help="Coulomb coefficient of friction between fingertip and object, above 0, or the "
        "interval in which it lies, 0.4..0.6. One value or more.",
        help_behavior_hint="",
    ),
]
"""Frictions, each as its smallest and largest value."""


def friction_text(friction: Interval) -> str:
    """A friction as it is given on the command line.

    Args:
        friction: Smallest and largest value.
    """
    return _BETWEEN.join(f"{end:.4g}" for end in dict.fromkeys(friction))


@dataclass(frozen=True)
class JointOptions:
    """The joints of each finger, and their encoders."""

    encoder_counts: Annotated[
        tuple[float, ...], tyro.conf.arg(metavar="COUNTS [COUNTS ...]", help_behavior_hint="")
    ] = ()
    """Counts per revolution of the encoders, after quadrature decoding: one number for all joints,
    or one for each. Without them the required counts are printed."""

    joint_lengths: Annotated[
        tuple[LengthOption, ...],
        tyro.conf.arg(metavar="LENGTH [LENGTH ...]", help_behavior_hint=""),
    ] = ()
    """Distance of each joint's axis from the contact; with --parallel-jaws the travel of a jaw per
    revolution of its encoder."""

    parallel_jaws: Flag = False
    """The joints move the jaws of a parallel gripper along the line through both contacts."""

    def __post_init__(self) -> None:
        if self.encoder_counts and not self.joint_lengths:
            raise SettingError(
                "--encoder-counts need the lengths of the joints: give --joint-lengths"
            )
        if self.parallel_jaws and not self.joint_lengths:
            raise SettingError("--parallel-jaws needs --joint-lengths: the travel per revolution")

    def encoders(self, unit: Unit) -> JointEncoders | None:
        """The encoders; None: no joints are given. Without counts they are exact.

        Args:
            unit: Unit of the lengths.

        Raises:
            SettingError: A value is outside its range.
        """
        lengths = tuple(
            length_in_unit("joint_lengths", length, unit) for length in self.joint_lengths
        )
        if not lengths:
            return None
        counts = self.encoder_counts or (float("inf"),)
        return JointEncoders(
            counts[0] if len(counts) == 1 else counts,
            lengths,
            "prismatic" if self.parallel_jaws else "revolute",
        )


@dataclass(frozen=True)
class GraspOptions:
    """What else is uncertain, and the grasps that the design is for."""

    normal_error: SensorResolution = None
    """Largest angle in degrees between true and perceived normals, beside those that sensor and
    encoders cause."""

    location_error: LengthOption = None
    """Largest distance between the true and the perceived contact, beside those of sensor and
    encoders."""

    critical_angle: SensorResolution = None
    """Critical friction angle of the grasp in degrees (default: 0, that of the best grasps: the
    contact normals lie on the line through both contacts)."""

    object: Annotated[Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="")] = None
    """Mesh of an object, which is searched for the best grasp at each vertex: their critical angles
    and openings are used instead of those of one grasp."""

    unit: Annotated[Unit | None, tyro.conf.arg(help_behavior_hint="")] = None
    """Unit of the mesh's coordinates (default: the unit that the file states)."""

    max_opening: LengthOption = None
    """Largest distance between the contacts on the object."""

    def __post_init__(self) -> None:
        if self.object is None:
            for name in ("unit", "max_opening"):
                if getattr(self, name) is not None:
                    option = f"--{name.replace('_', '-')}"
                    raise SettingError(f"{option} is for an object; give its mesh with --object")
        elif self.critical_angle is not None:
            raise SettingError(
                "--critical-angle is that of one grasp, --object has those of its surface; give one"
            )
