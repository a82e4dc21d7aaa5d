"""The settings in the header comments of a labelled PLY."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import get_args

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.errors import GraspError
from grasp3d.hand.approach import Approach
from grasp3d.hand.hand_files import hand_of_line
from grasp3d.hand.scene import Scene
from grasp3d.hand.table import Table
from grasp3d.loads import Load, load_from
from grasp3d.settings import AnySampling, GraspModel, MeshOptions, sampling_kind
from grasp3d.settings.lengths import Unit
from grasp3d.settings.parsing import SettingsT, settings_of_texts
from grasp3d.stability.label import Mode
from grasp3d.viewer.subjects.forces import LoadNumbers

COMMENT = "comment grasp3d "
NEEDED = ("mode", "friction", "sensor_resolution", "fingers", "method", "search_angle", "unit")
"""Comments that every labelled PLY has."""


@dataclass(frozen=True)
class FileSettings:
    """Settings that a file was labelled with."""

    model: GraspModel
    sampling: AnySampling | None
    """None: a scan."""
    options: MeshOptions
    mode: Mode
    cone: float
    """Largest critical friction angle that was searched [rad]."""
    unit: Unit | None
    scene: Scene | None = None
    """The gripper that must reach each grasp, and the table; None: ideal points."""
    load: Load | None = None
    """What each grasp must hold; None: nothing, or its task was made in Python."""
    load_numbers: LoadNumbers | None = None
    """Its mass and the force at hand; None: no load."""


def comments_of(header: bytes) -> dict[str, str]:
    """Values of the grasp3d comments in the header of a PLY, by name."""
    lines = header.decode("ascii", "replace").splitlines()
    comments = [line.removeprefix(COMMENT) for line in lines if line.startswith(COMMENT)]
    return {name: value for name, _, value in (line.partition(" ") for line in comments)}


def settings_from(comments: Mapping[str, str]) -> FileSettings:
    """Parse the comments.

    Args:
        comments: As `comments_of` returns them; unknown names are ignored.

    Raises:
        ValueError: They are not valid settings; the message gives the reason.
    """
    missing = [name for name in NEEDED if name not in comments]
    if missing:
        raise ValueError(f"there is no comment {missing[0]!r}")
    mode, cone = comments["mode"], float(comments["search_angle"])
    if mode not in get_args(Mode) or not 0.0 < cone <= math.pi:
        raise ValueError(f"its mode is {mode[:20]!r} and its search angle {cone}")
    values = dict(comments, unit="None" if comments["unit"] == "unknown" else comments["unit"])
    options = _parsed(MeshOptions, values)
    load = _load(values)
    model = _parsed(GraspModel, values)
    return FileSettings(
        model=model,
        sampling=None if mode == "scan" else _parsed(sampling_kind(model.fingers), values),
        options=options,
        mode="scan" if mode == "scan" else "label",
        cone=cone,
        unit=options.unit,
        scene=_scene(values),
        load=load,
        load_numbers=_load_numbers(values, load, options.unit),
    )


def _load(values: Mapping[str, str]) -> Load | None:
    """The load; raises ValueError if it is damaged."""
    try:
        return load_from(values)
    except GraspError as error:
        raise ValueError(str(error)) from error


def _load_numbers(
    values: Mapping[str, str], load: Load | None, unit: Unit | None
) -> LoadNumbers | None:
    """What the load came to on the object; None: there is none. Raises ValueError."""
    if "object_mass" not in values:
        return None
    mass, force = (
        None if text == "None" else float(text)
        for text in (values["object_mass"], values.get("force_at_hand", "None"))
    )
    if not all(number is None or 0.0 < number < math.inf for number in (mass, force)):
        raise ValueError(f"its object_mass is {mass} and its force_at_hand {force}")
    return LoadNumbers(mass, force, mass is not None or _depends_on_mass(load, unit))


def _depends_on_mass(load: Load | None, unit: Unit | None) -> bool:
    """Whether a task depends on the mass; a task that cannot be read again counts as one."""
    if load is None:
        return True
    try:
        return load.task_for(None, unit).mass is not None
    except GraspError as error:
        raise ValueError(str(error)) from error


def _scene(values: Mapping[str, str]) -> Scene | None:
    """The gripper, the table and the approach; None: there is no gripper.

    Raises:
        ValueError: They are not valid settings.
    """
    if values.get("gripper", "none") == "none":
        return None
    try:
        hand = hand_of_line(values["gripper"])
        table, direction = _numbers(values, "table", 4), _numbers(values, "approach_direction", 3)
        within, angles = float(values["approach_within"]), int(values["approach_angles"])
        return Scene(
            hand,
            None if table is None else Table(table[:3], float(table[3])),
            Approach(direction, within=within, angles=angles),
        )
    except KeyError as error:
        raise ValueError(f"there is no comment {error.args[0]!r}") from error
    except GraspError as error:
        raise ValueError(str(error)) from error


def _numbers(values: Mapping[str, str], name: str, count: int) -> Floats | None:
    """Some numbers in one comment, shape (count,); None: it is 'none'."""
    if values[name] == "none":
        return None
    numbers = np.array([float(one) for one in values[name].split()])
    if len(numbers) != count:
        raise ValueError(f"its {name} has {len(numbers)} numbers instead of {count}")
    return numbers


def _parsed(kind: type[SettingsT], values: Mapping[str, str]) -> SettingsT:
    """Settings of one kind; missing ones have their defaults."""
    try:
        return settings_of_texts(kind, values)
    except (TypeError, GraspError) as error:
        raise ValueError(str(error)) from error
