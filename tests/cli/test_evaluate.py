"""`grasp3d evaluate`: contacts, and poses of a gripper; hands with joints have their own file."""

import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.csv as pc
import pyarrow.parquet as pq
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from grasp3d.formats import write_grasps
from grasp3d.formats.poses import GraspPoses
from grasp3d.hand.hand_files import read_hand, write_hand
from tests.helpers import shapes, slider_hand
from tests.helpers.commands import export, printed, refusal
from tests.helpers.commands import run_process as real_grasp3d
from tests.helpers.grippers import HAND
from tests.helpers.hands import hand_file
from tests.helpers.slider_hand import TOUCHING

PAIR = [[0.5, 0.0, 0.0], [-0.5, 0.0, 0.0]]
THREE = [
    [[0.505, 0.1, 0.1], [-0.5, 0.1, 0.1], [0.0, 0.35, 0.1]],
    [[0.5, 0.1, 0.1], [0.5, -0.1, 0.1], [0.5, 0.0, -0.1]],
    [[0.5, 0.1, 0.1], [0.5, 0.1, 0.1], [0.5, 0.1, 0.1]],
]


def rows_of(path: Path) -> list[dict[str, Any]]:
    if path.suffix == ".json":
        return list(json.loads(path.read_text(encoding="utf-8"))["grasps"])
    table = pc.read_csv(path) if path.suffix == ".csv" else pq.read_table(path)
    return list(table.to_pylist())


def printed_rows(text: str) -> list[list[str]]:
    """Words of the rows of the table of grasps."""
    return [line.split() for line in text.splitlines() if re.match(r" +\d+ +■ [SMU] ", line)]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A box of 1 x 0.7 x 0.5, a pair of contacts, and three triples."""
    export(tmp_path / "my box.stl", shapes.box((1.0, 0.7, 0.5)))
    (tmp_path / "three.json").write_text(json.dumps(THREE), encoding="utf-8")
    (tmp_path / "pair.json").write_text(json.dumps([PAIR]), encoding="utf-8")
    return tmp_path


@pytest.mark.slow
def test_labels_and_numbers_of_given_grasps(folder: Path) -> None:
    words = ("my box.stl", "three.json", "--unit", "m", "--friction", "1")
    run = real_grasp3d("evaluate", *words, cwd=folder)
    assert (run.returncode, run.stderr) == (0, "")
    assert "my box.stl: 3 grasps of 3 fingers; μ 1, α 22.6°" in run.stdout
    rows = rows_of(folder / "my box_grasps.csv")
    assert [row["label"] for row in rows] == ["S", "U", "U"]
    for name, count in (("S +surely stable", 1), ("M .*", 0), ("U +surely unstable", 2)):
        assert re.search(rf"■ {name} +{count} +{100.0 * count / 3.0:.1f} %", run.stdout)
    assert (rows[0]["x1"], rows[0]["distance1"]) == (0.5, pytest.approx(0.005))
    assert "contacts at most 5 mm from the surface" in run.stdout
    first = printed_rows(run.stdout)[0]
    assert first[3] == f"{rows[0]['score']:.3f}"
    assert first[4] == f"{math.degrees(rows[0]['critical_angle']):.1f}°"
    assert re.search(r"3 +■ U +[\d.]+ +– +0.0° +0.000", run.stdout)
    assert "written: my box_grasps.csv" in run.stdout
    assert len(list(folder.iterdir())) == 4


@pytest.mark.parametrize("name", ["out.csv", "out.parquet", "out.json"])
def test_results_and_metrics_are_written_in_every_format(folder: Path, name: str) -> None:
    words = ("my box.stl", "pair.json", "-o", name, "--sensor-resolution", "30", "--unit", "mm",
             "--metrics", "min_weight,epsilon_linf")  # fmt: skip
    text = printed("evaluate", *words, cwd=folder)
    assert "medians: min_weight 0.0625, epsilon_linf " in text
    assert printed("evaluate", *words, "-q", "--overwrite", cwd=folder) == ""
    (row,) = rows_of(folder / name)
    assert (row["label"], row["rank"]) == ("S", 5)
    assert row["max_resolution"] == pytest.approx(2.0 * math.atan(0.5))
    assert row["min_weight"] == pytest.approx(1.0 / 16.0)
    assert row["epsilon_linf"] > 0.0
    assert "grasp_isotropy" not in row
    if name == "out.json":
        settings = json.loads((folder / name).read_text(encoding="utf-8"))["grasp3d"]
        assert settings["sensor_resolution"] == pytest.approx(math.radians(30.0))


def test_of_many_grasps_only_the_best_are_printed_and_units_are_converted(folder: Path) -> None:
    bad = [[[0.5, 0.0, 0.0], [0.5, 0.1, 0.0]]]
    (folder / "many.json").write_text(json.dumps(bad * 190 + [PAIR] * 10), encoding="utf-8")
    text = printed("evaluate", "my box.stl", "many.json", "-o", "many.csv", cwd=folder)
    assert "the best 10 of 200" in text
    assert [row[2] for row in printed_rows(text)] == ["S"] * 10
    assert pc.read_csv(folder / "many.csv").num_rows == 200
    (folder / "cm.csv").write_text("x1,y1,z1,x2,y2,z2,unit\n50,0,0,-50,0,0,cm", encoding="utf-8")
    printed("evaluate", "my box.stl", "cm.csv", "--unit", "m", "-q", cwd=folder)
    assert rows_of(folder / "my box_grasps.csv")[0]["opening"] == pytest.approx(1.0)


def test_reasons_say_what_is_wrong_with_poses_and_what_wrong_poses_do(tmp_path: Path) -> None:
    """A pose in the middle, at the end, with a finger in the box, and beside it."""
    export(tmp_path / "box.stl", shapes.box((0.04, 0.06, 0.03)))
    write_hand(tmp_path / "hand.json", HAND)
    poses = np.tile(np.eye(4), (4, 1, 1))
    poses[1, 1, 3] = 0.038  # 1 mm of the pads
    poses[2, 0, 3] = 0.022  # a finger starts 2 mm in the object
    poses[3, 1, 3] = 0.06
    given = GraspPoses(poses=poses, unit="m", outcome=np.array([1.0, 1.0, 0.0, 0.0]))
    write_grasps(tmp_path / "poses.csv", given)

    def evaluate(*words: str) -> tuple[str, list[dict[str, Any]]]:
        text = printed("evaluate", "box.stl", "poses.csv", "--unit", "m", "--hand", "hand.json",
                       "-o", "b.csv", "--overwrite", *words, cwd=tmp_path)  # fmt: skip
        return text, rows_of(tmp_path / "b.csv")

    text, found = evaluate()
    heading = r"pose +label +score +β\* +α\* +ε +ε_min +mm +reason *$"
    assert re.search(heading, text, re.MULTILINE)
    for line in (
        "box.stl: 4 poses of hand; μ 0.5",
        "1 of 4: a finger is inside the object",
        "1 of 4: the jaws close on nothing",
        "held when tried: S 100.0 % of 2, U 0.0 % of 2",
        "poses read in the gripper's frame 'tcp', as the file states",
    ):
        assert line in text
    assert "closing_share" not in found[0]
    assert found[2]["reason"] == "finger 1 is 3 mm inside the object"
    assert [one["opening"] for one in found] == [pytest.approx(0.04)] * 2 + [None] * 2
    text, found = evaluate("--pose-error", "5mm,3deg")
    assert re.search(r"^box.stl: .*, poses wrong by up to 5 mm and 3 deg$", text, re.MULTILINE)
    assert 0.0 < found[1]["closing_share"] < 1.0
    for row, one in zip(printed_rows(text), found, strict=True):
        assert row[2:4] == [one["label"], f"{one['score']:.3f}"]
        assert " ".join(row).endswith(one["reason"])
    assert [one["label"] for one in found] == ["S", "U", "M", "U"]
    assert found[2]["shift"] == pytest.approx(-0.00375)
    assert "1 of 4: may close on nothing within the pose error" in text


TURN = Rotation.from_euler("xz", [20.0, 90.0], degrees=True).as_quat().tolist()
POSE = ",".join(map(str, [0.4, -0.05, 0.1, *TURN, "base_link"]))
BOX = ("box.stl", "--unit", "mm", "--hand", "franka", "--overwrite")


@pytest.mark.slow
def test_frames_of_the_gripper_and_of_the_robot_are_stated_doubted_and_found(
    tmp_path: Path,
) -> None:
    """Grasps as GraspGen and a robot state them, in a file whose format states otherwise."""
    export(tmp_path / "box.stl", shapes.box((80.0, 50.0, 30.0)))
    label = ("label", *BOX, "--table", "as-is", "--best", "9", "--max-edge", "20mm")
    assert "in the mesh's frame\n" in printed(*label, "--frame", "graspgen", "--grasps", "g.yaml",
                                              cwd=tmp_path)  # fmt: skip
    text = printed(*label, "--grasps", "robot.csv", "--object-pose", POSE, cwd=tmp_path)
    assert "poses in the file: in the robot's frame 'base_link'\n" in text
    assert text.count("warning: the table's up is 20° from z of the robot's frame") == 1
    robots = pc.read_csv(tmp_path / "robot.csv")
    pc.write_csv(robots.drop_columns(["object_pose"]), tmp_path / "silent.csv")
    ahead = "1 0 0 0\n0 1 0 0\n0 0 1 0.1034\n0 0 0 1\n"
    (tmp_path / "ahead.txt").write_text(ahead, encoding="utf-8")

    def evaluate(poses: str, *options: str) -> tuple[str, Any]:
        words = (BOX[0], poses, *BOX[1:], "-o", "out.parquet")
        text = " ".join(printed("evaluate", *words, *options, cwd=tmp_path).split())
        return text, pq.read_table(tmp_path / "out.parquet")

    text, _ = evaluate("g.yaml")
    assert "as stated ('hand') jaws that are thin close on the object where it is" in text
    assert "with --frame graspgen in" in text
    assert "poses read in the gripper's frame 'hand', as the file states none (--frame)" in text
    text, right = evaluate("g.yaml", "--frame", "graspgen")
    assert "warning" not in text
    assert "poses read in the gripper's frame 'graspgen' (--frame)" in text
    text, auto = evaluate("g.yaml", "--frame", "auto")
    assert "--frame auto: as stated ('hand')" in text
    settings = json.loads(auto.schema.metadata[b"grasp3d"])
    assert settings["pose_reading"].endswith("with --frame graspgen in 9")
    given = (
        auto, evaluate("g.yaml", "--frame", "ahead.txt")[1], evaluate("robot.csv")[1],
        evaluate("silent.csv", "--object-pose", POSE)[1],
    )  # fmt: skip
    for one in given:
        np.testing.assert_allclose(one["critical_angle"], right["critical_angle"], atol=1e-9)
        assert one["label"].to_pylist() == ["S"] * 9
    np.testing.assert_allclose(given[3]["px"], robots["px"], atol=1e-9)  # in the frame of the file
    _, elsewhere = evaluate("silent.csv", "--object-pose", "0.4,0,0,90")
    assert elsewhere["closing"].to_pylist() != ["closed"] * 9


SLIDERS = ("--hand", "sliders.json", "--unit", "m", "--sensor-resolution", "10")
GIVEN_POSES = ("box.stl", "poses.csv", *SLIDERS)


@pytest.fixture
def posed(tmp_path: Path) -> Path:
    """A box, the hand of sliders, and three poses about the box's middle: one touches it."""
    export(tmp_path / "box.stl", shapes.box(slider_hand.BOX))
    slider_hand.write(tmp_path)
    postures = [[TOUCHING] * 4, [0.0] * 4, [TOUCHING, TOUCHING, TOUCHING, -0.02]]
    poses = GraspPoses(
        poses=np.tile(np.eye(4), (3, 1, 1)), posture=np.array(postures), unit="m",
        joint_names=tuple(f"slide_{number}" for number in range(4)),
    )  # fmt: skip
    write_grasps(tmp_path / "poses.csv", poses)
    return tmp_path


def test_the_report_says_what_is_wrong_with_each_pose(posed: Path) -> None:
    load = ("--mass", "0.5kg", "--torque-limits", "2000")
    text = printed("evaluate", *GIVEN_POSES, *load, cwd=posed, columns=200)
    for line in (
        "box.stl: 3 poses of sliders; μ 0.5",
        "Surely held by sliders: 1 of 3 grasps",
        "contacts given, within 5 mm",
        "1 of 3: a joint is beyond its limit",
        "1 of 3: no link within 5 mm of the object",
        "joint 4 (slide_3) is 20 mm beyond its limit",
        "warning: torque_limits: 2000 N at slide_0, slide_1, slide_2, slide_3 is more",
        "written: box_grasps.csv",
    ):
        assert line in text
    (row,) = [line for line in text.splitlines() if line.startswith("   2 ")]
    assert row.split("  no link")[0].split().count("–") == 5  # no grasp has no load


def test_hands_with_joints_are_for_poses_of_one_object(posed: Path) -> None:
    (posed / "meshes").mkdir()
    hand = " ".join(SLIDERS)
    for words, message in {
        f"evaluate meshes poses.csv {hand}": "meshes: is a folder; name a file",
        f"batch box.stl -o out {hand}": "object by object (grasp3d evaluate MESH GRASPS --hand",
        f"label box.stl -o out.ply {hand}": "sliders is a hand with joints: poses with values",
        f"evaluate box.stl poses.csv {hand} --method extremes": "takes no method extremes",
    }.items():
        assert message in refusal(words, posed)


def test_what_motors_do_not_hold_is_not_surely_held(posed: Path) -> None:
    def evaluated(mass: str) -> dict[str, list]:
        words = ("--mass", mass, "--torque-limits", "10", "--overwrite")
        text = printed("evaluate", *GIVEN_POSES, *words, cwd=posed)
        assert f"load: {mass[:-2]} kg, weight\n" in text
        columns = pc.read_csv(posed / "box_grasps.csv").to_pydict()
        row = next(line.split() for line in text.splitlines() if re.match(" +1 .*slide_", line))
        assert f"{columns['load_fraction'][0]:.3f}" in row
        assert columns["load_fraction"][0] == pytest.approx(float(mass[:-2]) / payload(columns))
        return columns

    def payload(columns: dict[str, list]) -> float:
        return float(columns["payload"][0])

    light, heavy = evaluated("0.5kg"), evaluated("5kg")
    assert payload(light) == payload(heavy) == pytest.approx(1.35, abs=0.05)
    assert (light["label"][0], heavy["label"][0], light["payload"][1]) == ("S", "U", None)
    at_most = re.fullmatch(r"holds ([\d.]+) kg at most", heavy["reason"][0])
    assert at_most
    between = evaluated(f"{(payload(light) + float(at_most[1])) / 2:.2f}kg")
    assert between["label"][0] == "M"
    assert re.fullmatch(r"surely holds [\d.]+ kg only", between["reason"][0])


BARRETT = [-0.00591, -0.01282, 0.20112, 0.0, 0.38456, 0.9231, 0.0], [0.0, -1.0027, -1.0269, -1.217]
"""Position and quaternion w x y z of the base, and values of the joints."""


@pytest.mark.slow
def test_barrett_on_a_cone(tmp_path: Path) -> None:
    """All normals point down by the half angle of the cone, below which no friction holds it."""
    trimesh.creation.cone(0.05, 0.12, sections=128).export(tmp_path / "cone.stl")
    half_angle = math.atan(0.05 / 0.12)
    printed("hand", hand_file("barrett"), "-o", "hand.json", cwd=tmp_path)
    (place, posture), joints = BARRETT, read_hand(tmp_path / "hand.json").joint_names
    pose = trimesh.transformations.quaternion_matrix(place[3:])
    pose[:3, 3] = place[:3]
    given = GraspPoses(poses=pose, posture=np.array([posture]), joint_names=joints, unit="m")
    write_grasps(tmp_path / "poses.csv", given)
    for angle, label in ((math.pi / 4.0, "S"), (half_angle - math.radians(4.0), "U")):
        words = ("--sensor-resolution", "5", "--friction", f"{math.tan(angle):.3f}", "--overwrite")
        printed("evaluate", "cone.stl", "poses.csv", "--hand", "hand.json", "--unit", "m", *words,
                cwd=tmp_path)  # fmt: skip
        (row,) = pc.read_csv(tmp_path / "cone_grasps.csv").to_pylist()
        assert row["label"] == label
        assert row["critical_angle"] > half_angle - math.radians(0.5)
