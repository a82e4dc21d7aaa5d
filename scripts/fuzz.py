"""Give every reader of files mutated ones: only errors of grasp3d may come, soon, in little memory.

fuzz.py --record fuzz.json                    10,000 of each reader, or as many as are left of them
fuzz.py --record fuzz.json --count 50000      so many of each; what the record has is not repeated
fuzz.py --reader mjcf urdf --count 100        of some readers
fuzz.py --reader mjcf --show 17 > bad.xml     the 17th mutated file

A file is made of an example by a few mutations of its bytes, or of its structure: numbers, texts,
lines and elements are replaced, repeated, removed and exchanged; members of archives, the JSON of a
GLB and columns of tables are changed within. It depends on --seed, the reader and its number only.
One process reads the files of a reader; it is ended when a file takes longer than 20 s, or 8 GB,
and the next file is given to a new one. Ends with 1 if any reader failed; the record says at which.
"""

import argparse
import contextlib
import io
import json
import multiprocessing
import re
import struct
import sys
import tempfile
import time
import traceback
import zipfile
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import psutil

SECONDS, MEMORY = 20.0, 8e9
"""Longest time [s] and most memory [bytes] of one file, with all processes of its reader."""

GROWTH = 2**20
"""Size from which files do not grow further [bytes]."""

Mutated = Callable[[bytes, np.random.Generator], bytes]


class Reader(NamedTuple):
    """What reads files of one format."""

    suffix: str
    read: Callable[[Path], object]
    is_text: bool = True
    inside: Mutated | None = None
    """Changes what the bytes contain: members, columns."""


def readers() -> dict[str, Reader]:
    """All readers by name."""
    import grasp3d
    from grasp3d.export.stored import stored_settings
    from grasp3d.grasps import read_object_pose
    from grasp3d.grasps.pose_files import read_poses
    from grasp3d.hand.hand_files import read_hand
    from grasp3d.reading.mesh_files import read_mesh

    hand = grasp3d.ParallelGripper.preset("franka")

    def poses(path: Path) -> object:
        return read_poses(path, hand=hand)

    def robot(path: Path) -> object:
        return read_hand(path, fingers=("left", "right"))

    def labels(path: Path) -> object:
        stored_settings(path)
        return grasp3d.read_labels(path)

    return {
        "stl": Reader(".stl", read_mesh, is_text=False),
        "stl_text": Reader(".stl", read_mesh),
        "ply": Reader(".ply", read_mesh, is_text=False),
        "ply_text": Reader(".ply", read_mesh),
        "obj": Reader(".obj", read_mesh),
        "off": Reader(".off", read_mesh),
        "gltf": Reader(".gltf", read_mesh),
        "glb": Reader(".glb", read_mesh, is_text=False, inside=in_glb),
        "3mf": Reader(".3mf", read_mesh, is_text=False, inside=in_zip),
        "labelled_ply": Reader(".ply", labels, is_text=False),
        "labelled_npz": Reader(".npz", labels, is_text=False, inside=in_zip),
        "labelled_vtp": Reader(".vtp", labels),
        "labelled_parquet": Reader(".parquet", labels, is_text=False, inside=in_parquet),
        "gripper": Reader(".json", read_hand),
        "urdf": Reader(".urdf", robot),
        "mjcf": Reader(".xml", robot),
        "poses_json": Reader(".json", poses),
        "poses_csv": Reader(".csv", poses),
        "poses_parquet": Reader(".parquet", poses, is_text=False, inside=in_parquet),
        "poses_isaac": Reader(".yaml", poses),
        "poses_acronym": Reader(".h5", poses, is_text=False),
        "poses_graspgen": Reader(".json", poses),
        "poses_graspnet": Reader(".npy", poses, is_text=False),
        "poses_moveit": Reader(".json", poses),
        "contacts_json": Reader(".json", grasp3d.read_grasps),
        "contacts_csv": Reader(".csv", grasp3d.read_grasps),
        "contacts_parquet": Reader(
            ".parquet", grasp3d.read_grasps, is_text=False, inside=in_parquet
        ),
        "object_pose_yaml": Reader(".yaml", read_object_pose),
        "object_pose_json": Reader(".json", read_object_pose),
        "object_pose_npy": Reader(".npy", read_object_pose, is_text=False),
    }


URDF = """<?xml version="1.0"?>
<robot name="hand">
 <link name="hand"><collision><origin xyz="0 0 0.03" rpy="0 0 0"/>
  <geometry><box size="0.06 0.12 0.06"/></geometry></collision>
  <collision><geometry><cylinder radius="0.01" length="0.02"/></geometry></collision>
  <collision><geometry><sphere radius="0.01"/></geometry></collision></link>
 <link name="left"><collision><origin xyz="0 0.005 0.02"/>
  <geometry><box size="0.02 0.01 0.04"/></geometry></collision></link>
 <link name="right"><collision>
  <geometry><mesh filename="package://seeds/finger.stl" scale="1"/></geometry></collision></link>
 <link name="camera"/>
 <joint name="mount" type="fixed"><parent link="hand"/><child link="camera"/></joint>
 <joint name="one" type="prismatic"><parent link="hand"/><child link="left"/>
  <origin xyz="0 0.001 0.06"/><axis xyz="0 1 0"/><limit lower="0" upper="0.03" effort="1"/></joint>
 <joint name="two" type="prismatic"><parent link="hand"/><child link="right"/>
  <origin xyz="0 -0.001 0.06" rpy="0 0 3.14159265358979"/><axis xyz="0 1 0"/>
  <limit lower="0" upper="0.03"/><mimic joint="one" multiplier="1" offset="0"/></joint>
</robot>
"""

MJCF = """<mujoco model="hand">
 <compiler angle="radian" meshdir="."/>
 <size nuser_body="2"/>
 <option timestep="0.002"/>
 <default><geom solimp="0.9 0.95 0.001"/></default>
 <asset><mesh name="finger" file="finger.stl" scale="1 1 1"/>
  <texture name="t" type="2d" builtin="checker" width="8" height="8"/>
  <hfield name="f" nrow="4" ncol="4" size="1 1 1 1"/></asset>
 <worldbody>
  <body name="hand" pos="1 2 3" euler="0.3 0.2 0.1">
   <geom type="box" size="0.03 0.06 0.03" pos="0 0 0.03"/>
   <geom type="sphere" size="0.5" contype="0" conaffinity="0"/>
   <body name="left" pos="0 0.001 0.06">
    <joint name="one" type="slide" axis="0 1 0" limited="true" range="0 0.03"/>
    <geom type="box" size="0.01 0.005 0.02" pos="0 0.005 0.02"/>
   </body>
   <body name="right" pos="0 -0.001 0.06" quat="0 0 0 1">
    <joint name="two" type="slide" axis="0 1 0" limited="true" range="0 0.03"/>
    <geom type="mesh" mesh="finger"/>
   </body>
   <replicate count="3" offset="0.001 0 0"><geom size="0.01"/></replicate>
  </body>
 </worldbody>
 <equality><joint joint1="two" joint2="one" polycoef="0 1 0 0 0"/></equality>
</mujoco>
"""


def make_seeds(folder: Path) -> None:
    """Write an example of each reader's format."""
    import trimesh

    import grasp3d
    from grasp3d.export.parquet import write_fields
    from grasp3d.grasps.pose_files import write_poses
    from grasp3d.grasps.poses import GraspPoses
    from grasp3d.hand.hand_files import write_hand

    hand = grasp3d.ParallelGripper.preset("franka")
    box = trimesh.creation.box([0.06, 0.04, 0.02])
    for name, kind in {"stl": "stl", "stl_text": "stl_ascii", "ply": "ply", "obj": "obj",
                       "off": "off", "glb": "glb", "3mf": "3mf"}.items():  # fmt: skip
        (folder / name).write_bytes(_bytes(box.export(file_type=kind)))
    (folder / "ply_text").write_bytes(_bytes(box.export(file_type="ply", encoding="ascii")))
    parts = trimesh.Scene(box).export(file_type="gltf")
    tree = json.loads(parts["model.gltf"])
    for buffer in tree["buffers"]:
        data = np.frombuffer(parts[buffer["uri"]], np.uint8).tobytes()
        buffer["uri"] = "data:application/octet-stream;base64," + _base64(data)
    (folder / "gltf").write_text(json.dumps(tree), encoding="utf-8")
    finger = trimesh.creation.box([0.02, 0.01, 0.04])
    finger.apply_translation([0.0, 0.005, 0.02]).export(folder / "finger.stl")
    (folder / "urdf").write_text(URDF, encoding="utf-8")
    (folder / "mjcf").write_text(MJCF, encoding="utf-8")
    _write(folder / "gripper", ".json", lambda path: write_hand(path, hand))
    mesh = grasp3d.load_mesh(box, unit="m", max_edge=0.02)
    labels = grasp3d.label_surface(mesh, hand=hand)
    for name, write in {"ply": grasp3d.write_ply, "npz": grasp3d.write_npz,
                        "vtp": grasp3d.write_vtp, "parquet": write_fields}.items():  # fmt: skip
        path = folder / f"labelled_{name}"
        write(path.with_suffix(f".{name}"), labels)
        path.with_suffix(f".{name}").replace(path)
    turned = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (3, 1, 1))
    poses = GraspPoses(
        poses=turned, opening=0.05, pregrasp_opening=0.07, scores=0.5, outcome=1.0, unit="m",
        hand=hand, object_file="box.stl", columns={"label": np.array(["S", "M", "=U"])},
    )  # fmt: skip
    for name, suffix in {"json": ".json", "csv": ".csv", "parquet": ".parquet", "isaac": ".yaml",
                         "acronym": ".h5", "graspgen": ".json", "graspnet": ".npy",
                         "moveit": ".json"}.items():  # fmt: skip
        kind: Any = "isaac_grasp" if name == "isaac" else name
        write_to = lambda path, kind=kind: write_poses(path, poses, format=kind)  # noqa: E731
        _write(folder / f"poses_{name}", suffix, write_to)
    grasps = grasp3d.best_grasps(grasp3d.label_surface(mesh), 3)
    for suffix in ("json", "csv", "parquet"):
        _write(
            folder / f"contacts_{suffix}",
            f".{suffix}",
            lambda path: grasp3d.write_grasps(path, grasps),
        )
    pose = {
        "header": {"frame_id": "base"},
        "pose": {
            "position": {"x": 0.4, "y": 0, "z": 0.1},
            "orientation": {"x": 0, "y": 0, "z": 0, "w": 1},
        },
    }
    for name in ("object_pose_json", "object_pose_yaml"):
        (folder / name).write_text(json.dumps(pose, indent=1), encoding="utf-8")
    np.save(folder / "m.npy", np.eye(4))
    (folder / "m.npy").replace(folder / "object_pose_npy")


def _bytes(exported: str | bytes) -> bytes:
    return exported.encode() if isinstance(exported, str) else exported


def _base64(data: bytes) -> str:
    import base64

    return base64.b64encode(data).decode("ascii")


def _write(path: Path, suffix: str, write: Callable[[Path], None]) -> None:
    """Write a file whose format follows from its suffix, and leave it without one."""
    write(path.with_suffix(suffix))
    path.with_suffix(suffix).replace(path)


NUMBERS = (
    "0", "-1", "1", "2", "3", "-0", "1e999", "-1e308", "1e-320", "nan", "inf", "-inf", "NaN", "",
    "Infinity", "1e8", "2147483648", "4294967295", "-9223372036854775809", "1" * 400, "1" * 5000,
    "0x10", "1_000", "1,5", "1 2", "0.1", "1e60", "1e-60", "null", "true", "[]", "{}", '"a"',
    "\N{ARABIC-INDIC DIGIT THREE}", "10**9", "1e1e1", "+5", "00", "3.",
)  # fmt: skip
TEXTS = (
    "", "a" * 300, "a" * 70_000, "\\ud800", "\\u0000", "\0", "../../etc/passwd", "/dev/zero",
    "hand", "left", "right", "finger.stl", "=1+1", "'@x", "\u202e", "\\n", "nan", "m", "mm", "none",
    "yes", "\N{GRINNING FACE}", "\udcff", "%s%n", "*a", "&b", "<<", "!!python/object:os.system",
    "file:///",
)  # fmt: skip
WORDS = re.compile(r"""[-+]?\d[\d.]*(?:[eE][-+]?\d+)?|"[^"\n]{0,200}"|[A-Za-z_]\w*""")
INTEGERS = (0, 1, 2, 3, 255, 256, 65_535, 2**31 - 1, 2**31, 2**32 - 1, 2**63, 2**64 - 1)


def mutated(seed: bytes, reader: Reader, others: list[bytes], rng: np.random.Generator) -> bytes:
    """An example after a few mutations, mostly one."""
    data = seed
    for _ in range(int(rng.geometric(0.6))):
        if len(data) > GROWTH:
            break
        kind = rng.random()
        if reader.inside is not None and kind < 0.6:
            with contextlib.suppress(Exception):  # it may be no archive any more
                data = reader.inside(data, rng)
        elif reader.is_text and kind < 0.8:
            data = in_text(data, rng)
        else:
            data = in_bytes(data, others, rng)
    return data


def in_bytes(data: bytes, others: list[bytes], rng: np.random.Generator) -> bytes:
    """Bytes with a few changed, removed, repeated, inserted or taken from elsewhere."""
    if not data:
        return rng.bytes(16)
    start, kind = int(rng.integers(len(data))), int(rng.integers(9))
    size = min(int(2 ** rng.uniform(0, 10)), len(data) - start)
    end = start + size
    part, before, after = data[start:end], data[:start], data[end:]
    if kind == 0:
        part = bytes([part[0] ^ (1 << int(rng.integers(8)))]) + part[1:]
    elif kind == 1:
        part = rng.bytes(size)
    elif kind == 2:
        part = b""
    elif kind == 3:
        part = after = b""
    elif kind == 4:
        part *= int(rng.integers(2, 50))
    elif kind == 5:
        other = others[int(rng.integers(len(others)))]
        at = int(rng.integers(len(other)))
        part = other[at : at + size]
    elif kind == 6:
        value, width = INTEGERS[int(rng.integers(len(INTEGERS)))], 2 ** int(rng.integers(4))
        part = (value % 2 ** (8 * width)).to_bytes(width, "little")
        after = data[start + width :]
    elif kind == 7:
        part = bytes(size)
    else:
        part = rng.bytes(size) + part
    return before + part + after


def in_text(data: bytes, rng: np.random.Generator) -> bytes:
    """Text with numbers, texts, lines or elements changed."""
    text = data.decode("utf-8", "surrogateescape")
    kind = int(rng.integers(8))
    if kind < 4:
        text = _in_words(text, rng)
    elif kind < 6:
        text = _in_lines(text, rng)
    elif kind == 6:
        spans = [match.span() for match in re.finditer(r"<[^<>]*/>|\{[^{}]*\}|\[[^][]*\]", text)]
        text = _moved(text, spans, rng)
    else:
        spans = [
            match.span() for match in re.finditer(r"<(\w+)[^<>]*>.*?</\1>|\[.*?\]", text, re.DOTALL)
        ]
        text = _moved(text, spans, rng)
    return text.encode("utf-8", "surrogateescape" if "\udcff" not in text else "surrogatepass")


def _in_words(text: str, rng: np.random.Generator) -> str:
    """Another number or text in place of one, or one of the others of the file."""
    words = list(WORDS.finditer(text[:GROWTH]))
    if not words:
        return text
    word = words[int(rng.integers(len(words)))]
    choices: tuple[str, ...] = NUMBERS if word[0][0] in "+-0123456789" else TEXTS
    if rng.random() < 0.2:
        choices = NUMBERS + TEXTS
    new = choices[int(rng.integers(len(choices)))]
    if rng.random() < 0.2:
        new = words[int(rng.integers(len(words)))][0].strip('"')
    quote = '"' if word[0].startswith('"') else ""
    return text[: word.start()] + quote + new + quote + text[word.end() :]


def _in_lines(text: str, rng: np.random.Generator) -> str:
    lines = text.splitlines(keepends=True) or ["\n"]
    at, kind = int(rng.integers(len(lines))), int(rng.integers(4))
    other = lines[int(rng.integers(len(lines)))]
    if kind == 0:
        lines[at : at + 1] = [lines[at]] * min(
            int(rng.integers(2, 200)), 1 + GROWTH // len(lines[at])
        )
    elif kind == 1:
        del lines[at]
    elif kind == 2:
        lines[at] = other
    else:
        lines.insert(at, other[: int(rng.integers(len(other) + 1))])
    return "".join(lines)


def _moved(text: str, spans: list[tuple[int, int]], rng: np.random.Generator) -> str:
    """Elements removed, repeated, or put in place of or into each other."""
    if not spans:
        return text
    start, end = spans[int(rng.integers(len(spans)))]
    one, two = spans[int(rng.integers(len(spans)))]
    kind, part = int(rng.integers(5)), text[start:end]
    if kind == 0:
        return text[:start] + text[end:]
    if kind == 1:
        return (
            text[:end] + part * min(int(2 ** rng.uniform(0, 9)), GROWTH // len(part)) + text[end:]
        )
    if kind == 2:
        return text[:start] + text[one:two] + text[end:]
    if kind == 3:
        return text[: start + 1] + text[one:two] + text[start + 1 :]
    depth = int(2 ** rng.uniform(0, 11))
    return text[:start] + "[" * depth + part + "]" * depth + text[end:]


def in_zip(data: bytes, rng: np.random.Generator) -> bytes:
    """An archive with a mutated member, or with members removed or repeated."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = {entry.filename: archive.read(entry) for entry in archive.infolist()}
    name = list(members)[int(rng.integers(len(members)))]
    if rng.random() < 0.1:
        del members[name]
    else:
        change = in_text if name.endswith((".model", ".rels", ".xml")) else None
        members[name] = (
            change(members[name], rng) if change else in_bytes(members[name], [data], rng)
        )
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return stream.getvalue()


def in_glb(data: bytes, rng: np.random.Generator) -> bytes:
    """A GLB with mutated JSON."""
    length = struct.unpack_from("<I", data, 12)[0]
    text, rest = in_text(data[20 : 20 + length], rng), data[20 + length :]
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sII", b"glTF", 2, 20 + len(text) + len(rest))
    return head + struct.pack("<II", len(text), 0x4E4F534A) + text + rest


def in_parquet(data: bytes, rng: np.random.Generator) -> bytes:
    """A Parquet table with columns of other names, types and values, or other metadata."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pq.read_table(io.BytesIO(data))
    at = int(rng.integers(table.num_columns))
    name, rows, kind = table.column_names[at], table.num_rows, int(rng.integers(9))
    values = table.column(at).to_pylist()
    if kind == 0:
        table = table.remove_column(at)
    elif kind == 1:
        table = table.rename_columns(
            [
                TEXTS[int(rng.integers(12))] if k == at else n
                for k, n in enumerate(table.column_names)
            ]
        )
    elif kind == 2:
        table = table.append_column(table.column_names[0], table.column(at))
    elif kind == 3:
        table = table.take(rng.integers(rows, size=int(rng.integers(20))).tolist())
    elif kind == 4 and rows:
        text = TEXTS[int(rng.integers(len(TEXTS)))].encode("utf-8", "replace").decode()
        table = table.set_column(at, name, pa.array([text] * rows))
    elif kind == 5 and rows:
        numbers = [0.0, -1.0, np.nan, np.inf, 1e300, 1e-300, 2.0**63, 3.0]
        column = [numbers[int(k)] for k in rng.integers(len(numbers), size=rows)]
        table = table.set_column(at, name, pa.array(column))
    elif kind == 6 and rows:
        values[int(rng.integers(rows))] = None
        table = table.set_column(at, name, pa.array(values))
    elif kind == 7:
        kinds = [pa.list_(pa.float64()), pa.decimal128(20), pa.date32(), pa.binary(), pa.null()]
        empty = pa.nulls(rows, kinds[int(rng.integers(len(kinds)))])
        table = table.set_column(at, name, empty)
    else:
        metadata = dict(table.schema.metadata or {})
        metadata = {key: in_text(value, rng) for key, value in metadata.items()}
        table = table.replace_schema_metadata(metadata)
    stream = io.BytesIO()
    pq.write_table(table, stream)
    return stream.getvalue()


def file_of(name: str, reader: Reader, number: int, seed: int, seeds: dict[str, bytes]) -> bytes:
    """The mutated file of a number."""
    rng = np.random.default_rng([seed, zlib.crc32(name.encode()), number])
    return mutated(seeds[name], reader, list(seeds.values()), rng)


def serve(name: str, numbers: range, seed: int, folder: str, state: Any, answers: Any) -> None:
    """Read the mutated files of a reader, and report what became of them."""
    from grasp3d.errors import GraspError

    reader, seeds = readers()[name], seeds_in(Path(folder))
    outcomes, longest = Counter[str](), (0.0, -1)
    with tempfile.TemporaryDirectory(prefix="fuzz-") as place:
        here = Path(place, "seeds")  # as packages have it
        here.mkdir()
        (here / "finger.stl").write_bytes(seeds["finger.stl"])
        path = here / f"{name}{reader.suffix}"
        for number in numbers:
            state[0], state[1] = number, time.time()
            path.write_bytes(file_of(name, reader, number, seed, seeds))
            started = state[1] = time.time()
            try:
                reader.read(path)
                outcome = "read"
            except GraspError as error:
                outcome = type(error).__name__
                if "\n" in str(error) or "please report" in str(error):
                    answers.put(("failure", number, f"message {error}"))
            except BaseException as error:  # noqa: BLE001, what must not happen
                outcome = "failed"
                where = traceback.extract_tb(error.__traceback__)[-1]
                text = f"{type(error).__name__}: {error}"[:200]
                answers.put(("failure", number, f"{text} ({where.filename}:{where.lineno})"))
            outcomes[outcome] += 1
            longest = max(longest, (time.time() - started, number))
            if number % 50 == 0 or number == numbers[-1]:
                answers.put(("done", number + 1, dict(outcomes), longest))
                outcomes.clear()


def seeds_in(folder: Path) -> dict[str, bytes]:
    """The examples by name."""
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


class Run:
    """The files of one reader, with what became of them."""

    def __init__(self, name: str, record: dict[str, Any], seed: int, folder: Path) -> None:
        self.name, self._seed, self._folder = name, seed, folder
        entry = record.setdefault(f"{name}, seed {seed}", {})
        entry.setdefault("done", 0)
        for key, kind in {"outcomes": dict, "failures": list}.items():
            entry.setdefault(key, kind())
        entry.setdefault("longest", [0.0, -1])
        entry.setdefault("memory", 0.0)
        self.entry = entry

    def read(self, count: int, seconds: float) -> Iterator[None]:
        """Read files until there are so many, or for a time; yields when the record has changed."""
        ends = time.time() + seconds
        while self.entry["done"] < count and time.time() < ends:
            yield from self._process(range(self.entry["done"], count), ends)

    def _process(self, numbers: range, ends: float) -> Iterator[None]:
        context = multiprocessing.get_context("spawn")
        state, answers = (
            context.Array("d", [numbers.start - 1.0, time.time() + 60.0]),
            context.Queue(),
        )
        arguments = self.name, numbers, self._seed, str(self._folder), state, answers
        process = context.Process(target=serve, args=arguments, daemon=True)
        process.start()
        reason = ""
        while process.is_alive() and not reason and time.time() < ends:
            time.sleep(0.2)
            memory = _memory(process.pid)
            self.entry["memory"] = max(self.entry["memory"], memory)
            if time.time() - state[1] > SECONDS:
                reason = f"took longer than {SECONDS:g} s"
            elif memory > MEMORY:
                reason = f"took more than {MEMORY / 1e9:g} GB"
            self._take(answers)
            yield
        if process.is_alive():
            process.kill()
        process.join()
        self._take(answers)
        if not reason and process.exitcode and time.time() < ends:
            reason = f"ended the process with code {process.exitcode}"
        if reason:
            self.entry["failures"].append([int(state[0]), reason])
            self.entry["done"] = max(self.entry["done"], int(state[0]) + 1)
        yield

    def _take(self, answers: Any) -> None:
        time.sleep(0.05)
        while not answers.empty():
            kind, number, *rest = answers.get()
            if kind == "failure":
                self.entry["failures"].append([number, *rest])
                continue
            self.entry["done"] = max(self.entry["done"], number)
            total = Counter(self.entry["outcomes"])
            total.update(rest[0])
            self.entry["outcomes"] = dict(total)
            self.entry["longest"] = list(max(tuple(self.entry["longest"]), tuple(rest[1])))


def _memory(pid: int | None) -> float:
    """Memory of a process and its descendants [bytes]."""
    total = 0.0
    with contextlib.suppress(psutil.Error):
        root = psutil.Process(pid)
        for process in (root, *root.children(recursive=True)):
            total += process.memory_info().rss
    return total


def main() -> int:
    """Run it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--reader", nargs="+", help="names of readers; else all")
    parser.add_argument("--count", type=int, default=10_000, help="files of each reader")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="time in all")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--record", type=Path, help="file of what was done, to go on from")
    parser.add_argument("--show", type=int, help="write the file of this number instead")
    options = parser.parse_args()
    names = options.reader or list(readers())
    record = (
        json.loads(options.record.read_text(encoding="utf-8"))
        if options.record is not None and options.record.exists()
        else {}
    )
    with tempfile.TemporaryDirectory(prefix="fuzz-seeds-") as place:
        folder = Path(place)
        make_seeds(folder)
        if options.show is not None:
            reader = readers()[names[0]]
            data = file_of(names[0], reader, options.show, options.seed, seeds_in(folder))
            sys.stdout.buffer.write(data)
            return 0
        ends, failed = time.time() + options.seconds, 0
        for name in names:
            run, saved = Run(name, record, options.seed, folder), time.time()
            for _ in run.read(options.count, ends - time.time()):
                if options.record is not None and time.time() - saved > 2.0:
                    saved = _save(options.record, record)
            entry = run.entry
            failed += len(entry["failures"])
            print(
                f"{name:18} {entry['done']:>8,} files, longest {entry['longest'][0]:.2f} s, "
                f"{entry['memory'] / 1e9:.1f} GB, {entry['outcomes']}, "
                f"failures {entry['failures'][:3]}",
                flush=True,
            )
            if options.record is not None:
                _save(options.record, record)
    return int(failed > 0)


def _save(path: Path, record: dict[str, Any]) -> float:
    path.write_text(json.dumps(record, indent=1), encoding="utf-8")
    return time.time()


if __name__ == "__main__":
    sys.exit(main())
