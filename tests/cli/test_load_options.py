"""`--mass`, `--density`, `--grip-force`, `--task` and the centre of mass on the command line."""

from pathlib import Path

import pytest
import trimesh

from grasp3d import read_labels
from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.labelling import settings_key
from grasp3d.quality.loads import Load, TaskText
from tests.helpers import shapes
from tests.helpers.commands import printed

COARSE = ("--max-edge", "20mm")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a box of 40 x 30 x 20, one that is open, and files of wrenches."""
    folder = tmp_path_factory.mktemp("loads")
    vertices, faces = shapes.box((40.0, 30.0, 20.0))
    trimesh.Trimesh(vertices, faces, process=False).export(folder / "box.stl")
    trimesh.Trimesh(vertices, faces[:-2], process=False).export(folder / "open.stl")
    (folder / "pushes.csv").write_text("fx,fy,fz,tx,ty,tz\n5,0,0,0,0,0.1\n")
    (folder / "five.csv").write_text("5,0,0,0,0\n")
    return folder


@pytest.mark.parametrize("first", ["-0.005", "-5mm"])
def test_a_centre_of_mass_may_begin_with_a_minus(folder: Path, first: str) -> None:
    words = ("--unit", "mm", "--center-of-mass", f"{first},0,2mm", "--friction", "0.5")
    printed("label", "box.stl", *words, *COARSE, "-q", "-o", "moved.ply", cwd=folder)
    labels = read_labels(folder / "moved.ply")
    assert labels.mesh.options.center_of_mass == (-0.005, 0.0, 0.002)
    assert labels.load is None
    (folder / "moved.ply").unlink()


@pytest.mark.slow
@pytest.mark.parametrize("suffix", ["ply", "glb"])
def test_files_hold_the_load(folder: Path, suffix: str) -> None:
    output = f"held.{suffix}"
    words = ("--unit", "mm", "--task", "weight + pushes.csv", "--center-of-mass", "1,0,0mm")
    label = ("label", "box.stl", *COARSE, *words, "-q", "-o", output)
    load = ("--mass", "300g", "--grip-force", "40N")
    printed(*label, *load, cwd=folder)
    content = (folder / output).read_bytes()
    assert (task := "weight + wrench 5,0,0,0,0,0.1").encode() in content
    assert b"1.0,0.0,0.0" in content
    if suffix == "ply":
        assert read_labels(folder / output).load == Load(mass=0.3, grip_force=40.0, task=task)
    (folder / output).unlink()


def test_the_wrenches_of_files_are_part_of_a_batch(folder: Path) -> None:
    """A batch labels again what another load, or another file of wrenches, makes different."""
    loads = [
        None,
        Load(mass=1.0),
        Load(mass=2.0),
        Load(density=1.0),
        Load(task="wrench 1,0,0,0,0,0"),
        Load(grip_force=1.0),
    ]
    keys = [settings_key(BatchSettings(load=load)) for load in loads]
    assert len(set(keys)) == len(keys)
    assert settings_key(BatchSettings(load=Load(mass="1 kg"))) == keys[1]
    file = str(folder / "own.csv")
    for number in (1, 2):
        Path(file).write_text(f"{number},0,0,0,0,0\n")
        assert Load(task=file).task == TaskText.of(f"wrench {number},0,0,0,0,0")
    Path(file).unlink()
