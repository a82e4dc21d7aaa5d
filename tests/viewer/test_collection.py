import shutil
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
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
from grasp3d.system.context import running
from grasp3d.viewer.collection import Collection, LastOpened, collection_of, open_collection
from grasp3d.viewer.session import Cancelled
from tests.helpers import shapes, viewing
from tests.helpers.mesh_files import VERTICES, ply_text, written


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """A labelled PLY."""
    write_ply(tmp_path / "cone_labeled.ply", viewing.labels())
    return tmp_path / "cone_labeled.ply"


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
    with pytest.raises(SettingError, match=f"has stored labels, which {what} cannot change"):
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
    sessions = [viewing.ready_session(one) for one in (open_collection(path), labels)]
    assert reads == [suffix[1:]]
    assert np.array_equal(labels_at(viewing.shown(sessions[0])), labels.label)
    for one in sessions:
        for paint in filter(one.offers, ("label", "epsilon", "grip_force")):
            one.change(paint=paint)
            viewing.wait_until_idle(one)
    for vertex in {0, 30, *np.flatnonzero(labels.reason == Reason.FOUND)[:3].tolist()}:
        for one in sessions:
            one.click(vertex, inspect=True)
            viewing.wait_until_idle(one)
        seen, same = map(viewing.inspected, sessions)
        assert np.array_equal(seen.points, same.points)
        assert (seen.numbers, seen.reason) == (same.numbers, same.reason)
        poses = [None if one.held is None else one.held.pose.tolist() for one in (seen, same)]
        assert poses[0] == poses[1]


@pytest.mark.parametrize("names", ["", "red green blue", "s t"])
def test_a_ply_of_another_program_is_a_mesh(tmp_path: Path, names: str) -> None:
    """A tetrahedron with additional properties of its vertices."""
    added = names.split()
    more = "".join(f"property float {name}\n" for name in added)
    text = ply_text().replace("element face", f"{more}comment made by hand\nelement face")
    for row in ("0.0 0.0 0.0", "1.0 0.0 0.0", "0.0 1.0 0.0", "0.0 0.0 1.0"):
        text = text.replace(f"{row}\n", f"{row} {'1 ' * len(added)}\n", 1)
    path = written(tmp_path, "mesh.ply", text)
    collection = open_collection(path, options=MeshOptions(max_edge=9.0))
    assert len(collection.items[0].open().mesh.vertices) == len(VERTICES)


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of a batch of two meshes and a file that is not a mesh."""
    folder = tmp_path_factory.mktemp("batch")
    meshes = folder / "meshes"
    (meshes / "deep").mkdir(parents=True)
    trimesh.Trimesh(*shapes.cone(0.35, sections=24)).export(meshes / "deep" / "cone.ply")
    trimesh.Trimesh(*shapes.box((0.5, 1.0, 2.0))).export(meshes / "box.stl")
    (meshes / "broken.stl").write_text("solid nothing")
    settings = BatchSettings(
        model=GraspModel(friction=0.3), sampling=Sampling(max_opening=0.51),
        mesh=MeshOptions(max_edge=0.3),
    )  # fmt: skip
    here = ClusterSettings(workers=0)
    label_library([meshes], folder / "out", settings, cluster=here, report=False)
    return folder / "out"


def test_a_batch_contains_its_labelled_meshes_in_order(stored: Path) -> None:
    collection = open_collection(stored)
    assert [one.name for one in collection.items] == ["box.stl", "deep/cone.ply"]
    assert collection.notes == (
        "1 of 3 meshes were not labelled; see report/index.html for the reasons",
    )
    assert (collection.model.friction, collection.sampling.max_opening) == (0.3, 0.51)
    assert collection.items[1].open().name == "deep/cone.ply"
    found = collection.items[0].open()
    labels, held = found.labels, found.labels.reason == Reason.FOUND
    assert {Reason.FOUND, Reason.OPENING} <= set(labels.reason)
    assert np.array_equal(np.isfinite(labels.partners).all(axis=(1, 2)), held)
    spans = np.linalg.norm(labels.partners[:, 0] - found.mesh.vertices, axis=1)
    assert labels.opening[held] == pytest.approx(spans[held], rel=1e-6)


def test_what_is_missing_or_damaged_of_a_batch_is_said(stored: Path, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="was not written by grasp3d batch"):
        open_collection(tmp_path)
    copied = Path(shutil.copytree(stored, tmp_path / "out"))
    (copied / "surfaces" / "box.stl.ply").unlink()
    collection = open_collection(copied)
    with pytest.raises(MeshError, match="there is no such file"):
        collection.items[0].open()
    assert collection.items[1].open().name == "deep/cone.ply"
    (copied / "labels" / "all-00099.parquet").write_bytes(b"no table")
    with pytest.raises(OutputError, match=r"all-00099.parquet: is damaged"):
        open_collection(copied)


def _subject(name: str) -> Subject:
    return replace(subject_of(viewing.box()), name=name)


def test_the_object_that_was_opened_last_is_kept_but_no_failure() -> None:
    last, outcomes = LastOpened(), [Cancelled(), MeshError("no"), "a", "again"]

    def read() -> Subject:
        outcome = outcomes.pop(0)
        if isinstance(outcome, BaseException):
            raise outcome
        return _subject(outcome)

    kept, other = last.kept(read), last.kept(lambda: _subject("b"))
    for kind in (Cancelled, GraspError):
        with pytest.raises(kind):
            kept()
    assert kept() is kept()
    assert other().name == "b"
    assert kept().name == "again"


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
