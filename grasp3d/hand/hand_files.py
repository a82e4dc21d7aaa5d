"""Hands in files: JSON, descriptions of robots, and lines in other files."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from grasp3d.errors import SettingError
from grasp3d.hand.gripper_json import FORMAT, KEYS, VERSION, read_json
from grasp3d.hand.hand import Hand
from grasp3d.hand.parallel_gripper import ALIASES, PRESETS, gripper_of, preset
from grasp3d.system.documents import is_file, parse_json, problem_of_file
from grasp3d.system.files import atomic_write, check_suffix
from grasp3d.system.names import printable, unsupported

if TYPE_CHECKING:
    from grasp3d.hand.link_tree import LinkTree

READERS: dict[str, Callable[[Any], Hand]] = {FORMAT: gripper_of}
"""What makes hands of descriptions, by their "format": functions that raise SettingError."""

MEMORY, SECONDS, BYTES_PER_SECOND = 4.0, 15.0, 1e6
"""Limits of the process that reads a robot's description: memory [GB]; time for one without meshes
[s]; and bytes of all its files for which it has one second more."""

SUFFIXES = (".json", ".urdf", ".xml", ".mjcf")


def read_hand(
    source: str | Path,
    *,
    fingers: tuple[str, str] | None = None,
    palm: str | None = None,
    tcp: float | None = None,
) -> Hand:
    """Read a hand: a preset by name, a JSON file, or a URDF or MuJoCo model of a gripper.

    URDF and MuJoCo models need the names of the two finger links. What is read from them, and what
    is assumed, is in `grasp3d.hand.hand_geometry`.

    Args:
        source: Name of a preset; or a file that `write_hand` wrote (.json), a URDF (.urdf) or a
            MuJoCo model (.xml, .mjcf).
        fingers: URDF and MuJoCo: names of the links, or bodies, of the two fingers.
        palm: URDF and MuJoCo: name of the link whose geometry is the palm; None: the link
            that carries the fingers, with what is fixed to it.
        tcp: URDF and MuJoCo: from the origin of the link that carries the fingers to the TCP, along
            the approach axis [m]; None: the middle of the flat pads.

    Raises:
        SettingError: It is no preset and no such file, or describes no gripper of two sliding
            fingers.

    Example:
        >>> import grasp3d
        >>> from grasp3d.hand.hand_files import write_hand
        >>> write_hand("gripper.json", grasp3d.read_hand("wsg50"))
        >>> grasp3d.read_hand("gripper.json") == grasp3d.read_hand("wsg50")
        True
    """
    links_given = fingers is not None or palm is not None or tcp is not None
    path, suffix = Path(source), Path(source).suffix.lower()
    is_file_name = suffix in SUFFIXES or len(path.parts) > 1 or is_file(path)
    if str(source) in {*PRESETS, *ALIASES} or not is_file_name:
        if links_given:
            raise SettingError(
                f"fingers, palm and tcp are for URDF and MuJoCo files; {str(source)!r} is no file"
            )
        return preset(str(source))
    if suffix not in SUFFIXES:
        raise SettingError(unsupported(path, SUFFIXES, "gripper"))
    if problem := problem_of_file(path):
        raise SettingError(printable(f"{path}: {problem}"))
    if suffix == ".json":
        if links_given:
            raise SettingError(
                printable(f"{path}: fingers, palm and tcp are for URDF and MuJoCo files only")
            )
        content = read_json(path)
        try:
            return hand_of(content)
        except SettingError as error:
            raise SettingError(printable(f"{path}: {error}")) from error
    if fingers is None:
        raise SettingError(
            printable(
                f"{path}: name the links of its two fingers: grasp3d hand {path} --fingers LINK "
                "LINK -o NAME.json makes a description of it, for all commands"
            )
        )
    if len(fingers) != 2 or fingers[0] == fingers[1]:
        raise SettingError(printable(f"{path}: a gripper needs two different finger links"))
    return _watched(path, fingers, palm, tcp)


def _watched(path: Path, *arguments: Any) -> Hand:
    """The gripper of a robot's description, read in a child process. Raises SettingError.

    Such files, and those that they name, can ask for any memory and time, and end the process.
    """
    from grasp3d.hand.description_xml import size_of_files
    from grasp3d.system.isolation import CallFailedError, call

    seconds = SECONDS + size_of_files(path) / BYTES_PER_SECOND
    try:
        return call(_gripper_of_links, path, *arguments, memory=MEMORY, seconds=seconds)
    except SettingError as error:
        raise SettingError(str(error)) from None  # without the traceback of the child
    except CallFailedError as failure:
        raise SettingError(
            printable(f"{path}: the process that reads it {failure}; describe the gripper in JSON")
        ) from failure


def _gripper_of_links(
    path: Path, fingers: tuple[str, str], palm: str | None, tcp: float | None
) -> Hand:
    from grasp3d.hand.hand_geometry import gripper_of_hand

    return gripper_of_hand(read_links(path).sliding_hand(fingers, palm), tcp=tcp)


def write_hand(path: str | Path, hand: Hand) -> None:
    """Write the description of a hand as JSON: metres, N, radians.

    Args:
        path: File to make or replace; .json.
        hand: The hand.

    Raises:
        OutputError: It has another suffix, or cannot be written.
    """
    path = Path(path)
    check_suffix(path, [".json"], "gripper")
    text = json.dumps(hand.description(), indent=1, allow_nan=False)
    with atomic_write(path) as part:
        part.write_text(f"{text}\n", encoding="utf-8")


def hand_of(content: object) -> Hand:
    """The hand that a description in JSON states.

    Args:
        content: What `Hand.description` returned, as JSON has it.

    Raises:
        SettingError: It is none, or of no known format.
    """
    stated = content.get("format") if isinstance(content, dict) else None
    return READERS.get(str(stated), gripper_of)(content)


def hand_line(hand: Hand) -> str:
    """A description in one line, as settings of labels have it: grippers without their format."""
    content = dict(hand.description())
    if content["format"] == FORMAT:
        content = {name: value for name, value in content.items() if name not in KEYS}
    return json.dumps(content)


def hand_of_line(line: str) -> Hand:
    """The hand of which `hand_line` is that line. Raises SettingError."""
    try:
        content = parse_json(line)
    except ValueError as error:
        raise SettingError(f"its gripper {error}") from error
    if isinstance(content, dict) and "format" not in content:
        content = {"format": FORMAT, "version": VERSION, "unit": "m", **content}
    return hand_of(content)


def read_links(path: Path) -> "LinkTree":
    """All links and joints of a URDF (.urdf) or a MuJoCo model. Raises SettingError."""
    if path.suffix.lower() == ".urdf":
        from grasp3d.hand.urdf import read_urdf

        return read_urdf(path)
    from grasp3d.hand.mjcf import read_mjcf

    return read_mjcf(path)
