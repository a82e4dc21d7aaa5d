import shutil
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from grasp3d import (
    BatchSettings,
    GraspError,
    GraspModel,
    Load,
    MeshOptions,
    ParallelGripper,
    Sampling,
    SurfaceLabels,
    label_library,
    label_surface,
    load_mesh,
    write_ply,
)
from grasp3d.errors import MeshError, OutputError, SettingError
from grasp3d.formats.stored_surfaces import Stored
from grasp3d.formats.surface_files import READERS, writer_for
from grasp3d.jobs import ClusterSettings
from grasp3d.mesh.sources import Source
from grasp3d.pictures.colors import labels_at
from grasp3d.pictures.subject import Subject, subject_of
from grasp3d.surface import Reason
from grasp3d.surface.antipodal import OPENING_SLACK
from grasp3d.system.context import running
from grasp3d.viewer.collection import (
    Collection,
    LastOpened,
    collection_of,
    open_collection,
)
from grasp3d.viewer.session import Cancelled
from tests.helpers import shapes, viewing
from tests.helpers.mesh_files import FACES, VERTICES
from tests.helpers.viewing import read_subject


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """A labelled PLY."""
    write_ply(tmp_path / "cone_labeled.ply", viewing.labels())
    return tmp_path / "cone_labeled.ply"


@pytest.mark.parametrize("suffix", ["ply", "npz"])
def test_a_unit_that_a_file_does_not_state_is_that_of_its_labels(
    tmp_path: Path, suffix: str
) -> None:
    path = tmp_path / f"box.{suffix}"
    writer_for(path)(path, viewing.box())
    opened = open_collection(path, options=MeshOptions(unit="mm")).items[0].open()
    assert opened.labels.mesh.file_unit == opened.mesh.file_unit == "mm"
    assert np.array_equal(opened.mesh.normals, read_subject(path).mesh.normals)
    assert opened.mesh.torque_scale == pytest.approx(1e-3 * viewing.box().mesh.torque_scale)


def test_a_mesh_is_labelled_when_it_is_opened(tmp_path: Path) -> None:
    path = tmp_path / "box.stl"
    trimesh.Trimesh(*shapes.box()).export(path)
    model, sampling = GraspModel(friction=0.9), Sampling(max_opening="2cm")
    collection = open_collection(path, model, sampling, MeshOptions(max_edge="0.5cm", unit="cm"))
    reported: list[float] = []
    with running(progress=reported.append):
        subject = collection.items[0].open()
    assert (collection.model, collection.sampling) == (model, sampling)
    assert [one.name for one in collection.items] == [subject.name] == ["box.stl"]
    assert (subject.labels.model, subject.labels.sampling) == (model, sampling)
    assert subject.mesh.file_unit == "cm"
    assert sorted(reported) == reported
    assert reported[-1] == pytest.approx(1.0)
    with running(progress=reported.append):
        assert collection.items[0].open() is subject


def test_a_collection_of_labels_is_ready_at_once() -> None:
    collection = collection_of(viewing.labels())
    subject = collection.items[0].open()
    assert subject.labels is viewing.labels()
    assert collection.items[0].open() is subject
    assert collection_of(viewing.scan()).sampling == Sampling()
    with pytest.raises(SettingError, match="no object to view"):
        Collection((), GraspModel(), Sampling())


# A labelled PLY


def _big_endian(path: Path) -> None:
    plyfile = shapes.reader("plyfile")
    data = plyfile.PlyData.read(path, mmap=False)
    data.byte_order = ">"
    data.write(path)


def test_a_labelled_file_has_its_own_settings_unless_others_are_given(file: Path) -> None:
    labels = viewing.labels()
    collection = open_collection(file)
    assert collection.model == labels.model
    assert collection.sampling.max_opening == 0.003
    assert collection.sampling.search_angle is None
    changed = open_collection(file, GraspModel(friction=0.3, fingers=3))
    assert changed.model == replace(labels.model, friction=0.3, fingers=3)
    assert changed.sampling == collection.sampling


@pytest.mark.parametrize(
    ("given", "what"),
    [
        ({"sampling": Sampling(min_opening="1mm")}, "search settings"),
        ({"load": Load(mass=1.0)}, "a load"),
        ({"model": GraspModel(location_error="1mm")}, "another model of contacts"),
        ({"options": MeshOptions(region="box:0,0,0,1,1,1")}, "another reading of the mesh"),
        ({"options": MeshOptions(repair="none")}, "another reading of the mesh"),
    ],
)
def test_what_stored_labels_do_not_depend_on_is_refused(
    file: Path, given: dict[str, Any], what: str
) -> None:
    with pytest.raises(SettingError, match=f"has stored labels, which {what} does not change"):
        open_collection(file, **given)


def _held() -> SurfaceLabels:
    mesh = load_mesh(shapes.box((4.0, 3.0, 2.0)), unit="cm", max_edge="1.5cm")
    return label_surface(mesh, hand=ParallelGripper.preset("franka"), load=Load(mass="200 g"))


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".ply", ".npz"])
@pytest.mark.parametrize("make", [viewing.labels, viewing.scan, viewing.three_fingers, _held])
def test_a_labelled_file_is_read_once_and_shown_without_a_search(
    tmp_path: Path, suffix: str, make: Callable[[], SurfaceLabels], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same fractions, best grasps, numbers and sentences as of the labels in memory."""
    labels, path = make(), tmp_path / f"labels{suffix}"
    writer_for(path)(path, labels)
    read, reads = READERS[suffix], list[str]()

    def counted(source: Source) -> Stored | None:
        reads.append(source.kind)
        return read(source)

    def refuse(*_: Any, **__: Any) -> None:
        pytest.fail("grasps are searched")

    monkeypatch.setitem(READERS, suffix, counted)
    for name in ("label_surface", "scan_surface"):
        monkeypatch.setattr(f"grasp3d.viewer.collection.{name}", refuse)
    session, known = viewing.ready_session(open_collection(path)), viewing.ready_session(labels)
    assert reads == [suffix[1:]]
    for one in (session, known):
        assert one.subject is not None
        for paint in ("label", "epsilon", "grip_force"):
            if one.offers(paint):
                one.change(paint=paint)
                viewing.wait_until_idle(one)
    shown, expected = session.subject, known.subject
    assert shown is not None
    assert expected is not None
    assert np.array_equal(labels_at(shown), labels.label)
    found = np.flatnonzero(expected.labels.reason == Reason.FOUND)
    for vertex in {0, 30, *found[:3].tolist()}:
        for one in (session, known):
            one.click(vertex, inspect=True)
            viewing.wait_until_idle(one)
        seen, same = session.inspection, known.inspection
        assert seen is not None
        assert same is not None
        assert np.array_equal(seen.points, same.points)
        assert (seen.numbers, seen.reason) == (same.numbers, same.reason)
        assert (seen.held is None) == (same.held is None)
        if seen.held is not None and same.held is not None:
            assert np.array_equal(seen.held.pose, same.held.pose)


def test_an_open_surface_has_a_note(tmp_path: Path) -> None:
    vertices, faces = shapes.box()
    from grasp3d import load_mesh

    mesh = load_mesh((vertices, faces[2:]), max_edge=0.8, repair="none")
    write_ply(tmp_path / "open.ply", label_surface(mesh))
    subject = read_subject(tmp_path / "open.ply")
    assert not subject.mesh.report.closed
    assert any("open" in note for note in subject.notes)


# Files that are not labelled PLY files


def _ply(properties: str, row: str, comments: str = "") -> bytes:
    """A tetrahedron as text, with additional vertex properties."""
    header = f"ply\nformat ascii 1.0\n{comments}element vertex {len(VERTICES)}\n"
    header += "".join(f"property float {axis}\n" for axis in "xyz") + properties
    header += f"element face {len(FACES)}\nproperty list uchar int vertex_indices\nend_header\n"
    rows = [f"{x} {y} {z} {row}\n" for x, y, z in VERTICES]
    return (header + "".join(rows) + "".join(f"3 {a} {b} {c}\n" for a, b, c in FACES)).encode()


@pytest.mark.parametrize(
    ("properties", "row"),
    [
        ("", ""),
        ("property uchar red\nproperty uchar green\nproperty uchar blue\n", "1 2 3"),
        ("property float confidence\nproperty float quality\n", "0.5 0.5"),
        ("property float s\nproperty float t\n", "0.5 0.5"),
        ("property float nx\nproperty float ny\nproperty float nz\n", "0 0 1"),
    ],
)
def test_a_ply_of_another_program_is_a_mesh(tmp_path: Path, properties: str, row: str) -> None:
    path = tmp_path / "mesh.ply"
    path.write_bytes(_ply(properties, row, "comment made by hand\n"))
    collection = open_collection(path, options=MeshOptions(max_edge=9.0))
    subject = collection.items[0].open()
    assert len(subject.mesh.vertices) == len(VERTICES)


def test_missing_settings_have_their_defaults(file: Path) -> None:
    viewing.rewritten(file, (b"comment grasp3d rays 64\n", b""))
    assert read_subject(file).labels.sampling == viewing.labels().sampling


# The results of a batch


@cache
def _stored(folder: Path) -> Path:
    """Results of a batch of two meshes and a file that is not a mesh."""
    meshes = folder / "meshes"
    (meshes / "deep").mkdir(parents=True)
    trimesh.Trimesh(*shapes.cone(0.35, sections=24)).export(meshes / "deep" / "cone.ply")
    trimesh.Trimesh(*shapes.box((0.5, 1.0, 2.0))).export(meshes / "box.stl")
    (meshes / "broken.stl").write_text("solid nothing")
    settings = BatchSettings(
        model=GraspModel(friction=0.3), sampling=Sampling(max_opening=0.51),
        mesh=MeshOptions(max_edge=0.3),
    )  # fmt: skip
    done = label_library(
        [meshes], folder / "out", settings, cluster=ClusterSettings(workers=0), report=False
    )
    assert len(done.meshes) == 3
    return folder / "out"


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return _stored(tmp_path_factory.mktemp("batch"))


@pytest.mark.slow
def test_a_batch_contains_its_labelled_meshes_in_order(stored: Path) -> None:
    collection = open_collection(stored)
    assert [one.name for one in collection.items] == ["box.stl", "deep/cone.ply"]
    assert collection.notes == (
        "1 of 3 meshes were not labelled; see report/index.html for the reasons",
    )
    assert (collection.model.friction, collection.sampling.max_opening) == (0.3, 0.51)
    assert collection.items[1].open().name == "deep/cone.ply"
    subject = collection.items[0].open()
    assert subject.labels.partners is not None
    held = subject.labels.reason == Reason.FOUND
    assert np.array_equal(np.isfinite(subject.labels.partners).all(axis=(1, 2)), held)
    assert {Reason.FOUND, Reason.OPENING} <= set(subject.labels.reason)
    spans = np.linalg.norm(subject.labels.partners[:, 0] - subject.mesh.vertices, axis=1)
    assert subject.labels.opening[held] == pytest.approx(spans[held], rel=1e-6)
    size = np.linalg.norm(np.ptp(subject.mesh.vertices, axis=0))
    assert np.nanmax(subject.labels.opening) <= np.float32(
        0.51 + OPENING_SLACK * size
    )  # as in the file


@pytest.fixture
def copied(stored: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(stored, tmp_path / "out"))


def test_a_missing_file_of_one_object_does_not_affect_the_others(copied: Path) -> None:
    (copied / "surfaces" / "box.stl.ply").unlink()
    collection = open_collection(copied)
    with pytest.raises(MeshError, match="there is no such file"):
        collection.items[0].open()
    assert collection.model.friction == 0.3
    assert collection.items[1].open().name == "deep/cone.ply"


def test_folders_without_results_are_refused(tmp_path: Path, copied: Path) -> None:
    with pytest.raises(OutputError, match="was not written by grasp3d batch"):
        open_collection(tmp_path)
    (copied / "labels" / "all-00099.parquet").write_bytes(b"no table")
    with pytest.raises(OutputError, match=r"all-00099.parquet: is damaged"):
        open_collection(copied)


# The object that was opened last


def _subject(name: str) -> Subject:
    return replace(subject_of(viewing.box()), name=name)


def test_the_object_that_was_opened_last_is_kept() -> None:
    last, opened = LastOpened(), list[str]()

    def reader(name: str) -> Callable[[], Subject]:
        def read() -> Subject:
            opened.append(name)
            return _subject(name)

        return last.kept(read)

    a, b = reader("a"), reader("b")
    for one in (a, a, b, b, a):
        one()
    assert "".join(opened) == "aba"


def test_cancelled_and_failed_openings_are_not_kept() -> None:
    outcomes: list[BaseException | None] = [Cancelled(), MeshError("no"), None]

    def read() -> Subject:
        outcome = outcomes.pop(0)
        if outcome is not None:
            raise outcome
        return _subject("a")

    kept = LastOpened().kept(read)
    for kind in (Cancelled, GraspError):
        with pytest.raises(kind):
            kept()
    assert kept() is kept()


def test_two_threads_share_one_opening_of_an_object() -> None:
    begun, go_on, count = threading.Event(), threading.Event(), list[int]()

    def read() -> Subject:
        count.append(1)
        begun.set()
        assert go_on.wait(60)
        return _subject("a")

    kept = LastOpened().kept(read)
    with ThreadPoolExecutor(2) as executor:
        first = executor.submit(kept)
        assert begun.wait(60)
        second = executor.submit(kept)
        go_on.set()
        assert first.result() is second.result()
    assert len(count) == 1


def test_labels_of_extreme_normals_have_a_note(tmp_path: Path) -> None:
    model = GraspModel(method="extremes", friction=0.3)
    labels = label_surface(viewing.box().mesh, model)
    write_ply(tmp_path / "a.ply", labels)
    subject = read_subject(tmp_path / "a.ply")
    assert "thresholds" in subject.notes[-1]
