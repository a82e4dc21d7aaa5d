"""The commands `design`, `hand` and `paper`: their options."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from grasp3d.cli.options import POSITIONAL, LengthOption, Overwriting, Quiet, Stated
from grasp3d.errors import SettingError
from grasp3d.settings import DEGREE, Radians
from grasp3d.settings.friction import friction_interval
from grasp3d.settings.parsing import Group
from grasp3d.settings.units import Metres

_NAME = Stated(metavar="[NAME|FILE]")
_LINKS = Stated(metavar="LINK LINK")
_LINK = Stated(metavar="LINK")


@dataclass(frozen=True)
class Design:
    """Compute the sensor for a friction, or the friction for a sensor.

    With --friction: the coarsest sensor for surely stable grasps. With a sensor, given by
    --receptive-field or --sensor-resolution: the least friction. With both: whether the sensor is
    fine enough for each friction, and with --joints the encoders that the finger needs.

    Example:
        # The coarsest sensor for two frictions
        grasp3d design --friction 0.2 0.5
        # Whether a sensor is fine enough, and the encoders of a finger with two joints
        grasp3d design --friction 0.5 --receptive-field 4mm --joints 2
    """

    friction: Annotated[tuple[float, ...], Group("sensor")] = ()
    """Coulomb coefficient of friction between fingertip and object, above 0. One value or more."""

    fingertip_radius: Annotated[LengthOption, Group("fingertip")] = None
    """Radius of a hemispherical fingertip (default: 10mm)."""

    receptive_field: Annotated[LengthOption, Group("fingertip")] = None
    """Sensor: length of the arc on the fingertip within which it cannot distinguish contacts."""

    sensor_resolution: Annotated[Radians | None, Group("sensor")] = None
    """Sensor, by its resolution in degrees instead."""

    joints: Annotated[int | None, Group("fingertip")] = None
    """Revolute joints between palm and fingertip, for the counts per revolution that their encoders
    need, after quadrature decoding."""

    def __post_init__(self) -> None:
        for friction in self.friction:
            friction_interval(f"{friction:g}")
        for name in ("fingertip_radius", "receptive_field"):
            length = getattr(self, name)
            if length is not None and not isinstance(length, Metres):
                raise SettingError(f"{name} needs its unit, such as {length:g}mm")
        has_sensor = self.receptive_field is not None or self.sensor_resolution is not None
        if self.receptive_field is not None and self.sensor_resolution is not None:
            raise SettingError(
                "--receptive-field and --sensor-resolution each define the sensor; give one"
            )
        if self.joints is not None and not (has_sensor and self.friction):
            raise SettingError(
                "--joints needs --friction and a sensor: --receptive-field or --sensor-resolution"
            )


@dataclass(frozen=True)
class Hand(Quiet, Overwriting):
    """Print what is known of a gripper or a hand with joints; draw it, write it as JSON.

    Without one: list the ones that are known by name.

    Example:
        # Print a gripper, and draw it
        grasp3d hand franka --picture franka.png
        # Draw the frames in which programs give its pose
        grasp3d hand franka --frames frames.png
        # Describe the hand of a URDF by the links of its fingers
        grasp3d hand hand.urdf --fingers left_finger right_finger -o gripper.json
        # Propose the description of a hand with joints, and draw it
        grasp3d hand allegro.urdf -o allegro.json --picture allegro.png
    """

    hand: Annotated[str, POSITIONAL, _NAME] = ""
    """Name of a preset; or a file: JSON, as this command writes it, URDF (.urdf) or a MuJoCo model
    (.xml, .mjcf)."""

    fingers: Annotated[tuple[str, str] | None, _LINKS] = None
    """URDF and MuJoCo: names of the links, or bodies, of the two fingers that slide (default: it is
    a hand with joints)."""

    preset: Annotated[str | None, Stated(metavar="NAME")] = None
    """URDF and MuJoCo: name of the hand with joints whose numbers it has (default: that one whose
    joints have the same names, if there is one)."""

    palm: Annotated[str | None, _LINK] = None
    """URDF and MuJoCo: name of the link that is the palm (default: the one that carries the
    fingers)."""

    tcp: LengthOption = None
    """URDF and MuJoCo: from the origin of the link that carries the fingers to the tool centre
    point, a length with a unit, or in m (default: to the middle of the pads)."""

    output: Path | None = None
    """JSON file for the description."""

    picture: Path | None = None
    """Picture of it with its frame (.png, .svg or .pdf)."""

    frames: Path | None = None
    """Picture of all frames in which programs give its pose, by name (.png, .svg or .pdf)."""

    def __post_init__(self) -> None:
        options = ("fingers", "preset", "palm", "tcp", "output", "picture", "frames")
        names = [name for name in options if getattr(self, name) is not None]
        if names and not self.hand:
            raise SettingError(f"--{names[0]} needs a gripper: a name or a file before the options")


@dataclass(frozen=True)
class Paper(Quiet):
    """Recompute Wan & Howe 2018: figures 4 to 11, their 3-D counterparts, numbers.

    Without options friction and sensor resolutions are those of the paper.

    Example:
        # All figures and numbers
        grasp3d paper -o paper
        # For another friction, with a mesh of your own
        grasp3d paper -o paper_mug --friction 0.5 --object meshes/mug.glb
    """

    output: Annotated[Path, Stated(metavar="FOLDER")]
    """Folder for figure_04 to figure_11 and surface_..., each as .svg and .png, and numbers.md;
    created if it is missing. Figures 4 to 6 are drawings, always for the same tip, friction 1 and
    30 degrees."""

    friction: float = 1.0
    """Coulomb coefficient of friction between fingertip and object, above 0."""

    sensor_resolution: tuple[Radians, ...] = (30.0 * DEGREE, 15.0 * DEGREE)
    """One or two sensor resolutions in degrees, each with a column of the figures."""

    object: Path | None = None
    """Mesh of a real object to scan as well (default: sphere, box and cylinder only)."""

    fixed: Annotated[tuple[float, float, float] | None, Stated(metavar="X Y Z")] = None
    """Position of the fixed finger on the object, in the mesh's frame (default: a contact
    of the two-finger grasp with the largest maximum sensor resolution)."""
