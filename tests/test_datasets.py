"""Labelled libraries for training: our own data set, and those of other libraries."""

import pickle
import re
import sys
from itertools import groupby
from pathlib import Path

import numpy as np
import pytest
import trimesh

from grasp3d import BatchSettings, MeshOptions, Sampling, label_library
from grasp3d.batch import Library
from grasp3d.datasets import LabelledObjects
from grasp3d.errors import SettingError
from grasp3d.jobs import ClusterSettings
from grasp3d.stability.label import Label
from tests.helpers.grippers import HAND

pytestmark = pytest.mark.slow

HERE = ClusterSettings(workers=0)
QUICK = BatchSettings(
    sampling=Sampling(rays=8), mesh=MeshOptions(unit="cm", max_edge="20mm"), best=3,
    reach={"hand": HAND},
)  # fmt: skip


@pytest.fixture(scope="module", params=["tar", "ply", "none"])
def library(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Library:
    """Boxes in files of one and two, and a file that is no mesh."""
    folder = tmp_path_factory.mktemp("boxes")
    for number in range(5):
        (folder / str(number)).mkdir()
        box = trimesh.creation.box([2.0, 3.0, 4.0 + number])
        box.export(folder / str(number) / f"box.{number}.ply")
    (folder / "0" / "bad.ply").write_text("nonsense", encoding="ascii")
    monkeypatch = pytest.MonkeyPatch()
    monkeypatch.setattr("grasp3d.batch.library.MOST_ROWS", {False: 2, True: 2})
    made = label_library(
        [folder], folder / "out", QUICK, cluster=HERE, surfaces=request.param, report=False
    )
    monkeypatch.undo()
    return made


def test_items_are_the_labels_of_the_objects(library: Library) -> None:
    objects, rows = LabelledObjects(library.folder), {row.mesh: row for row in library.rows()}
    assert len(objects) == 5
    for item in (objects[number] for number in range(len(objects))):
        row = rows[item["mesh"]]
        assert item["grasp_score"].tolist() == [one.score for one in row.grasps]
        assert [Label(one).name for one in item["grasp_label"]] == [one.label for one in row.grasps]
        for name, shape in (("pose", (4, 4)), ("points", (2, 3)), ("normals", (2, 3))):
            stored = [np.reshape(getattr(one, name), shape) for one in row.grasps]
            assert np.array_equal(item[f"grasp_{name}"], stored)
        assert ("points" in item) == bool(row.surface)
        assert len(item["label"]) == row.vertices
        if row.surface:
            labels = library.labels(item["mesh"])
            assert np.array_equal(item["label"], labels.label)
            assert np.allclose(item["critical_angle"], labels.critical_angle, rtol=1e-6)
            assert np.allclose(item["margin"], labels.margin, rtol=1e-6)
            assert np.allclose(item["points"], labels.mesh.vertices, atol=1e-12)
            assert np.allclose(item["normals"], -labels.mesh.normals, atol=1e-6)


def test_orders_read_each_file_once(library: Library) -> None:
    objects = LabelledObjects(library.folder)
    orders = [objects.shuffled(seed) for seed in range(30)]
    assert len({tuple(order) for order in orders}) > 10
    first, other = objects[0], pickle.loads(pickle.dumps(objects))[0]  # noqa: S301, as workers get it
    assert all(np.array_equal(first[name], other[name]) for name in first if name != "grasp_pose")
    for order in (range(len(objects)), *orders):
        assert sorted(order) == [*range(len(objects))]
        files = [library.meshes[objects[number]["mesh"]][0] for number in order]
        assert len([*groupby(files)]) == len(set(files))


def test_without_pytorch_tensors_are_refused(
    library: Library, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(SettingError, match="tensors need PyTorch"):
        LabelledObjects(library.folder, tensors=True)


def test_hugging_face_reads_the_rows(
    library: Library, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    monkeypatch.setenv("HF_HOME", str(tmp_path))
    datasets = pytest.importorskip("datasets", reason="the package datasets is not installed")
    folder = str(library.folder / "labels")
    found = datasets.load_dataset(folder, split="train", cache_dir=str(tmp_path))
    rows = {row["mesh"]: row for row in found}
    for row in library.rows():
        scores = [one["score"] for one in rows[row.mesh]["grasps"]]
        assert (rows[row.mesh]["stable"], scores) == (row.stable, [one.score for one in row.grasps])


@pytest.mark.filterwarnings(  # it leaves files open
    "ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning"
)
def test_webdataset_reads_the_surfaces(library: Library) -> None:
    webdataset = pytest.importorskip("webdataset", reason="webdataset is not installed")
    files = sorted(map(str, (library.folder / "surfaces").glob("*.tar")))
    samples = {
        sample["__key__"]: sample["npz"]
        for file in files
        for sample in webdataset.WebDataset(file, shardshuffle=False, empty_check=False).decode()
    }
    stored = [row for row in library.rows() if row.surface.endswith(".npz")]
    assert {*samples} == {row.surface[:-4] for row in stored}
    for row in stored:
        labels = library.labels(row.mesh)
        assert np.array_equal(samples[row.surface[:-4]]["label"], labels.label)


def test_the_network_of_the_guide_comes_near_the_ceiling(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("torch", reason="PyTorch is not installed")
    page = (Path(__file__).parents[1] / "docs/guide/libraries.md").read_text(encoding="utf-8")
    *_, block = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    monkeypatch.chdir(tmp_path)
    exec(block, {})  # noqa: S102, our own page
    right, ceiling = map(int, re.findall(r"(\d+)%", capsys.readouterr().out.splitlines()[-1]))
    assert ceiling - 8 < right < ceiling + 2
