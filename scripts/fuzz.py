"""Give every file reader mutated files: each must soon return a result or a one-sentence error.

A file is an example with some of its bytes or words changed, removed, repeated or moved. It is read
in a child process with limits. The exit code is 1 if a reader raises an error other than grasp3d's.
"""

import argparse
import io
import re
import tempfile
import time
import warnings
import zipfile
import zlib
from collections import Counter
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

import grasp3d
from grasp3d.formats import read_object_pose, read_poses, write_grasps
from grasp3d.formats.format import formats
from grasp3d.formats.poses import GraspPoses
from grasp3d.formats.surface_files import READERS as LABELLED
from grasp3d.formats.surface_files import WRITERS
from grasp3d.hand.hand_files import read_hand, write_hand
from grasp3d.mesh.mesh_files import read_mesh
from grasp3d.system.limited_reading import limited_reading

HAND, SIDES = grasp3d.ParallelGripper.preset("franka"), (("left", ""), ("right", "-"))
BOX = trimesh.creation.box([0.06, 0.04, 0.02])
FINGER = """<joint name="{0}j" type="prismatic"><parent link="hand"/><child link="{0}"/><origin
xyz="0 {1}.005 .06"/><axis xyz="0 {1}1 0"/><limit lower="0" upper=".03"/></joint>
<link name="{0}">"""
BOX_LINK = '<collision><geometry><box size=".02 .01 .04"/></geometry></collision></link>'
URDF = BOX_LINK.join(['<link name="hand">', *(FINGER.format(*side) for side in SIDES), ""])
GEOM = '<geom type="box" size=".01 .005 .02"/>'
SLIDE = '<body name="{0}" pos="0 {1}.005 .06"><joint type="slide" axis="0 {1}1 0" range="0 .03"/>'
MJCF = GEOM + "".join(f"{SLIDE.format(*side)}{GEOM}</body>" for side in SIDES)
TEXTS = {
    "urdf": f'<robot name="a">{URDF}</robot>',
    "mjcf": f"<mujoco><worldbody><body>{MJCF}</body></worldbody></mujoco>",
    "object_pose": "[[1, 0, 0, 0.4], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n",
}
FORMATS = {k: one.suffixes[0] for k, one in formats().items() if one.hands != ("articulated",)}
ROBOT = partial(read_hand, fingers=("left", "right"))
READERS: dict[str, tuple[str, Any]] = {
    **{k: (f".{k}", read_mesh) for k in ("stl", "ply", "obj", "off", "glb", "3mf")},
    "stl_text": (".stl", read_mesh), "ply_text": (".ply", read_mesh),
    **{f"labels{k}": (k, grasp3d.read_labels) for k in LABELLED},
    "gripper": (".json", read_hand), "urdf": (".urdf", ROBOT), "mjcf": (".xml", ROBOT),
    **{name: (suffix, partial(read_poses, hand=HAND)) for name, suffix in FORMATS.items()},
    "contacts": (".csv", grasp3d.read_grasps), "object_pose": (".yaml", read_object_pose),
}  # fmt: skip
NEW = (
    "", "0", "-1", "3", "1e999", "-1e308", "1e200", "1e-320", "nan", "inf", "4294967295", "1_0",
    "1" * 5000, "1,5", "null", "[]", "{}", '"a"', "a" * 70_000, "\\ud800", "\0", "../../etc/passwd",
    "/dev/zero", "hand", "*a", "&b", "<<", "!!python/x", "9" * 400, "mm", "=1+1",
)  # fmt: skip
WORD, PART = rb"[-+.\deE]+|[A-Za-z_]\w*", rb".+\n|<[^<>]*>|\{[^{}]*\}|\[[^][]*\]"


def write_example(name: str, path: Path) -> None:
    """Write an example of a kind of file."""
    kind: Any = name
    mesh = grasp3d.load_mesh(BOX, unit="m", max_edge=0.03)
    if name in TEXTS:
        path.write_text(TEXTS[name])
    elif name == "gripper":
        write_hand(path, HAND)
    elif name == "contacts":
        grasp3d.write_grasps(path, grasp3d.best_grasps(grasp3d.label_surface(mesh), 3))
    elif name.startswith("labels"):
        WRITERS[path.suffix](path, grasp3d.label_surface(mesh, hand=HAND))
    elif name in FORMATS:
        down = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (3, 1, 1))
        poses = GraspPoses(poses=down, opening=0.05, outcome=1.0, scores=0.5, unit="m", hand=HAND)
        write_grasps(path, replace(poses, object_file="box.stl"), format=kind)
    else:
        options = {"stl_text": {"file_type": "stl_ascii"}, "ply_text": {"encoding": "ascii"}}
        BOX.export(path, **options.get(name, {}))


def mutated(data: bytes, rng: np.random.Generator) -> bytes:
    """Mutate an example at a few places; an archive, in one of its members."""
    if data[:2] == b"PK" and rng.random() < 0.7:
        stream = io.BytesIO()
        with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(stream, "w") as new:
            chosen = str(rng.choice(old.namelist()))
            for name in old.namelist():
                member = old.read(name)
                new.writestr(name, mutated(member, rng) if name == chosen else member)
        return stream.getvalue()
    for _ in range(int(rng.geometric(0.6))):
        size, (start, other) = int(2 ** rng.uniform(0, 10)), rng.integers(len(data) + 1, size=2)
        if b"\0" not in data[:200] and rng.random() < 0.7:
            words = re.finditer(PART if rng.random() < 0.3 else WORD, data[: 2**20])
            spans = [one.span() for one in words] or [(0, 0)]
            start, end = spans[int(rng.integers(len(spans)))]
            news = [*(text.encode() for text in NEW), data[start:end] * int(rng.integers(2, 200))]
        else:
            end, parts = start + size, (rng.bytes(size), b"", b"\xff" * 8, b"\1" + bytes(7))
            news = [*parts, data[start:end] * 20, data[other : other + size]]
        data = data[:start] + news[int(rng.integers(len(news)))] + data[end:]
    return data


def outcome_of(name: str, path: Path, key: list[int], example: bytes) -> str:
    """Outcome of reading a mutated file: 'read', the class of a GraspError, or 'FAILED: ...'."""
    path.write_bytes(mutated(example, np.random.default_rng([zlib.crc32(name.encode()), *key])))
    try:
        with limited_reading(), warnings.catch_warnings():
            warnings.simplefilter("error")
            READERS[name][1](path)
    except grasp3d.GraspError as error:
        return type(error).__name__ if str(error).isprintable() else f"FAILED: {error!r}"
    except Exception as error:  # noqa: BLE001, what must not happen
        return f"FAILED: {type(error).__name__}: {error}"[:200]
    return "read"


def main() -> int:
    """Run the readers, and print the outcomes for each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--reader", nargs="+", default=list(READERS), choices=READERS)
    parser.add_argument("--count", type=int, default=1000, help="files of each reader")
    parser.add_argument("--seed", type=int, default=0)
    options, failed = parser.parse_args(), 0
    for name in options.reader:
        outcomes, longest = Counter[str](), 0.0
        with tempfile.TemporaryDirectory(prefix="fuzz-") as place:
            write_example(name, path := Path(place, f"example{READERS[name][0]}"))
            example = path.read_bytes()
            for number in range(options.count):
                started = time.monotonic()
                outcomes[outcome_of(name, path, [options.seed, number], example)] += 1
                longest = max(longest, time.monotonic() - started)
        failed += sum(outcome.startswith("FAILED") for outcome in outcomes)
        print(f"{name:16} longest {longest:.1f} s, {dict(outcomes)}", flush=True)
    return int(failed > 0)


if __name__ == "__main__":
    raise SystemExit(main())
