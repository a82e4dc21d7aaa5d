"""The settings of labelled files as values again."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, get_args

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.errors import GraspError
from grasp3d.hand.hand_files import hand_of_line
from grasp3d.hand.scene import Scene
from grasp3d.hand.table import Approach, Table
from grasp3d.quality.loads import Load, load_from
from grasp3d.settings import AnySampling, GraspModel, MeshOptions, sampling_kind
from grasp3d.settings.lengths import Unit
from grasp3d.settings.parsing import settings_of_texts
from grasp3d.stability.label import Mode
from grasp3d.surface.label_settings import GIVEN_ANGLE
from grasp3d.surface.vertex_grasps import SearchReport

NEEDED = (
    "mode", "friction", "sensor_resolution", "fingers", "method", "search_angle", "unit",
    "file_vertices", "torque_scale", "source",
)  # fmt: skip
"""Settings that every labelled file has."""


@dataclass(frozen=True)
class FileSettings:
    """Settings that a file was labelled with."""

    model: GraspModel
    sampling: AnySampling | None
    """None: a scan."""
    options: MeshOptions
    mode: Mode
    search: SearchReport
    source: str
    """Name of the mesh."""
    unit: Unit | None
    file_vertices: int
    torque_scale: float
    scene: Scene | None = None
    """The gripper that must reach each grasp, and the table; None: ideal points."""
    load: Load | None = None
    """What each grasp must hold; None: nothing, or its task cannot be read again."""
    object_mass: float | None = None
    """Mass that the load has on the object [kg]; None: unknown, or no load."""
    force_at_hand: float | None = None
    """Force at hand [N]; None: not given, or no load."""


def settings_from(texts: Mapping[str, str]) -> FileSettings:
    """Parse the settings of a labelled file.

    Args:
        texts: Texts by name; unknown names are ignored.

    Raises:
        ValueError: They are not valid settings; the message gives the reason.
    """
    missing = [name for name in NEEDED if name not in texts]
    if missing:
        raise ValueError(f"there is no comment {missing[0]!r}")
    mode = texts["mode"]
    if mode not in get_args(Mode):
        raise ValueError(f"its mode is {mode[:20]!r}")
    values = dict(texts, unit="None" if texts["unit"] == "unknown" else texts["unit"])
    try:
        options = settings_of_texts(MeshOptions, values)
        model = settings_of_texts(GraspModel, values)
        kind = sampling_kind(model.fingers)
        search, given = _search(values)
        sampled = {**values, "search_angle": given}
        return FileSettings(
            model=model,
            sampling=None if mode == "scan" else settings_of_texts(kind, sampled),
            options=options,
            mode="scan" if mode == "scan" else "label",
            search=search,
            source=_source(values),
            unit=options.unit,
            file_vertices=int(values["file_vertices"]),
            torque_scale=_size(values, "torque_scale"),
            scene=_scene(values),
            load=load_from(values),
            object_mass=_known(values, "object_mass"),
            force_at_hand=_known(values, "force_at_hand"),
        )
    except KeyError as error:
        raise ValueError(f"there is no comment {error.args[0]!r}") from error
    except (TypeError, GraspError, RecursionError) as error:
        raise ValueError(str(error)) from error


def _size(values: Mapping[str, str], name: str) -> float:
    number = float(values[name])
    if not 0.0 < number < math.inf:
        raise ValueError(f"its {name} is {number}")
    return number


def _known(values: Mapping[str, str], name: str) -> float | None:
    return None if values.get(name, "None") == "None" else _size(values, name)


def _source(values: Mapping[str, str]) -> str:
    """Name of the mesh, of which other characters than ASCII are escaped."""
    try:
        return values["source"].encode("ascii").decode("unicode_escape")
    except UnicodeError as error:
        raise ValueError("its source is not a name") from error


def _search(values: Mapping[str, str]) -> tuple[SearchReport, str]:
    """Extent of the search, and the angle that was given: where a file lacks it, the searched."""
    found: dict[str, Any] = {
        "cone": float(values["search_angle"]),
        "rays": int(values.get("rays_traced", "0")),
        "evaluated": int(values.get("candidates_evaluated", "0")),
    }
    given = values["search_angle"]
    if "search" in values:
        found = dict(json.loads(values["search"]))
        given = str(found.pop(GIVEN_ANGLE))
    report = SearchReport(**found)
    if not (isinstance(report.cone, float) and 0.0 < report.cone <= math.pi):
        raise ValueError(f"its search angle is {report.cone}")
    return report, given


def _scene(values: Mapping[str, str]) -> Scene | None:
    """The gripper, the table and the approach; None: there is no gripper."""
    if values.get("gripper", "none") == "none":
        return None
    hand = hand_of_line(values["gripper"])
    table, direction = _numbers(values, "table", 4), _numbers(values, "approach_direction", 3)
    within, angles = float(values["approach_within"]), int(values["approach_angles"])
    return Scene(
        hand,
        None if table is None else Table(table[:3], float(table[3])),
        Approach(direction, within=within, angles=angles),
    )


def _numbers(values: Mapping[str, str], name: str, count: int) -> Floats | None:
    """Some numbers in one setting, shape (count,); None: it is 'none'."""
    if values[name] == "none":
        return None
    numbers = np.array([float(one) for one in values[name].split()])
    if len(numbers) != count:
        raise ValueError(f"its {name} has {len(numbers)} numbers instead of {count}")
    return numbers
