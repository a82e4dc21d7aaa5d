"""Poses in the project's own JSON format."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Floats
from grasp3d.errors import ContactError, OutputError
from grasp3d.grasps.pose_files.documents import (
    Entries,
    each,
    grasp_list,
    json_numbers,
    json_text,
    kind,
    mapping,
    numbers,
    optional_numbers,
    required,
)
from grasp3d.grasps.pose_files.header import NAMES, fields_of, header_of, outcomes_of
from grasp3d.grasps.poses import OWN_NAMES, VECTOR_COLUMNS, GraspPoses
from grasp3d.hand.hand import Hand
from grasp3d.settings.lengths import Unit
from grasp3d.system.files import atomic_write


def is_own(content: object) -> bool:
    """Whether the content of a JSON file is in this format."""
    grasps = content.get("grasps") if isinstance(content, dict) else None
    return (
        isinstance(grasps, list)
        and bool(grasps)
        and isinstance(grasps[0], dict)
        and "pose" in grasps[0]
    )


def write_json(path: Path, poses: GraspPoses) -> None:
    """Write what applies to all grasps, then one line for each grasp."""
    columns = {
        "name": list(poses.names),
        "pose": poses.poses.tolist(),
        "opening": json_numbers(poses.opening),
        "pregrasp_opening": json_numbers(poses.pregrasp_opening),
        **({"posture": poses.posture.tolist()} if poses.posture.size else {}),
        "score": json_numbers(poses.scores),
        "outcome": json_numbers(poses.outcome),
    }
    for name, values in poses.columns.items():
        if name not in VECTOR_COLUMNS:
            columns[name] = json_numbers(values)
    if VECTOR_COLUMNS[0] in poses.columns or VECTOR_COLUMNS[1] in poses.columns:
        columns["contacts"] = _contacts(poses.columns)
    try:
        header = json_text(header_of(poses))
    except (TypeError, ValueError) as error:
        raise OutputError(f"{path}: the settings of the poses are no JSON: {error}") from error
    with atomic_write(path) as part, part.open("w", encoding="utf-8") as stream:
        stream.write(f'{{"grasp3d": {header},\n"grasps": [')
        for row in range(poses.count):
            entry = {name: values[row] for name, values in columns.items()}
            stream.write(("," if row else "") + "\n" + json_text(entry))
        stream.write("\n]}\n")


def _contacts(columns: Mapping[str, npt.NDArray[Any]]) -> list[list[dict[str, Any]]]:
    """The contacts of each grasp, normals outward."""
    parts = {}
    if "contacts" in columns:
        parts["point"] = json_numbers(columns["contacts"])
    if "normals" in columns:
        parts["normal"] = json_numbers(0.0 - columns["normals"])
    names, listed = list(parts), list(parts.values())
    return [
        [dict(zip(names, contact, strict=True)) for contact in zip(*grasp, strict=True)]
        for grasp in zip(*listed, strict=True)
    ]


def parse_json(content: object, hand: Hand | None, unit: Unit | None) -> GraspPoses:
    """Poses of the content of a JSON file. Raises ContactError."""
    document = mapping(content, "the file")
    grasps = grasp_list(required(document, "grasps"), "grasps")
    entries: list[Mapping[str, Any]] = [
        mapping(entry, f"grasp {number}") for number, entry in enumerate(grasps, 1)
    ]
    header = mapping(document.get("grasp3d", {}), "grasp3d")
    return GraspPoses(
        poses=numbers(each(entries, "pose"), (4, 4), "pose"),
        opening=optional_numbers(entries, "opening"),
        pregrasp_opening=optional_numbers(entries, "pregrasp_opening"),
        posture=_posture(entries),
        scores=optional_numbers(entries, "score"),
        outcome=_outcomes(entries),
        names=_names(entries),
        columns=_columns(entries),
        **fields_of(header, hand, unit),
    )


def _posture(entries: Entries) -> Floats:
    """Values of further joints, shape (k, p)."""
    if "posture" not in entries[0]:
        return np.zeros((0, 0))
    first = entries[0]["posture"]
    count = len(first) if isinstance(first, list) else 0
    return numbers(each(entries, "posture"), (count,), "posture")


def _names(entries: Entries) -> tuple[str, ...]:
    return tuple(
        str(entry.get("name", f"grasp_{number}")) for number, entry in enumerate(entries, 1)
    )


def _outcomes(entries: Entries) -> Floats:
    """Outcomes by either of their keys."""
    columns = {
        key: np.array([entry.get(key) for entry in entries], dtype=object)
        for key in NAMES
        if any(key in entry for entry in entries)
    }
    return outcomes_of(columns, len(entries))


def _columns(entries: Entries) -> dict[str, npt.NDArray[Any]]:
    """What else the entries have: numbers, text and contacts."""
    keys = list(dict.fromkeys(key for entry in entries for key in entry))
    columns: dict[str, npt.NDArray[Any]] = {
        key: _column([entry.get(key) for entry in entries], key)
        for key in keys
        if key not in OWN_NAMES | set(VECTOR_COLUMNS)
    }
    if "contacts" in keys:
        columns |= _vectors(entries)
    return columns


def _column(values: list[Any], key: str) -> npt.NDArray[Any]:
    """Text if there is any text, otherwise numbers."""
    if any(isinstance(value, str) for value in values):
        wrong = next((v for v in values if isinstance(v, list | dict)), None)
        if wrong is not None:
            raise ContactError(f"{key} must be text in all grasps; got {kind(wrong)}")
        return np.array(["" if value is None else str(value) for value in values])
    return numbers(values, (), key)


def _vectors(entries: Entries) -> dict[str, Floats]:
    """Contacts and normals, shape (k, n, 3)."""
    pairs = [
        [mapping(contact, f"grasp {number}: a contact") for contact in contacts]
        for number, contacts in enumerate(_pairs(entries), 1)
    ]
    columns: dict[str, Floats] = {}
    for key, name in (("point", "contacts"), ("normal", "normals")):
        if all(key in contact for pair in pairs for contact in pair):
            rows = [[contact[key] for contact in pair] for pair in pairs]
            columns[name] = numbers(rows, (len(pairs[0]), 3), f"{key} of contacts")
    if "normals" in columns:
        columns["normals"] = 0.0 - columns["normals"]
    return columns


def _pairs(entries: Entries) -> list[list[Any]]:
    """The contacts of each grasp, as many of each."""
    first = entries[0].get("contacts")
    count = len(first) if isinstance(first, list) and len(first) > 2 else 2
    for number, entry in enumerate(entries, 1):
        contacts = entry.get("contacts")
        if not isinstance(contacts, list) or len(contacts) != count:
            raise ContactError(
                f"grasp {number}: contacts must be a list of {count}; got {kind(contacts)}"
            )
    return [entry["contacts"] for entry in entries]
