"""The row, the surface and the best grasps of one mesh of a batch, and what identifies them."""

import hashlib
import math
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from grasp3d import GraspModel, MeshOptions, Sampling, Table, best_grasps, label_surface, load_mesh
from grasp3d.batch import labelling
from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.chunks import LabelledMesh
from grasp3d.batch.inputs import MeshFile
from grasp3d.batch.labelling import Job, JobSettings, content_hash, label_jobs, settings_key
from grasp3d.batch.row import Outcome, Row
from grasp3d.describe import verdict_of
from grasp3d.errors import MeshError, SettingError
from grasp3d.formats import read_labels
from grasp3d.hand.reach_settings import ReachSettings
from grasp3d.quality.loads import Load
from grasp3d.settings.pose_error import PoseError
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.sweeps import label_fractions, vertex_weights
from grasp3d.system.context import running
from tests.helpers import shapes
from tests.helpers.commands import export
from tests.helpers.grippers import HAND
from tests.helpers.jobs import TIMINGS

SETTINGS = BatchSettings(
    GraspModel(friction=0.4), Sampling(rays=16), MeshOptions(unit="cm", max_edge="0.2cm"), best=2
)


def egg(folder: Path) -> Path:
    vertices, faces = shapes.sphere(2)
    return export(folder / "egg.ply", (vertices * (1.0, 1.0, 1.6), faces))


def done_of(source: Path, settings: BatchSettings = SETTINGS, **own: Any) -> LabelledMesh:
    mesh = MeshFile(source.name, str(source), source.stat().st_size, "stamp", own)
    job = Job(mesh, source.stem, f"surfaces/{source.stem}.ply")
    [done] = label_jobs([job], JobSettings(settings, "ply", has_pages=True, force=False))
    return done


def labels_of(source: Path, **options: Any) -> SurfaceLabels:
    mesh = load_mesh(source, SETTINGS.mesh)
    return label_surface(mesh, SETTINGS.model, sampling=SETTINGS.sampling, **options)


def quantiles(row: Row, name: str, percents: tuple[int, ...] = (10, 50, 90)) -> list[float]:
    return [getattr(row, f"{name}_p{percent}") for percent in percents]


@pytest.mark.slow
def test_a_row_has_the_values_of_the_labels_whatever_threads_there_are(tmp_path: Path) -> None:
    source = egg(tmp_path)
    done, labels = done_of(source), labels_of(source)
    row = done.row
    assert (row.outcome, row.error, row.unit, row.file_unit, row.closed) == (
        "labelled", "", "m", "cm", True,
    )  # fmt: skip
    assert (row.stable, row.ambiguous, row.no_grasp_found) == tuple(labels.fractions().values())
    for name in ("critical_angle", "margin", "epsilon", "epsilon_min"):
        expected = labels.quantiles(name, [0.1, 0.5, 0.9])
        assert expected is not None
        assert quantiles(row, name) == expected.tolist()
    weights = labels.mesh.vertex_areas / labels.mesh.vertex_areas.sum()
    for values, median in (
        (labels.max_resolution, row.required_resolution_50 or 0.0),
        (labels.margin, row.margin_p50 or 0.0),
    ):
        assert weights[values > median + 1e-9].sum() <= 0.5 <= weights[values > median - 1e-9].sum()
    needed = labels.angle_distribution().required_resolution(0.8, friction=0.4)
    assert row.required_resolution_80 == pytest.approx(needed)
    sizes = (labels.mesh.volume, 1e-4 * trimesh.load_mesh(source).area)
    assert (row.volume, row.area) == pytest.approx(sizes, rel=0.01)
    assert (row.vertices, row.search_angle) == (len(labels.mesh.vertices), labels.search.cone)
    assert 0.0 < (row.seconds_labelling or 0.0) < row.seconds
    best = best_grasps(labels, 2)
    for number, grasp in enumerate(row.grasps):
        assert grasp.critical_angle == best.critical_angle[number]
        assert grasp.epsilon == pytest.approx(best.epsilon[number], rel=0.01)
        assert np.allclose(grasp.points, best.contacts.points[number])
        assert np.allclose(grasp.normals, -best.contacts.normals[number])
        across = np.subtract(grasp.points[0], grasp.points[1])
        assert grasp.opening == pytest.approx(np.linalg.norm(across))
        assert np.dot(across, grasp.normals[0]) > 0.0  # outward
    for name, values in done.vertices.items():
        assert np.array_equal(values, getattr(labels, name))
    (tmp_path / "labelled.ply").write_bytes(done.surface)
    assert np.array_equal(read_labels(tmp_path / "labelled.ply").label, labels.label)
    model = row.page.replace(".html", ".glb")
    assert {*done.files} == {row.thumbnail, row.page, model}
    with running(threads=3):
        again = done_of(source)
    timings = {name: getattr(row, name) for name in TIMINGS}
    assert replace(again.row, **timings) == row
    assert again.surface == done.surface
    assert all(again.files[name] == done.files[name] for name in (row.thumbnail, model))


@pytest.mark.slow
def test_with_a_gripper_a_row_has_the_verdict_and_poses(tmp_path: Path) -> None:
    source = egg(tmp_path)
    settings = replace(SETTINGS, reach=ReachSettings(HAND, "as-is"))
    row, fast = (done_of(source, replace(settings, best=best)).row for best in (2, 0))
    labels = labels_of(source, hand=HAND, table=Table.below(load_mesh(source, SETTINGS.mesh)))
    best: Any = best_grasps(labels, 2)
    verdict = verdict_of(labels)
    assert (row.error, row.gripper) == ("", "hand")
    assert (row.verdict, row.verdict_text) == (verdict.word, str(verdict))
    assert (row.stable_grasps, row.spare_resolution) == (verdict.count, verdict.spare_resolution)
    assert row.stable == fast.stable == labels.fractions()["S"]
    assert (fast.verdict, fast.verdict_text, fast.stable_grasps, fast.grasps) == (None,) * 3 + ((),)
    for number, grasp in enumerate(row.grasps):
        assert np.reshape(grasp.pose, (4, 4)) == pytest.approx(best.poses[number])
        assert grasp.approach_margin == best.approach_margin[number]
        assert (grasp.score, grasp.label) == (best.score[number], "S")


def test_what_has_no_grasp_has_a_row_that_says_why(tmp_path: Path) -> None:
    reach = ReachSettings(replace(HAND, min_opening=0.07), "as-is")
    row = done_of(egg(tmp_path), replace(SETTINGS, reach=reach)).row
    assert (row.error, row.verdict, row.stable_grasps, row.grasps) == ("", "not", 0, ())
    assert (row.verdict_text or "").startswith("Not held by hand: too wide or too narrow for the")
    assert (row.causes or "").startswith("too wide or too narrow for the stroke (")
    corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    row = done_of(export(tmp_path / "one.ply", (np.array(corners), np.array([[0, 1, 2]])))).row
    assert (row.outcome, row.grasps, row.volume) == (Outcome.LABELLED, (), None)
    assert row.no_grasp_found == pytest.approx(1.0)
    assert (row.required_resolution_50, row.critical_angle_p50) == (0.0, math.inf)
    with pytest.raises(SettingError, match="a pose error applies to the best grasps"):
        BatchSettings(reach=replace(reach, pose_error=PoseError.of("2mm")), best=0)


@pytest.mark.slow
def test_a_row_has_what_the_labels_say_of_the_load(tmp_path: Path) -> None:
    source, load = egg(tmp_path), Load(mass=0.5, grip_force=40.0)
    model = GraspModel(torsion_radius="3mm", sensor_resolution=0.2)
    settings = replace(SETTINGS, model=model)
    row = done_of(source, replace(settings, load=load)).row
    mesh = load_mesh(source, SETTINGS.mesh)
    labels = label_surface(mesh, model, sampling=SETTINGS.sampling, load=load)
    found, payloads = labels.load_result, labels.quantiles("payload", [0.1, 0.5, 0.9])
    assert found is not None
    assert found.label is not None
    assert payloads is not None
    fractions = label_fractions(found.label, vertex_weights(mesh, "area"))
    assert (row.mass, row.grip_force_available, row.task, row.holds) == (0.5, 40.0, "weight", True)
    assert "N of 40 N to hold 0.5 kg in every orientation" in (row.verdict_text or "")
    assert row.held == pytest.approx(fractions["S"])
    assert row.payload_best == pytest.approx(found.payload.max())
    assert row.grip_force_needed == pytest.approx(found.grip_force_largest.min())
    assert quantiles(row, "payload") == pytest.approx(payloads.tolist())
    assert done_of(source, settings, mass=0.5).row.mass == 0.5  # of its row in a table
    row = done_of(source, replace(settings, load=Load(density=1000.0))).row
    assert row.mass == pytest.approx(1000.0 * mesh.volume)
    assert (row.grip_force_available, row.holds, row.held, row.payload_p50) == (None,) * 4
    assert math.isfinite(row.grip_force_needed or math.nan)


GOLDEN = "aa9d055bee025150"


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
        "labels of the same mesh have changed: increase METHOD in grasp3d/batch/labelling.py, so "
        "that stores label their meshes again, and put the new value here"
    )


def test_a_key_depends_on_the_content_and_all_settings(monkeypatch: pytest.MonkeyPatch) -> None:
    def key(content: str = "c", own: dict[str, Any] | None = None, **changes: Any) -> str:
        return labelling.mesh_key(content, replace(BatchSettings(), **changes), own or {})

    def held(*arguments: Any, clearance: float = HAND.clearance, **options: Any) -> str:
        hand = replace(HAND, clearance=clearance)
        return key(reach=ReachSettings(hand, *arguments, **options))

    keys = [
        key(), key("d"), key(own={"scale": 2.0}), key(own={"scale": 3.0}), key(own={"unit": "m"}),
        key(best=4), key(model=GraspModel(friction=0.25)), key(sampling=Sampling(max_opening=0.1)),
        key(mesh=MeshOptions(unit="mm")), key(mesh=MeshOptions(scale=2.0)),
        held(), held("as-is"), held("as-is", "y"), held("stable"), held(approach_within=1.0),
        held(clearance=0.001), key(load=Load(mass=1.0)), key(load=Load(mass=2.0)),
        key(load=Load(density=1.0)), key(load=Load(task="wrench 1,0,0,0,0,0")),
        key(load=Load(task="wrench 2,0,0,0,0,0")), key(load=Load(grip_force=1.0)),
    ]  # fmt: skip
    assert len(set(keys)) == len(keys)
    assert key(model=GraspModel(), sampling=Sampling()) == keys[0]
    assert held("as-is") == keys[11]
    whole, point = (BatchSettings(GraspModel(friction=one)) for one in (1, 1.0))
    assert settings_key(whole) == settings_key(point)
    assert '"max_opening":null' in labelling.settings_text(BatchSettings())
    monkeypatch.setattr(labelling, "METHOD", 99)
    assert key() != keys[0]


def test_the_content_hash_covers_the_file_and_its_side_files(tmp_path: Path) -> None:
    one = tmp_path / "one.stl"
    one.write_bytes(b"mesh")
    assert content_hash(one) == hashlib.sha256(b"mesh").hexdigest()
    text = '{"buffers": [{"uri": "a%20b.bin"}, {"uri": "data:;base64,AA"}], '
    text += '"images": [{"uri": "c.png"}]}'
    binary = struct.pack("<4sIII4s", b"glTF", 2, 0, len(text), b"JSON") + text.encode()
    for name, content in (("a.gltf", text.encode()), ("a.glb", binary)):
        (tmp_path / name).write_bytes(content)
        hashes = [content_hash(tmp_path / name)]
        for side, data in (("a b.bin", b"1"), ("a b.bin", b"2"), ("c.png", b"3"), ("a.bin", b"4")):
            (tmp_path / side).write_bytes(data)
            hashes.append(content_hash(tmp_path / name))
        assert hashes[0] != hashes[1] != hashes[2] == hashes[3] == hashes[4]
    for path, reason in ((tmp_path / "no.stl", "no such file"), (tmp_path, "is a folder")):
        with pytest.raises(MeshError, match=reason):
            content_hash(path)
