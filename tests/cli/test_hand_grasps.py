"""`grasp3d evaluate` for poses of hands with joints."""

import json
import math
import re
from pathlib import Path

import numpy as np
import pyarrow.csv as pc
import pytest

from grasp3d.formats import GraspPoses, read_grasps, write_grasps
from tests.helpers import shapes, slider_hand
from tests.helpers.commands import export, printed
from tests.helpers.commands import run_here as grasp3d
from tests.helpers.slider_hand import BOX, TOUCHING

HAND = ("--hand", "sliders.json", "--unit", "m", "--sensor-resolution", "10")
POSES = ("box.stl", "poses.csv", *HAND)


def write(folder: Path, *postures: float | tuple[float, ...], name: str = "poses.csv") -> None:
    """Poses with the hand's axis through the middle of the box."""
    values = np.array([np.broadcast_to(one, 4) for one in postures])
    joints = tuple(f"slide_{number}" for number in range(4))
    poses = np.tile(np.eye(4), (len(values), 1, 1))
    write_grasps(
        folder / name, GraspPoses(poses=poses, posture=values, joint_names=joints, unit="m")
    )


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    export(tmp_path / "box.stl", shapes.box(BOX))
    slider_hand.write(tmp_path)
    write(tmp_path, TOUCHING, 0.0, (TOUCHING, TOUCHING, TOUCHING, -0.02))
    return tmp_path


def test_report(folder: Path) -> None:
    text = printed("evaluate", *POSES, cwd=folder)
    assert "box.stl: 3 poses of sliders; μ 0.5" in text
    for line in (
        "Surely held by sliders: 1 of 3 grasps",
        "contacts given, within 5 mm",
        "1 of 3: a joint is beyond its limit",
        "1 of 3: no link within 5 mm of the object",
        "joint 4 (slide_3) is 20 mm beyond its limit",
        "written: box_grasps.csv",
    ):
        assert line in text


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--method extremes", "sliders is a hand with joints, and takes no method extremes"),
        ("--max-distance 1mm", "max_distance applies to contacts"),
    ],
)
def test_options_that_do_not_apply(folder: Path, words: str, message: str) -> None:
    run = grasp3d("evaluate", *POSES, *words.split(), cwd=folder)
    assert run.returncode == 2
    assert message in run.stderr
    assert "Traceback" not in run.stderr
    assert not (folder / "box_grasps.csv").exists()


def test_more_friction_and_finer_sensors_hold_more(folder: Path) -> None:
    """As many of the poses are S at least."""
    rng = np.random.default_rng(1)
    write(folder, *map(tuple, TOUCHING - rng.uniform(0.0, 0.004, size=(12, 4))))
    counts = []
    for resolution in (60, 40, 20, 5):
        words = ("--sensor-resolution", resolution, "--overwrite")
        printed("evaluate", *POSES[:-2], *map(str, words), cwd=folder)
        labels = pc.read_csv(folder / "box_grasps.csv")["label"].to_pylist()
        counts.append(labels.count("S"))
    assert counts == sorted(counts)
    assert counts[-1] == 12
    assert math.isclose(TOUCHING, 0.04)


@pytest.mark.parametrize("name", ["found.csv", "found.parquet", "found.json"])
def test_results_are_written_with_joints_by_name(folder: Path, name: str) -> None:
    printed("evaluate", *POSES, "-o", name, cwd=folder)
    poses = read_grasps(folder / name)
    assert isinstance(poses, GraspPoses)
    assert poses.joint_names == tuple(f"slide_{number}" for number in range(4))
    assert poses.columns["label"].tolist() == ["S", "U", "U"]
    assert poses.columns["reason"].tolist()[1] == "no link within 5 mm of the object"
    assert poses.columns["gap_finger_0"][0] == pytest.approx(0.0, abs=1e-6)
    # They are evaluated again to the same results.
    said = printed("evaluate", "box.stl", name, *HAND, "-o", "again.csv", cwd=folder)
    assert "contacts given" in said
    assert "poses read in the frame of the hand's base" in said
    again = pc.read_csv(folder / "again.csv").to_pydict()
    assert again["label"] == ["S", "U", "U"]


def test_grasps_are_of_one_object(folder: Path) -> None:
    (folder / "meshes").mkdir()
    run = grasp3d("evaluate", "meshes", "poses.csv", *HAND, cwd=folder)
    assert run.returncode == 2
    assert "meshes: is a folder; name a file" in run.stderr
    run = grasp3d("batch", "box.stl", "-o", "out", *HAND, cwd=folder)
    assert run.returncode == 2
    assert "object by object (grasp3d evaluate MESH GRASPS --hand FILE)" in run.stderr
    assert not (folder / "out").exists()


def test_load(folder: Path) -> None:
    text = printed("evaluate", *POSES, "--mass", "0.5kg", "--torque-limits", "10", cwd=folder)
    assert "Surely held by sliders: 1 of 3 grasps" in text
    assert "load: 0.5 kg, weight\n" in text
    columns = pc.read_csv(folder / "box_grasps.csv").to_pydict()
    assert columns["load_fraction"][0] == pytest.approx(0.5 / columns["payload"][0])
    assert columns["payload"][0] == pytest.approx(1.35, abs=0.05)
    assert columns["payload"][1] is None
    assert columns["limit"][0].startswith("slide_")
    assert columns["label"][0] == "S"
    row = next(line.split() for line in text.splitlines() if re.match(" +1 .* slide_", line))
    assert f"{columns['load_fraction'][0]:.3f}" in row
    assert row.count("S") == 1


def test_options_and_descriptions_that_no_hand_has_are_named(folder: Path) -> None:
    text = printed("evaluate", *POSES, "--mass", "1g", "--torque-limits", "2000", cwd=folder)
    assert "warning: torque_limits: 2000 N at slide_0, slide_1, slide_2, slide_3 is more" in text
    assert "from 500 N on: is it in mN, and 2 N meant?" in text
    content = json.loads((folder / "sliders.json").read_text()) | {"torques": {"slide_0": 2000}}
    (folder / "sliders.json").write_text(json.dumps(content))
    for words in (("evaluate", *POSES, "--overwrite"), ("hand", "sliders.json")):
        assert "warning: torques: 2000 N at slide_0 is more" in printed(*words, cwd=folder)


def test_what_motors_do_not_hold_is_not_surely_held(folder: Path) -> None:
    text = printed("evaluate", *POSES, "--mass", "5kg", "--torque-limits", "10", cwd=folder)
    columns = pc.read_csv(folder / "box_grasps.csv").to_pydict()
    assert columns["label"][0] == "U"
    found = re.fullmatch(r"holds ([\d.]+) kg at most", columns["reason"][0])
    assert found
    assert columns["payload"][0] < float(found[1]) < 5.0
    assert "1 of 3: the motors do not surely hold it" in text
    assert "5 kg in any orientation" in text
    between = f"{(columns['payload'][0] + float(found[1])) / 2:.3f}kg"
    words = ("--mass", between, "--torque-limits", "10", "--overwrite")
    printed("evaluate", *POSES, *words, cwd=folder)
    columns = pc.read_csv(folder / "box_grasps.csv").to_pydict()
    assert columns["label"][0] == "M"
    assert re.fullmatch(r"surely holds [\d.]+ kg only", columns["reason"][0])


def test_poses_without_a_grasp_have_no_load(folder: Path) -> None:
    text = printed("evaluate", *POSES, "--mass", "0.5kg", cwd=folder, columns=200)
    (row,) = [line for line in text.splitlines() if line.startswith("   2 ")]
    assert row.split("  no link")[0].split().count("–") == 5
