"""`grasp3d evaluate` for poses of hands with joints."""

import math
import re
from pathlib import Path

import numpy as np
import pyarrow.csv as pc
import pytest
import trimesh

from grasp3d.formats import GraspPoses, write_grasps
from grasp3d.hand.hand_files import read_hand
from tests.helpers import shapes, slider_hand
from tests.helpers.commands import export, printed, refusal
from tests.helpers.hands import hand_file
from tests.helpers.slider_hand import BOX, TOUCHING

HAND = ("--hand", "sliders.json", "--unit", "m", "--sensor-resolution", "10")
POSES = ("box.stl", "poses.csv", *HAND)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A box, the hand of sliders, and three poses about the box's middle: one touches it."""
    export(tmp_path / "box.stl", shapes.box(BOX))
    slider_hand.write(tmp_path)
    postures = [[TOUCHING] * 4, [0.0] * 4, [TOUCHING, TOUCHING, TOUCHING, -0.02]]
    poses = GraspPoses(
        poses=np.tile(np.eye(4), (3, 1, 1)), posture=np.array(postures), unit="m",
        joint_names=tuple(f"slide_{number}" for number in range(4)),
    )  # fmt: skip
    write_grasps(tmp_path / "poses.csv", poses)
    return tmp_path


def test_the_report_says_what_is_wrong_with_each_pose(folder: Path) -> None:
    load = ("--mass", "0.5kg", "--torque-limits", "2000")
    text = printed("evaluate", *POSES, *load, cwd=folder, columns=200)
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


def test_hands_with_joints_are_for_poses_of_one_object(folder: Path) -> None:
    (folder / "meshes").mkdir()
    hand = " ".join(HAND)
    for words, message in {
        f"evaluate meshes poses.csv {hand}": "meshes: is a folder; name a file",
        f"batch box.stl -o out {hand}": "object by object (grasp3d evaluate MESH GRASPS --hand",
        f"label box.stl -o out.ply {hand}": "sliders is a hand with joints: poses with values",
        f"evaluate box.stl poses.csv {hand} --method extremes": "takes no method extremes",
    }.items():
        assert message in refusal(words, folder)


def test_what_motors_do_not_hold_is_not_surely_held(folder: Path) -> None:
    def evaluated(mass: str) -> dict[str, list]:
        words = ("--mass", mass, "--torque-limits", "10", "--overwrite")
        text = printed("evaluate", *POSES, *words, cwd=folder)
        assert f"load: {mass[:-2]} kg, weight\n" in text
        columns = pc.read_csv(folder / "box_grasps.csv").to_pydict()
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
