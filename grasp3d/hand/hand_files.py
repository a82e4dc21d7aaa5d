"""Read and write hands: JSON files, robot descriptions, and single lines of other files."""

import json
import os
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from grasp3d.errors import SettingError
from grasp3d.hand.hand import Hand
from grasp3d.hand.parallel_gripper import (
    ALIASES,
    FORMAT,
    KEYS,
    PRESETS,
    ParallelGripper,
    gripper_of,
)
from grasp3d.hand.robot_files import FORMAT as ARTICULATED
from grasp3d.hand.robot_files import NAMES, made_of, read_json
from grasp3d.hand.robot_files import SUFFIXES as MODELS
from grasp3d.system.documents import described, is_file, is_folder, parse_json
from grasp3d.system.files import atomic_write, check_suffix
from grasp3d.system.names import printable, unsupported

if TYPE_CHECKING:
    from grasp3d.hand.link_tree import LinkTree


def _articulated(content: Any) -> Hand:
    from grasp3d.hand.hand_json import articulated_hand

    return articulated_hand(content)


READERS: dict[str, Callable[[Any], Hand]] = {FORMAT: gripper_of, ARTICULATED: _articulated}
"""Functions that make hands from descriptions, by "format"; they raise SettingError."""

MODEL = "description"
"""Key for the path of the robot model, relative to the folder of the JSON file."""

SUFFIXES = (".json", *MODELS)


GivenHand: TypeAlias = Hand | str | Path | None
"""A hand as functions accept it: a `Hand`, or a name or file for `read_hand`."""


def given_hand(hand: GivenHand) -> Hand | None:
    """The hand that is given as a `Hand`, by name or by file.

    Raises:
        SettingError: It is none of these, or `read_hand` raises it.
    """
    found = read_hand(hand) if isinstance(hand, str | Path) else hand
    if found is None or (isinstance(found, Hand) and not isinstance(found, type)):
        return found
    raise SettingError(
        f"hand must be a Hand, such as a ParallelGripper, its name ('franka') or its file; got "
        f"{found!r}"
    )


def read_hand(
    source: str | Path,
    *,
    fingers: tuple[str, str] | None = None,
    palm: str | None = None,
    tcp: float | None = None,
) -> Hand:
    """Read a hand: a preset by name, a JSON file, or a URDF or MuJoCo model.

    A URDF or MuJoCo model with two sliding links becomes a parallel gripper, measured as described
    in `grasp3d.hand.measured_gripper`. A model whose joint and travel match a preset with turning
    fingers becomes that preset. Any other model becomes a hand with joints; `grasp3d.hand.proposal`
    describes how the values that the file does not state are proposed.

    Args:
        source: Name of a preset; or a file that `write_hand` wrote (.json), a URDF (.urdf) or a
            MuJoCo model (.xml, .mjcf).
        fingers: URDF and MuJoCo: names of the links, or bodies, of the two sliding fingers; None:
            the only two links that slide, if any.
        palm: URDF and MuJoCo: name of the link whose geometry is the palm; None: the link that
            carries the fingers, with the links fixed to it.
        tcp: URDF and MuJoCo: distance from the origin of the link that carries the fingers to the
            TCP, along the approach axis [m]; None: that of a link whose name ends with tcp, or else
            the middle of the flat pads.

    Raises:
        SettingError: It is neither a preset nor a file of a hand, or the file describes no usable
            hand.

    Example:
        >>> import grasp3d
        >>> from grasp3d.hand.hand_files import write_hand
        >>> write_hand("gripper.json", grasp3d.read_hand("wsg50"))
        >>> grasp3d.read_hand("gripper.json") == grasp3d.read_hand("wsg50")
        True
    """
    options = {"fingers": fingers, "palm": palm, "tcp": tcp}
    given = ", ".join(name for name, value in options.items() if value is not None)
    path, name = Path(source), str(source)
    suffix, folder = path.suffix.lower(), is_folder(path)
    if name in NAMES:
        raise SettingError(
            f"{name} is a hand with joints, whose links are not shipped; describe it from its URDF "
            f"first: grasp3d hand FILE.urdf -o {name}.json"
        )
    if given and suffix not in MODELS:
        raise SettingError(printable(f"{given}: for URDF and MuJoCo files only, unlike {name!r}"))
    is_file_name = suffix in SUFFIXES or len(path.parts) > 1 or is_file(path) or folder
    if name in {"", *PRESETS, *ALIASES} or not is_file_name:
        return ParallelGripper.preset(name)
    if suffix not in SUFFIXES and not folder:
        raise SettingError(unsupported(path, SUFFIXES, "gripper"))
    if suffix != ".json":
        return made_of(path, _of_links, fingers, palm, tcp)
    content = read_json(path)
    if isinstance(content, dict) and isinstance(content.get(MODEL), str):
        content = {**content, MODEL: str(path.parent / content[MODEL])}
    try:
        return hand_of(content)
    except SettingError as error:
        raise SettingError(printable(f"{path}: {error}")) from error


def _of_links(
    tree: "LinkTree", fingers: tuple[str, str] | None, palm: str | None, tcp: float | None
) -> Hand:
    """Make the hand that a URDF or MuJoCo model describes. Raises SettingError."""
    from grasp3d.hand.hand_json import proposed_hand
    from grasp3d.hand.measured_gripper import measured_gripper, sliding_fingers, turning_preset

    if fingers is not None and (len(fingers) != 2 or fingers[0] == fingers[1]):
        raise tree.error("a gripper needs two different finger links")
    if (found := fingers or sliding_fingers(tree)) is not None:
        return measured_gripper(tree, found, palm, tcp)
    if tcp is not None:
        raise tree.error("tcp is for grippers of two fingers that slide: name them")
    if (known := turning_preset(tree)) is not None:
        source = f"{known.source}; it is {known.name}, whose joint {Path(tree.source).name} has"
        return replace(known, source=source)
    return proposed_hand(tree, palm)


def write_hand(path: str | Path, hand: Hand) -> None:
    """Write the description of a hand as JSON: metres, N, radians.

    Args:
        path: File to create or replace; .json.
        hand: The hand.

    Raises:
        OutputError: The file has another suffix, or cannot be written.
    """
    path = Path(path)
    check_suffix(path, [".json"], "gripper")
    content = dict(hand.description())
    if MODEL in content:
        model, folder = Path(content[MODEL]).absolute(), path.parent.absolute()
        with suppress(ValueError):  # on another drive
            content[MODEL] = Path(os.path.relpath(model, folder)).as_posix()
    text = json.dumps(content, indent=1, allow_nan=False)
    with atomic_write(path) as part:
        part.write_text(f"{text}\n", encoding="utf-8")


def hand_of(content: object) -> Hand:
    """Make the hand that a JSON description states.

    Args:
        content: What `Hand.description` returned, as read from JSON.

    Raises:
        SettingError: It is not a description, or its format is unknown.
    """
    keys = content if isinstance(content, dict) else {}
    stated = keys.get("format", FORMAT if "max_opening" in keys else None)
    if str(stated) not in READERS:
        raise SettingError(
            f'is not a gripper or hand: expected an object with "format": "{FORMAT}", of two jaws, '
            f'or "{ARTICULATED}", of fingers with joints; got {described(stated)}'
        )
    return READERS[str(stated)](keys)


def hand_line(hand: Hand) -> str:
    """The description of a hand in one line, for settings of labels; grippers omit their format."""
    content = hand.description()
    hidden = KEYS if content["format"] == FORMAT else ()
    return json.dumps({name: value for name, value in content.items() if name not in hidden})


def hand_of_line(line: str) -> Hand:
    """Make the hand that a line from `hand_line` describes. Raises SettingError."""
    try:
        return hand_of(parse_json(line))
    except ValueError as error:
        raise SettingError(f"its gripper {error}") from error
