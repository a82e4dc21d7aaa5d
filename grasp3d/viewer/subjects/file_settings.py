"""What a labelled PLY says in its comments of how it was made."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from types import NoneType
from typing import Any, TypeVar, get_args, get_type_hints

from grasp3d.errors import GraspError
from grasp3d.settings import GraspModel, MeshOptions, Sampling, Unit
from grasp3d.stability.label import Mode

COMMENT = "comment grasp3d "
NEEDED = ("mode", "friction", "sensor_resolution", "fingers", "method", "search_angle", "unit")
"""Without these a file is none of grasp3d, whatever its properties are called."""

SettingsT = TypeVar("SettingsT")


@dataclass(frozen=True)
class FileSettings:
    """Settings that a file was labelled with."""

    model: GraspModel
    sampling: Sampling | None
    """None: a scan."""
    options: MeshOptions
    mode: Mode
    cone: float
    """Largest critical friction angle that counted [rad]."""
    unit: Unit | None


def comments_of(header: bytes) -> dict[str, str]:
    """Find the comments of grasp3d in the header of a PLY: what they tell, by its name."""
    lines = header.decode("ascii", "replace").splitlines()
    told = [line.removeprefix(COMMENT) for line in lines if line.startswith(COMMENT)]
    return {name: value for name, _, value in (line.partition(" ") for line in told)}


def settings_from(comments: Mapping[str, str]) -> FileSettings:
    """Understand the comments.

    Args:
        comments: As `comments_of` finds them; names that are not known are passed over.

    Raises:
        ValueError: They make no settings; the message says why.
    """
    missing = [name for name in NEEDED if name not in comments]
    if missing:
        raise ValueError(f"no comment tells its {missing[0]}")
    mode, cone = comments["mode"], float(comments["search_angle"])
    if mode not in get_args(Mode) or not 0.0 < cone <= math.pi:
        raise ValueError(f"its mode is {mode[:20]!r} and its search angle {cone}")
    given = dict(comments, unit="None" if comments["unit"] == "unknown" else comments["unit"])
    options = _made(MeshOptions, given)
    return FileSettings(
        model=_made(GraspModel, given),
        sampling=None if mode == "scan" else _made(Sampling, given),
        options=options,
        mode="scan" if mode == "scan" else "label",
        cone=cone,
        unit=options.unit,
    )


def _made(kind: type[SettingsT], given: Mapping[str, str]) -> SettingsT:
    """Settings of one kind; those that are not told are the usual ones."""
    hints = get_type_hints(kind)
    names = [field.name for field in fields(kind) if field.name in given]  # type: ignore[arg-type]
    try:
        return kind(**{name: _value(given[name], hints[name]) for name in names})
    except (TypeError, GraspError) as error:
        raise ValueError(str(error)) from error


def _value(text: str, hint: Any) -> Any:  # noqa: ANN401
    """A value as its type hint says; ValueError where it is none."""
    kinds = get_args(hint) or (hint,)
    if text == "None" and NoneType in kinds:
        return None
    return int(text) if int in kinds else float(text) if float in kinds else text
