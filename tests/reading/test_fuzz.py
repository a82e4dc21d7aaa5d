"""Damaged files of every format: either a mesh or an error of one line."""

import json
import random
import re
import time
import zlib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from grasp3d import GraspError, load_mesh
from tests.helpers import mesh_files
from tests.helpers.mesh_files import DATA, written

COUNT = 160
"""Damaged files of each kind."""

WORDS = (
    b"-", b"-1", b"9" * 12, b"nan", b"-inf", b"1e999", b"1e308", b"0", b"1e-320", b"\xff" * 4,
    b"\n", b" ", b"\0" * 8, b"\x7f\xff\xff\xff", b"#", b"\\\n",
)  # fmt: skip
NUMBERS = (
    0,
    1,
    -1,
    3,
    255,
    2**31,
    2**63,
    10**30,
    0.5,
    -1e308,
    1e999,
    None,
    "",
    "a\nb",
    [],
    {},
    True,
)

EXCEPTION = re.compile(
    r"\b[A-Za-z]+(Error|Exception)\b|not iterable|has no attribute|must be integers"
)
"""Texts of Python's exceptions."""

Mutation = Callable[[random.Random], bytes]


def bytes_of(data: bytes, chance: random.Random) -> bytes:
    """Flip, replace, delete, insert, truncate or repeat bytes, in the header more often."""
    found = bytearray(data)
    for _ in range(chance.choice([1, 1, 2, 5])):
        size = max(len(found), 1)
        start = chance.randrange(min(size, 400) if chance.random() < 0.4 else size)
        kind = chance.randrange(7)
        if kind == 0:
            found[start : start + 1] = bytes(
                [(found[start] if found else 0) ^ 1 << chance.randrange(8)]
            )
        elif kind == 1:
            found[start : start + 1] = chance.randbytes(1)
        elif kind == 2:
            del found[start : start + chance.choice([1, 4, 50, 1000])]
        elif kind == 3:
            found[start:start] = chance.randbytes(chance.choice([1, 4, 20]))
        elif kind == 4:
            del found[start:]
        elif kind == 5:
            source = chance.randrange(size)
            found[start:start] = found[source : source + chance.choice([4, 50, 500])]
        else:
            found[start : start + 1] = chance.choice(WORDS)
    return bytes(found)


def numbers_of(text: bytes, chance: random.Random) -> bytes:
    """Replace numbers of a text."""
    found = list(re.finditer(rb"-?\d+(\.\d+)?", text))
    for match in sorted(chance.sample(found, chance.choice([1, 1, 3])), key=lambda m: -m.start()):
        text = text[: match.start()] + chance.choice(WORDS[:9]) + text[match.end() :]
    return text


def json_of(tree: Any, chance: random.Random) -> Any:
    """Replace, remove or copy entries of a JSON tree."""
    for _ in range(chance.choice([1, 1, 2, 4])):
        entries = inner(tree)
        if not entries:
            break
        parent, key = chance.choice(entries)
        other, name = chance.choice(entries)
        kind = chance.randrange(4)
        if kind == 0:
            parent.pop(key)
        elif kind == 1:
            parent[key] = other[name]
        elif kind == 2 and isinstance(parent[key], int):
            parent[key] += chance.choice([-1, 1, 4, 1000])
        else:
            parent[key] = chance.choice(NUMBERS)
        try:
            tree = json.loads(json.dumps(tree))  # an entry that contains itself is not JSON
        except ValueError:
            tree = mesh_files.tree()
    return tree


def inner(tree: Any) -> list[tuple[Any, Any]]:
    """Return every (parent, key) of a tree."""
    if isinstance(tree, dict):
        keys = list(tree)
    else:
        keys = list(range(len(tree))) if isinstance(tree, list) else []
    return [(tree, key) for key in keys] + [pair for key in keys for pair in inner(tree[key])]


def three_mf_of(change: Callable[[bytes, random.Random], bytes], chance: random.Random) -> bytes:
    return mesh_files.zipped({"3D/3dmodel.model": change(MODEL, chance)})


def glb_of(chance: random.Random) -> bytes:
    return mesh_files.glb(json_of(mesh_files.tree(), chance))


def gltf_of(uri: str, chance: random.Random) -> bytes:
    tree = mesh_files.tree()
    tree["buffers"][0]["uri"] = uri
    return json.dumps(json_of(tree, chance)).encode()


def ball(kind: str, **options: Any) -> bytes:
    found = trimesh.creation.icosphere(1).export(file_type=kind, **options)
    return found if isinstance(found, bytes) else found.encode()


COMPONENTS = mesh_files.xml_components(2, 'objectid="1" transform="1 0 0 0 1 0 0 0 1 5 6 7"')
MODEL = mesh_files.xml_model(
    mesh_files.xml_object(1) + COMPONENTS, '<item objectid="2"/><item objectid="1"/>', "millimeter"
).encode()
MIXED = mesh_files.ply_binary([[0, 1, 2, 3], [3, 4, 0], [0, 4, 3, 2, 1]])
KINDS: dict[str, Mutation] = {
    "binary.stl": partial(bytes_of, ball("stl")),
    "text.stl": partial(bytes_of, mesh_files.stl_text().encode()),
    "numbers.stl": partial(numbers_of, mesh_files.stl_text().encode()),
    "binary.ply": partial(bytes_of, ball("ply")),
    "text.ply": partial(bytes_of, ball("ply", encoding="ascii")),
    "mixed.ply": partial(bytes_of, MIXED),
    "big.ply": partial(bytes_of, mesh_files.ply_binary([[0, 1, 2], [3, 4, 0]], ">", "double")),
    "a.obj": partial(bytes_of, ball("obj")),
    "numbers.obj": partial(numbers_of, mesh_files.obj_text().encode()),
    "a.off": partial(bytes_of, ball("off")),
    "numbers.off": partial(numbers_of, mesh_files.off_text().encode()),
    "bytes.glb": partial(bytes_of, mesh_files.glb(mesh_files.tree())),
    "tree.glb": glb_of,
    "side.gltf": partial(gltf_of, "good.bin"),
    "within.gltf": partial(gltf_of, mesh_files.embedded()),
    "zip.3mf": partial(bytes_of, mesh_files.zipped({"3D/3dmodel.model": MODEL})),
    "xml.3mf": partial(three_mf_of, bytes_of),
    "numbers.3mf": partial(three_mf_of, numbers_of),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
def test_a_damaged_file_is_a_mesh_or_is_rejected(
    name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "good.bin").write_bytes(DATA)
    chance = random.Random(zlib.crc32(name.encode()))  # noqa: S311, must be repeatable
    loaded, errors = 0, list[str]()
    for _ in range(COUNT):
        path = written(tmp_path, name, KINDS[name](chance))
        started = time.monotonic()
        try:
            mesh = load_mesh(path)
        except GraspError as error:
            errors.append(str(error))
        else:
            loaded += 1
            assert np.isfinite(mesh.vertices).all()
            assert len(mesh.faces) >= 1
            assert mesh.faces.max() < len(mesh.vertices)
        assert time.monotonic() - started < 20.0
    assert errors  # otherwise nothing was damaged
    assert len(errors) + loaded == COUNT
    assert [text for text in errors if not text.isprintable()] == []
    assert [text for text in errors if EXCEPTION.search(text)] == []
    assert capfd.readouterr().err == ""
