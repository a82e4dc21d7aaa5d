"""Grippers in files: JSON of every field, and descriptions of robots."""

import json
from dataclasses import MISSING, asdict, fields
from difflib import get_close_matches
from pathlib import Path
from typing import Any, get_type_hints

from grasp3d.errors import SettingError
from grasp3d.hand.finger_faces import Corners
from grasp3d.hand.parallel_gripper import ParallelGripper
from grasp3d.hand.presets import ALIASES, PRESETS, preset
from grasp3d.system.files import atomic_write, check_suffix
from grasp3d.system.names import printable, unsupported

FORMAT, VERSION = "grasp3d gripper", 1
"""What the keys `format` and `version` of a file contain."""

ROBOTS = {".urdf": "urdf", ".xml": "mjcf", ".mjcf": "mjcf"}
"""Suffixes of robot descriptions, and the modules that read them."""

SUFFIXES = (".json", *ROBOTS)
LARGEST_FILE = 2**20
"""Largest JSON file [bytes]; one gripper takes a thousand."""

_KEYS = {"format", "version", "unit"}
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


def load_gripper(name: str | Path) -> ParallelGripper:
    """A gripper by name or from a JSON file.

    Args:
        name: Name of a preset, or path of a file that `write_gripper` wrote.

    Raises:
        SettingError: It is neither.

    Example:
        >>> from grasp3d.hand.gripper_files import load_gripper
        >>> load_gripper("panda").name
        'franka'
    """
    if str(name) in {*PRESETS, *ALIASES} or not is_file_name(name):
        return preset(str(name))
    return read_gripper(name)


def is_file_name(name: str | Path) -> bool:
    """Whether a gripper's name is that of a file: it has the suffix of one, a folder, or exists."""
    path = Path(name)
    return path.suffix.lower() in SUFFIXES or len(path.parts) > 1 or path.is_file()


def read_gripper(
    path: str | Path,
    *,
    fingers: tuple[str, str] | None = None,
    palm: str | None = None,
    tcp: float | None = None,
) -> ParallelGripper:
    """Read a gripper from a JSON file, a URDF or a MuJoCo model.

    URDF and MuJoCo models need the names of the two finger links. What is read from them, and what
    is assumed, is in `grasp3d.hand.hand_geometry`.

    Args:
        path: A file that `write_gripper` wrote (.json), a URDF (.urdf) or a MuJoCo model (.xml,
            .mjcf).
        fingers: Names of the links, or bodies, of the two fingers.
        palm: Name of the link whose geometry is the palm; None: the one that carries the fingers,
            with what is fixed to it.
        tcp: From the origin of the link that carries the fingers to the TCP, along the approach
            axis [m]; None: the middle of the flat pads.

    Raises:
        SettingError: It is no such file, or describes no gripper of two sliding fingers.

    Example:
        >>> from grasp3d.hand.gripper_files import read_gripper, write_gripper
        >>> from grasp3d.hand.presets import preset
        >>> write_gripper("gripper.json", preset("wsg50"))
        >>> read_gripper("gripper.json") == preset("wsg50")
        True
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise SettingError(unsupported(path, SUFFIXES, "gripper"))
    if not path.is_file():
        problem = "is a folder; name a file" if path.is_dir() else "there is no such file"
        raise SettingError(printable(f"{path}: {problem}"))
    if suffix == ".json":
        if fingers is not None or palm is not None or tcp is not None:
            raise SettingError(
                printable(f"{path}: fingers, palm and tcp are for URDF and MuJoCo files only")
            )
        return _from_json(path)
    if fingers is None:
        raise SettingError(
            printable(
                f"{path}: name the links of its two fingers: grasp3d hand {path} --fingers LINK "
                "LINK -o NAME.json makes a description of it, for all commands"
            )
        )
    return _from_robot(path, ROBOTS[suffix], fingers, palm, tcp)


def write_gripper(path: str | Path, gripper: ParallelGripper) -> None:
    """Write every field of a gripper as JSON: lengths in metres, forces in N, angles in radians.

    Args:
        path: File to make or replace; .json.
        gripper: The gripper.

    Raises:
        OutputError: It has another suffix, or cannot be written.
    """
    path = Path(path)
    check_suffix(path, [".json"], "gripper")
    content = {"format": FORMAT, "version": VERSION, "unit": "m", **asdict(gripper)}
    text = json.dumps(content, indent=1, allow_nan=False)
    with atomic_write(path) as part:
        part.write_text(f"{text}\n", encoding="utf-8")


def _from_robot(
    path: Path, kind: str, fingers: tuple[str, str], palm: str | None, tcp: float | None
) -> ParallelGripper:
    from grasp3d.hand.hand_geometry import gripper_of_hand

    if len(fingers) != 2 or fingers[0] == fingers[1]:
        raise SettingError(printable(f"{path}: a gripper needs two different finger links"))
    if kind == "urdf":
        from grasp3d.hand.urdf import read_urdf

        hand = read_urdf(path, fingers, palm)
    else:
        from grasp3d.hand.mjcf import read_mjcf

        hand = read_mjcf(path, fingers, palm)
    return gripper_of_hand(hand, tcp=tcp)


def _from_json(path: Path) -> ParallelGripper:
    where = printable(str(path))
    try:
        if path.stat().st_size > LARGEST_FILE:
            raise SettingError(f"{where}: is no gripper: larger than {LARGEST_FILE} bytes")
        found = json.loads(path.read_text(encoding="utf-8-sig"), parse_constant=_refuse_constant)
    except OSError as error:
        raise SettingError(f"{where}: cannot be read ({error.strerror or error})") from error
    except (ValueError, RecursionError) as error:
        raise SettingError(printable(f"{where}: is no JSON: {error}")) from error
    try:
        return ParallelGripper(**fields_of_gripper(found))
    except SettingError as error:
        raise SettingError(printable(f"{where}: {error}")) from error


def _refuse_constant(name: str) -> None:
    raise ValueError(f"{name} is no finite number")


def fields_of_gripper(found: object) -> dict[str, Any]:
    """Fields of a gripper, in the types of the dataclass. Raises SettingError."""
    if not isinstance(found, dict) or found.get("format") != FORMAT:
        raise SettingError(f'is no gripper: expected an object with "format": "{FORMAT}"')
    for key, value in (("version", VERSION), ("unit", "m")):
        if found.get(key) != value or isinstance(found.get(key), bool):
            got = json.dumps(found.get(key))[:40]
            raise SettingError(f"{key} must be {json.dumps(value)}; got {got}")
    known = {field.name: field for field in fields(ParallelGripper)}
    for key in found.keys() - _KEYS - known.keys():
        near = get_close_matches(key, known, 1)
        guess = f" (did you mean {near[0]}?)" if near else ""
        raise SettingError(f"no field is called {key[:40]!r}{guess}; known: {', '.join(known)}")
    missing = [
        name for name, field in known.items() if field.default is MISSING and name not in found
    ]
    if missing:
        raise SettingError(f"{', '.join(missing)} missing; every gripper needs it")
    kinds = get_type_hints(ParallelGripper)
    return {name: _typed(name, found[name], kinds[name]) for name in known if name in found}


def _typed(name: str, value: object, kind: Any) -> Any:
    """A value in the type of its field. Raises SettingError."""
    if _fits(value, kind):
        return _as_tuples(value)
    raise SettingError(f"{name} must be {_KINDS[kind]}; got {json.dumps(value)[:40]}")


def _as_tuples(value: object) -> Any:
    """Lists of lists as tuples of tuples."""
    return tuple(map(_as_tuples, value)) if isinstance(value, list) else value


def _fits(value: object, kind: Any) -> bool:
    if kind is str:
        return isinstance(value, str)
    if kind in {float, float | None}:
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        return is_number or (value is None and kind is not float)
    item, *more = kind.__args__
    return (
        isinstance(value, list)
        and all(_fits(one, item) for one in value)
        and (... in more or len(value) == 1 + len(more))
    )
