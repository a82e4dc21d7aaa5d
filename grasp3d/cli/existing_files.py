"""Existing files at an output's path: which of them a command replaces without being asked.

It replaces its own results. Files of other programs, and labels made with other settings, are
replaced only with `--overwrite`.
"""

import math
import re
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from grasp3d.errors import OutputError
from grasp3d.quality.loads import Load, load_settings
from grasp3d.settings import GraspModel, MeshOptions, MultifingerSampling, Sampling
from grasp3d.system.documents import parse_json
from grasp3d.system.files import check_suffix, check_writable

if TYPE_CHECKING:
    from grasp3d.surface.labelling import Labelling

MARK, MARKED = b"grasp3d", 2**16
"""The name that other results contain, and how many bytes from their start or end it is."""

_HEADS = re.compile(
    rb'"(grasp","label","critical_angle|name","px","py|mesh","source","refusal|name","mode",|'
    rb'x","y","z","stable",|file","grasp","object",|score","(better|other)",|'
    rb'friction","sensor_resolution","label",|grasp","success","held",|margin_low","margin_high",|'
    rb'object","mesh","grasps",|kind","reason","meaning",)'
)
"""How tables as CSV begin, which hold no name."""

_GRIPPER = re.compile(rb'\s*\{[^{}]*?"format"\s*:\s*"grasp3d gripper"')
"""How a description of a gripper begins; files of poses contain it farther on."""

_MESHES = frozenset({".ply", ".glb", ".npz", ".vtp"})
"""Formats of which other programs also write files, perhaps from a labelled mesh."""

_ANGLES = frozenset(
    {"approach_within", "sensor_resolution", "search_angle", "tolerance", "crease_angle"}
)
_LENGTHS = frozenset(
    name
    for kind in (GraspModel, Sampling, MultifingerSampling, MeshOptions, Load)
    for name in kind.length_names()
)
_WITHOUT_EFFECT = frozenset({"max_memory"})

ROUNDING = 1e-9
"""Largest relative difference of two numbers that are the same."""


def check_output(
    path: Path | None,
    suffixes: Iterable[str] = (),
    what: str = "",
    *,
    overwrite: bool,
    sources: Iterable[Path | None] = (),
) -> None:
    """Check before a long computation that an output has a known format and can be written.

    Args:
        path: File to create or replace; None: nothing is written.
        suffixes: Of the formats, in lower case; none: they are checked elsewhere.
        what: What the file contains, for the error: a table, a figure.
        overwrite: Whether any existing file may be replaced.
        sources: Files that it must not replace; None: no local file.

    Raises:
        OutputError: The suffix is not known, it cannot be written, or a file is there that is no
            result of grasp3d.
    """
    if path is None:
        return
    if suffixes:
        check_suffix(path, suffixes, what)
    for source in (None, *sources):
        check_writable(path, source=source)
    if path.exists() and not overwrite and not is_result(path):
        raise OutputError(
            f"{path}: exists and is no result of grasp3d; name another file, or replace it with "
            "--overwrite"
        )


def check_not_source(path: Path, source: Path, what: str) -> None:
    """Check that an output does not replace a file that is read.

    Args:
        path: File to create or replace.
        source: The file that is read.
        what: What it holds, for the error: poses, contacts.

    Raises:
        OutputError: It is that file.
    """
    with suppress(OSError):  # a file does not exist
        if path.samefile(source):
            raise OutputError(f"{path}: is the file of {what}; name another file with -o")


def check_not_task(path: Path, load: Load) -> None:
    """Check that an output does not replace a file of the task.

    Args:
        path: File to create or replace.
        load: As the options give it, with the names of the task's files.

    Raises:
        OutputError: It is a file of the task.
    """
    for file in load.task_files:
        check_not_source(path, file, "the task")


def check_same_settings(path: Path, task: "Labelling", *, overwrite: bool) -> None:
    """Check that labels which a file holds were made of such a mesh with the same settings.

    Meshes are compared by name, number of vertices and size (the scale of torques), not by shape.

    Args:
        path: File to create or replace.
        task: The mesh to be labelled, and the settings.
        overwrite: Whether other labels may be replaced.

    Raises:
        OutputError: It holds other labels.
    """
    from grasp3d.export.stored import stored_settings
    from grasp3d.settings import search_cone
    from grasp3d.surface.label_settings import chosen_settings

    stored = None if overwrite or not path.exists() else stored_settings(path)
    if stored is None:
        return
    mesh = task.mesh
    settings = chosen_settings(mesh, task.model, task.sampling, "label", task.scene)
    settings |= load_settings(task.load)
    settings["search_angle"] = search_cone(task.model, task.sampling)
    of_mesh = {"file_vertices": mesh.file_vertices, "torque_scale": mesh.torque_scale}
    differing = [
        name
        for name, value in (settings | of_mesh).items()
        if name not in _WITHOUT_EFFECT and not _is_same(stored.get(name, str(value)), str(value))
    ]
    if differing:
        name = differing[0]
        reason = f"of another mesh called {mesh.report.source}"
        if name not in of_mesh:
            unit = f" {mesh.unit or ''}".rstrip()
            pair = stored[name], str(settings[name])
            there, here = (
                _grippers(*pair)
                if name == "gripper"
                else (_text(name, value, unit) for value in pair)
            )
            reason = f"{name} {there}, not {here}"
        raise OutputError(
            f"{path}: exists with labels made otherwise ({reason}); name another file with -o, or "
            "replace it with --overwrite"
        )


def is_result(path: Path) -> bool:
    """Whether a file is a result of grasp3d, by its metadata or its columns."""
    from grasp3d.export.stored import stored_settings

    try:
        with path.open("rb") as stream:
            start = stream.read(MARKED)
            stream.seek(max(0, path.stat().st_size - MARKED))
            end = stream.read()
    except OSError:
        return False
    suffix = path.suffix.lower()
    if suffix == ".csv":
        return _HEADS.match(start) is not None
    if suffix in _MESHES:
        return stored_settings(path) is not None
    if suffix == ".json" and _GRIPPER.match(start):
        return False  # a description of a gripper is written by hand too
    return MARK in start or MARK in end


def _is_same(there: str, here: str) -> bool:
    """Whether two texts are the same value: 80 and 80.0 are, and numbers with a rounding error."""
    if there == here or (there.isdecimal() and here.isdecimal()):
        return there == here
    try:
        return math.isclose(float(there), float(here), rel_tol=ROUNDING)
    except ValueError:
        return False


def _grippers(there: str, here: str) -> tuple[str, str]:
    """Two grippers for a message: their names, and a field that differs if those are the same."""
    first, second = _gripper(there), _gripper(here)
    fields = [name for name, value in first.items() if second.get(name, value) != value]
    differing = [] if fields[:1] == ["name"] else fields[:1]

    def text(hand: dict[str, Any]) -> str:
        values = (f"{name} {hand[name]}" for name in differing)
        return " ".join([str(hand.get("name", "none")), *values])

    return text(first), text(second)


def _gripper(text: str) -> dict[str, Any]:
    """Fields of a stored gripper; empty: none, or it is damaged."""
    try:
        fields = parse_json(text)
    except ValueError:
        fields = None
    return fields if isinstance(fields, dict) else {}


def _text(name: str, value: str, unit: str) -> str:
    """A setting's value for a message, angles in degrees, lengths with their unit."""
    try:
        number = float(value)
    except ValueError:
        return value
    if name in _ANGLES:
        return f"{math.degrees(number):.4g}°"
    return f"{number:.4g}{unit if name in _LENGTHS else ''}"
