import math
import os
import re
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
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp3d import (
    BatchSettings,
    GraspError,
    GraspModel,
    Label,
    Load,
    MeshOptions,
    MultifingerSampling,
    ParallelGripper,
    Sampling,
    SurfaceLabels,
    label_library,
    label_surface,
    load_mesh,
    write_ply,
)
from grasp3d.batch import ClusterSettings
from grasp3d.errors import MeshError, OutputError, SettingError
from grasp3d.export.read_labels import READERS
from grasp3d.export.stored import Stored
from grasp3d.export.writers import writer_for
from grasp3d.reading.sources import Source
from grasp3d.surface import Reason
from grasp3d.surface.sampling.antipodal import OPENING_SLACK
from grasp3d.system.context import running
from grasp3d.viewer.session.background import Cancelled
from grasp3d.viewer.session.collection import (
    Collection,
    LastOpened,
    collection_of,
    open_collection,
)
from grasp3d.viewer.session.inspection import best_vertices, inspect
from grasp3d.viewer.session.painting import area_fractions, labels_at
from grasp3d.viewer.subjects.subject import Subject, subject_of
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
    assert opened.labels.mesh.unit == opened.mesh.unit == "mm"
    assert np.array_equal(opened.mesh.normals, read_subject(path).mesh.normals)
    assert opened.mesh.torque_scale == viewing.box().mesh.torque_scale


def test_a_mesh_is_labelled_when_it_is_opened(tmp_path: Path) -> None:
    path = tmp_path / "box.stl"
    trimesh.Trimesh(*shapes.box()).export(path)
    model, sampling = GraspModel(friction=0.9), Sampling(max_opening=2.0)
    collection = open_collection(path, model, sampling, MeshOptions(max_edge=0.5, unit="cm"))
    reported: list[float] = []
    with running(progress=reported.append):
        subject = collection.items[0].open()
    assert (collection.model, collection.sampling) == (model, sampling)
    assert [one.name for one in collection.items] == [subject.name] == ["box.stl"]
    assert (subject.labels.model, subject.labels.sampling) == (model, sampling)
    assert subject.mesh.unit == "cm"
    assert sorted(reported) == reported
    assert reported[-1] == pytest.approx(1.0)
    with running(progress=reported.append):
        assert collection.items[0].open() is subject


def test_an_unreadable_file_raises_an_error_when_it_is_opened(tmp_path: Path) -> None:
    (tmp_path / "not.stl").write_text("hello")
    with pytest.raises(MeshError, match=r"not\.stl"):
        open_collection(tmp_path / "not.stl").items[0].open()
    with pytest.raises(MeshError, match="no such file or folder"):
        open_collection(tmp_path / "none.ply")


def test_a_collection_of_labels_is_ready_at_once() -> None:
    collection = collection_of(viewing.labels())
    subject = collection.items[0].open()
    assert subject.labels is viewing.labels()
    assert subject.epsilons is None or subject.epsilons.model == viewing.labels().model
    assert collection.items[0].open() is subject
    assert collection_of(viewing.scan()).sampling == Sampling()
    with pytest.raises(SettingError, match="no object to view"):
        Collection((), GraspModel(), Sampling())


@pytest.mark.parametrize("address", ["s3://bucket/out", "https://host/mesh.ply"])
def test_addresses_are_refused(address: str) -> None:
    with pytest.raises(MeshError, match="is an address"):
        open_collection(Path(address))


# A labelled PLY


@pytest.mark.slow
@pytest.mark.parametrize("name", ["cone.off", "box.obj"])
def test_a_labelled_file_has_the_area_fractions_of_relabel(tmp_path: Path, name: str) -> None:
    model = GraspModel(friction=1.2, sensor_resolution=0.6)
    mesh = load_mesh(shapes.LIBRARY / name, max_edge=0.02)
    labels = label_surface(mesh, model)
    write_ply(tmp_path / "a.ply", labels)
    subject = read_subject(tmp_path / "a.ply")
    assert subject.weights == pytest.approx(mesh.vertex_areas / mesh.vertex_areas.sum())
    for friction in (0.2, 0.5, 0.8, 1.2):
        for resolution in (0.0, 0.2, 0.6):
            again = labels.relabel(friction=friction, sensor_resolution=resolution)
            codes = labels_at(subject, again.model)
            assert np.array_equal(codes, again.label)
            fractions = area_fractions(subject, codes)
            for letter, fraction in again.fractions().items():
                assert fractions[Label[letter]] == pytest.approx(fraction)


def test_a_labelled_file_contains_the_data_of_the_labels(file: Path) -> None:
    labels, subject = viewing.labels(), read_subject(file)
    mesh, whole = labels.mesh, subject_of(labels)
    assert subject.cone == whole.cone
    for name in ("model", "mode", "sampling", "search"):
        assert getattr(subject.labels, name) == getattr(labels, name), name
    for name in ("unit", "options", "size", "report"):
        assert getattr(subject.mesh, name) == getattr(mesh, name), name
    for name in ("vertices", "faces", "normals"):
        assert np.array_equal(getattr(subject.mesh, name), getattr(mesh, name)), name
    for name in ("critical_angle", "partners", "opening", "reason"):
        one, other = (getattr(each, name) for each in (subject.labels, labels))
        assert np.array_equal(one, other, equal_nan=name in {"partners", "opening"}), name
    assert subject.epsilons is subject.labels
    assert np.array_equal(subject.epsilons.epsilon, labels.epsilon, equal_nan=True)


def _big_endian(path: Path) -> None:
    plyfile = shapes.reader("plyfile")
    data = plyfile.PlyData.read(path, mmap=False)
    data.byte_order = ">"
    data.write(path)


def _as_text(path: Path) -> None:
    write_ply(path, viewing.labels(), binary=False)


@pytest.mark.parametrize("change", [_big_endian, _as_text])
def test_both_byte_orders_and_text_can_be_read(file: Path, change: Callable[[Path], None]) -> None:
    before = read_subject(file)
    change(file)
    after = read_subject(file)
    for name in ("vertices", "faces", "normals"):
        assert np.array_equal(getattr(before.mesh, name), getattr(after.mesh, name)), name
    for name in ("critical_angle", "critical_angle_best"):
        assert np.array_equal(getattr(before.labels, name), getattr(after.labels, name)), name
    assert before.labels.model == after.labels.model


def test_a_labelled_file_has_its_own_settings_unless_others_are_given(file: Path) -> None:
    labels = viewing.labels()
    collection = open_collection(file)
    assert collection.model == labels.model
    assert collection.sampling.max_opening == 0.3
    changed = open_collection(file, GraspModel(friction=0.3), Sampling(min_opening=0.1))
    assert changed.model == replace(labels.model, friction=0.3)
    assert (changed.sampling.min_opening, changed.sampling.max_opening) == (0.1, 0.3)
    assert changed.sampling.search_angle is None
    three = open_collection(file, GraspModel(fingers=3), MultifingerSampling(max_opening=0.2))
    assert (three.model.fingers, three.sampling) == (3, MultifingerSampling(max_opening=0.2))
    with pytest.raises(SettingError, match="does not apply to 3 fingers"):
        open_collection(file, GraspModel(fingers=3), Sampling(min_opening=0.2))


def _held() -> SurfaceLabels:
    mesh = load_mesh(shapes.box((4.0, 3.0, 2.0)), unit="cm", max_edge=1.5)
    return label_surface(mesh, hand=ParallelGripper.preset("franka"), load=Load(mass="200 g"))


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".ply", ".npz", ".vtp", ".parquet"])
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
    for name in ("computations.label_surface", "scans.scan_surface"):
        monkeypatch.setattr(f"grasp3d.viewer.session.{name}", refuse)
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
    assert np.array_equal(labels_at(shown, session.model), labels.label)
    assert np.array_equal(best_vertices(shown, 9), best_vertices(expected, 9))
    for vertex in {0, 30, *best_vertices(expected, 3).tolist()}:
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


@pytest.mark.parametrize(
    ("properties", "row", "message"),
    [
        ("property uchar label\n", "1", "'label' but no 'critical_angle'"),
        ("property float critical_angle\n", "1", "'critical_angle' but no 'label'"),
        ("property float epsilon\n", "1", "'epsilon' but no 'label'"),
    ],
)
def test_files_with_only_some_label_properties_are_refused(
    tmp_path: Path, properties: str, row: str, message: str
) -> None:
    path = tmp_path / "foreign.ply"
    path.write_bytes(_ply(properties, row))
    with pytest.raises(MeshError, match=message) as caught:
        open_collection(path)
    assert "without its labels" in str(caught.value)
    assert "\n" not in str(caught.value)


def _set_values(path: Path, **columns: Any) -> None:
    """Change the values of one vertex of a labelled file."""
    data = path.read_bytes()
    start = data.index(b"end_header\n") + len(b"end_header\n")
    kinds = {"double": "<f8", "float": "<f4", "uchar": "u1", "char": "i1"}
    properties = re.findall(rb"\nproperty (\w+) (\w+)(?=\n)", data[:start])
    dtype = np.dtype([(name.decode(), kinds[kind.decode()]) for kind, name in properties])
    rows = np.frombuffer(data, dtype, len(viewing.labels().label), start).copy()
    for name, value in columns.items():
        rows[name][5] = value
    path.write_bytes(data[:start] + rows.tobytes() + data[start + rows.nbytes :])


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"label": 3}, "its label goes up to 3"),
        (
            {"label": 0, "critical_angle": 0.1, "critical_angle_best": 0.1},
            "its labels do not match its critical angles",
        ),
        ({"critical_angle": math.nan}, "its critical_angle is not always"),
        ({"critical_angle_best": -0.1}, "its critical_angle_best is not always"),
        ({"critical_angle": 4.0}, "its critical_angle is not always"),
        ({"critical_angle": 0.1, "critical_angle_best": 0.5}, "above its critical_angle"),
        ({"label": 1}, "do not match its critical"),
        ({"epsilon_min": -1.0}, "its epsilon_min is not always at least 0"),
        ({"epsilon": math.inf}, "its epsilon is not always at least 0"),
        ({"reason": 0}, "does not match its angles and contacts"),
        ({"x": math.nan}, "not a finite number"),
        ({"x": 1e200}, "its coordinates exceed 1e"),
    ],
)
def test_impossible_numbers_are_refused(file: Path, columns: dict[str, Any], message: str) -> None:
    _set_values(file, **columns)
    with pytest.raises(MeshError, match=message):
        read_subject(file)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ((b"property uchar label", b"property char label"), "'label' is not a uchar"),
        ((b"property double epsilon\n", b"property int epsilon\n"), "'epsilon' is not a double"),
        ((b"comment grasp3d packed", b"comment grasp3d pakced"), "not their grasps: it is of an"),
        ((b"comment grasp3d packed UEsD", b"comment grasp3d packed VEsD"), "its arrays cannot be"),
        ((b"comment grasp3d packed UEsD", b"comment grasp3d packed ?EsD"), "it cannot be read"),
        ((b"comment grasp3d friction 0.75", b"comment grasp3d friction -1.0"), "above 0"),
        ((b"comment grasp3d friction 0.75", b"comment grasp3d friction fast"), "friction must be"),
        (
            (b"comment grasp3d friction 0.75", b"comment grasp3d frictiom 0.75"),
            "no comment 'friction'",
        ),
        ((b"comment grasp3d mode label", b"comment grasp3d mode bagel"), "its mode is 'bagel'"),
        ((b"comment grasp3d fingers 2", b"comment grasp3d fingers b"), "invalid literal"),
        ((b"comment grasp3d unit cm", b"comment grasp3d unit pc"), "no unit is called 'pc'"),
        ((b"list uchar int vertex_indices", b"list uchar float vertex_indices"), "not whole num"),
        (
            (b"property double epsilon_max", b"property list uchar int epsilon_max"),
            "is not a double",
        ),
        ((b"\nelement face", b"\nelement edge 0\nelement face"), "its elements are not"),
    ],
)
def test_invalid_headers_are_refused(file: Path, change: tuple[bytes, bytes], message: str) -> None:
    with pytest.raises(MeshError, match=message):
        read_subject(viewing.rewritten(file, change))


def test_missing_settings_have_their_defaults(file: Path) -> None:
    viewing.rewritten(file, (b"comment grasp3d rays 64\n", b""))
    assert read_subject(file).labels.sampling == viewing.labels().sampling


def test_incomplete_files_are_refused(file: Path, tmp_path: Path) -> None:
    whole = file.read_bytes()
    for cut in (len(whole) - 1, len(whole) // 2, whole.index(b"end_header") + 20):
        file.write_bytes(whole[:cut])
        with pytest.raises(MeshError, match="complete"):
            read_subject(file)
    file.write_bytes(whole + b"0")
    with pytest.raises(MeshError, match="is it complete"):
        read_subject(file)
    text = tmp_path / "text.ply"
    write_ply(text, viewing.labels(), binary=False)
    data = text.read_bytes()
    text.write_bytes(data[: len(data) // 2])
    with pytest.raises(MeshError, match="is the file complete"):
        read_subject(text)


def test_declared_sizes_are_checked_before_memory_is_allocated(file: Path) -> None:
    count = len(viewing.labels().label)
    change = f"element vertex {count}\n".encode(), b"element vertex 999999999999\n"
    with pytest.raises(MeshError, match="declares 999,999,999,999 vertices"):
        read_subject(viewing.rewritten(file, change))


def test_faces_that_are_not_triangles_of_the_vertices_are_refused(file: Path) -> None:
    faces = len(viewing.labels().mesh.faces)
    whole = file.read_bytes()
    start = len(whole) - 13 * faces
    file.write_bytes(whole[:start] + b"\x04" + whole[start + 1 :])
    with pytest.raises(MeshError, match="is the file complete"):
        read_subject(file)
    fourth = whole[start + 1 : start + 5]
    file.write_bytes(
        whole[:start] + b"\x04" + whole[start + 1 : start + 13] + fourth + whole[start + 13 :]
    )
    with pytest.raises(MeshError, match="not all triangles"):
        read_subject(file)
    for corner in (np.int32(-1), np.int32(10**6)):
        file.write_bytes(whole[: start + 1] + corner.tobytes() + whole[start + 5 :])
        with pytest.raises(MeshError, match="uses vertex"):
            read_subject(file)
    zero = whole[:start] + (b"\x03" + b"\0" * 12) * faces
    file.write_bytes(zero)
    with pytest.raises(MeshError, match="no area"):
        read_subject(file)


@pytest.mark.parametrize(("before", "after"), [(b" 2 ", b" x "), (b" 2 ", b" 2.5 ")])
def test_text_that_is_not_a_number_is_refused(tmp_path: Path, before: bytes, after: bytes) -> None:
    path = tmp_path / "text.ply"
    write_ply(path, viewing.labels(), binary=False)
    head, mark, body = path.read_bytes().partition(b"end_header\n")
    lines = body.split(b"\n")
    row = next(i for i, line in enumerate(lines) if line.split()[9] == b"2")
    values = lines[row].split()
    values[9] = after.strip()
    lines[row] = b" ".join(values)
    assert before.strip() == b"2"
    path.write_bytes(head + mark + b"\n".join(lines))
    with pytest.raises(MeshError, match=r"cannot be read|expected a whole number"):
        read_subject(path)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("whole") / "a.ply"
    write_ply(path, viewing.box())
    return path


@pytest.mark.slow
@given(data=st.data())
@settings(max_examples=150, deadline=None)
def test_any_damage_gives_a_one_line_error_or_a_consistent_subject(
    data: st.DataObject, whole: Path
) -> None:
    broken = bytearray(whole.read_bytes())
    header = broken.index(b"end_header")
    for _ in range(data.draw(st.integers(1, 4))):
        position = st.integers(0, header + 400) | st.integers(0, len(broken) - 1)
        broken[data.draw(position)] = data.draw(st.sampled_from(b" 0129-.x\n\xff\x00"))
    length = data.draw(st.just(len(broken)) | st.integers(1, len(broken)))
    path = whole.with_name("broken.ply")
    path.write_bytes(bytes(broken[:length]))
    found: Subject | str
    try:
        found = read_subject(path)
    except GraspError as error:
        found = str(error)
    if isinstance(found, str):
        assert "\n" not in found
    else:
        assert len(found.labels.critical_angle) == len(found.mesh.vertices) == len(found.weights)


def test_a_mesh_cannot_be_read_as_labels(tmp_path: Path) -> None:
    (tmp_path / "mesh.ply").write_bytes(_ply("", ""))
    with pytest.raises(MeshError, match="label it first"):
        read_subject(tmp_path / "mesh.ply")


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
    assert len(done.failed) == 1
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


def test_a_batch_contains_the_grasps_that_were_found(stored: Path) -> None:
    subject = open_collection(stored).items[0].open()
    vertex = int(np.flatnonzero(subject.labels.critical_angle < 1e-3)[0])
    seen = inspect(subject, vertex, subject.labels.model)
    assert seen.points.shape == (2, 3)
    line = seen.points[1] - seen.points[0]
    assert seen.normals[0] @ line == pytest.approx(np.linalg.norm(line))
    assert seen.normals[1] @ line == pytest.approx(-np.linalg.norm(line))


@pytest.fixture
def copied(stored: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(stored, tmp_path / "out"))


def test_a_missing_file_of_one_object_does_not_affect_the_others(copied: Path) -> None:
    (copied / "labels" / "box.stl.ply").unlink(missing_ok=True)
    for folder in ("labels", "fields"):
        for path in (copied / folder).glob("box*"):
            path.unlink()
    collection = open_collection(copied)
    with pytest.raises(MeshError, match="there is no such file"):
        collection.items[0].open()
    assert collection.model.friction == 0.3
    assert collection.items[1].open().name == "deep/cone.ply"


def test_folders_without_results_are_refused(tmp_path: Path, copied: Path) -> None:
    with pytest.raises(MeshError, match="was not written by grasp3d batch"):
        open_collection(tmp_path)
    (copied / "grasp3d.json").write_text('{"format": 99, "version": "9"}')
    with pytest.raises(OutputError, match="newer version"):
        open_collection(copied)


def test_a_batch_without_labelled_meshes_is_refused(tmp_path: Path) -> None:
    (tmp_path / "broken.stl").write_text("solid nothing")
    label_library(
        [tmp_path / "broken.stl"], tmp_path / "out", cluster=ClusterSettings(workers=0),
        report=False,
    )  # fmt: skip
    with pytest.raises(MeshError, match="none of its 1 meshes was labelled"):
        open_collection(tmp_path / "out")


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


def test_names_that_are_not_unicode_are_escaped(tmp_path: Path) -> None:
    path = tmp_path / os.fsdecode(b"\xffbox.stl")
    path.write_bytes(b"solid")
    (item,) = open_collection(path).items
    assert item.name == "\\xffbox.stl"


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


def test_the_labels_in_a_notebook_are_a_table() -> None:
    labels: SurfaceLabels = viewing.labels()
    named = replace(labels.mesh.report, source="<b>&", warnings=("<i>open</i>",))
    fresh = viewing.with_report(labels, named)
    table = fresh._repr_html_()
    assert "&lt;b&gt;&amp;" in table
    assert "&lt;i&gt;open&lt;/i&gt;" in table
    assert "<b>" not in table
    assert "ε" not in table
    assert fresh.computed("epsilon_range") is None
    for letter, fraction in labels.fractions().items():
        assert f"{letter} {fraction:.1%}" in table
    assert "μ 0.75, α 22.6°, 2 fingers" in table
    median = float(np.degrees(labels.angle_quantiles([0.5])[0]))
    assert f"{median:.1f}°" in table or math.isinf(median)
    fresh.compute("epsilon_range")
    assert f"{fresh.epsilon_quantiles([0.9])[0]:.3g}" in fresh._repr_html_()
    hulls = labels.using(model=replace(labels.model, method="extremes"))
    assert "%</td>" not in hulls._repr_html_()
    assert hulls.computed("label") is None
    assert "scan" in viewing.scan()._repr_html_()


def test_labels_of_extreme_normals_have_a_note(tmp_path: Path) -> None:
    model = GraspModel(method="extremes", extreme_normals=4, friction=0.3)
    labels = label_surface(viewing.box().mesh, model)
    write_ply(tmp_path / "a.ply", labels)
    subject = read_subject(tmp_path / "a.ply")
    other = subject.weights[labels.label != labels_at(subject, model)].sum()
    assert f"and differ on {other:.1%} of the area" in subject.notes[-1]
    assert "thresholds" in subject.notes[-1]
