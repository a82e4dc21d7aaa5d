import hashlib
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from grasp3d import GraspModel, MeshOptions, Sampling, label_surface, load_mesh
from grasp3d.batch import labelling
from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.labelling import content_hash, mesh_key, settings_key, settings_text
from grasp3d.errors import MeshError
from grasp3d.hand.reach_settings import ReachSettings
from tests.helpers import shapes
from tests.helpers.grippers import HAND

GOLDEN = "746952c467030564"


def test_labels_are_those_of_this_version_of_the_method() -> None:
    lines = [f"method {labelling.METHOD}"]
    surfaces = {
        "box": (shapes.box((1.0, 0.6, 0.8)), GraspModel(), Sampling(rays=16)),
        "cone": (shapes.cone(0.35, sections=24), GraspModel(0.75), Sampling(max_opening=0.3)),
        "three": (shapes.sphere(1), GraspModel(fingers=3), Sampling(candidates=16)),
    }
    for name, (surface, model, sampling) in surfaces.items():
        labels = label_surface(load_mesh(surface, max_edge=0.5), model, sampling=sampling)
        angles = np.where(np.isinf(labels.critical_angle), 9.0, labels.critical_angle)
        rounded = (np.round(angles, 3) + 0.0).tolist()
        lines.append(f"{name} {labels.label.tolist()} {rounded}")
    assert hashlib.sha256("\n".join(lines).encode()).hexdigest()[:16] == GOLDEN, (
        "labels of the same mesh have changed: increase METHOD in grasp3d/batch/identity.py, so "
        "that stores label their meshes again, and put the new value here"
    )


def test_a_key_depends_on_the_content_and_all_settings(monkeypatch: pytest.MonkeyPatch) -> None:
    def key(content: str = "c", own: dict[str, Any] | None = None, **changes: Any) -> str:
        return mesh_key(content, replace(BatchSettings(), **changes), own or {})

    def held(*arguments: Any, clearance: float = HAND.clearance, **options: Any) -> str:
        hand = replace(HAND, clearance=clearance)
        return key(reach=ReachSettings(hand, *arguments, **options))

    keys = [
        key(), key("d"), key(own={"scale": 2.0}), key(own={"scale": 3.0}), key(own={"unit": "m"}),
        key(best=4), key(model=GraspModel(friction=0.25)), key(sampling=Sampling(max_opening=0.1)),
        key(mesh=MeshOptions(unit="mm")), key(mesh=MeshOptions(scale=2.0)),
        held(), held("as-is"), held("as-is", "y"), held("stable"), held(approach_within=1.0),
        held(clearance=0.001),
    ]  # fmt: skip
    assert len(set(keys)) == len(keys)
    assert key(model=GraspModel(), sampling=Sampling()) == keys[0]
    assert held("as-is") == keys[11]
    whole, point = (BatchSettings(GraspModel(friction=one)) for one in (1, 1.0))
    assert settings_key(whole) == settings_key(point)
    assert '"max_opening":null' in settings_text(BatchSettings())
    monkeypatch.setattr(labelling, "METHOD", 99)
    assert key() != keys[0]


def test_the_content_hash_covers_the_file_and_its_side_files(tmp_path: Path) -> None:
    one, two = tmp_path / "one.stl", tmp_path / "two.stl"
    for path in (one, two):
        path.write_bytes(b"mesh")
    assert content_hash(one) == content_hash(two) == hashlib.sha256(b"mesh").hexdigest()
    gltf = tmp_path / "a.gltf"
    gltf.write_text('{"buffers": [{"uri": "a%20b.bin"}, {"uri": "data:;base64,AA"}], '
                    '"images": [{"uri": "c.png"}]}', encoding="ascii")  # fmt: skip
    hashes = [content_hash(gltf)]
    for name, data in (("a b.bin", b"1"), ("a b.bin", b"2"), ("c.png", b"3"), ("a.bin", b"4")):
        (tmp_path / name).write_bytes(data)
        hashes.append(content_hash(gltf))
    assert hashes[0] != hashes[1] != hashes[2] == hashes[3] == hashes[4]
    glb = tmp_path / "a.glb"
    text = gltf.read_bytes()
    glb.write_bytes(struct.pack("<4sIII4s", b"glTF", 2, 0, len(text), b"JSON") + text)
    first = content_hash(glb)
    (tmp_path / "a b.bin").write_bytes(b"5")
    assert content_hash(glb) != first
    for path, reason in ((tmp_path / "no.stl", "no such file"), (tmp_path, "is a folder")):
        with pytest.raises(MeshError, match=reason):
            content_hash(path)
