"""Mistakes in files of hands with joints, planted in poses that touch a box, and named."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from grasp3d import ObjectMesh, ParallelGripper, load_mesh, read_hand
from grasp3d.cli import main
from grasp3d.errors import ContactError
from grasp3d.grasps.evaluation import evaluate_grasps
from grasp3d.grasps.hand_readings import mirrored
from grasp3d.grasps.pose_files import write_poses
from grasp3d.grasps.pose_readings import explained, suspected_reading
from grasp3d.grasps.poses import GraspPoses
from grasp3d.grasps.postures import ORDER
from grasp3d.grasps.readings import READING, frame_words
from grasp3d.hand.articulated.articulated_hand import ArticulatedHand
from grasp3d.hand.frames import FRAMES, GripperFrame
from tests.hand.test_articulated_hand import hand_of
from tests.helpers import shapes, slider_hand
from tests.helpers.hand_grasps import touching
from tests.helpers.hands import HANDS, hand_file, three_fingers


@cache
def box() -> ObjectMesh:
    return load_mesh(shapes.box((0.05, 0.07, 0.12)), unit="m")


@cache
def right(name: str, count: int = 40) -> GraspPoses:
    return touching(hand_of(name), box(), count)


def turned(poses: GraspPoses, *order: int) -> GraspPoses:
    """Poses whose quaternions x y z w have been read in another order."""
    changed = poses.poses.copy()
    quaternions = Rotation.from_matrix(poses.poses[:, :3, :3]).as_quat()
    changed[:, :3, :3] = Rotation.from_quat(quaternions[:, order]).as_matrix()
    return replace(poses, poses=changed)


def quarter(poses: GraspPoses) -> GraspPoses:
    """Of a palm whose frame is turned by 90 degrees about its y."""
    by = np.eye(4)
    by[:3, :3] = Rotation.from_euler("y", 90, degrees=True).as_matrix()
    return replace(poses, poses=poses.poses @ by)


def in_mm(poses: GraspPoses) -> GraspPoses:
    return replace(poses.scaled(1000.0, "m"))


def ordered(poses: GraspPoses, columns: list[int]) -> GraspPoses:
    """Of a file that does not name its joints, and has them in another order."""
    return replace(
        poses, posture=poses.posture[:, columns], joint_names=(), settings={ORDER: "assumed"}
    )


def reversed_joints(poses: GraspPoses) -> GraspPoses:
    return ordered(poses, [*range(poses.posture.shape[1])][::-1])


def thumb_first(poses: GraspPoses) -> GraspPoses:
    """The wrist stays where it is."""
    names = list(poses.joint_names)
    wrist = sum("WRJ" in name for name in names)
    thumb = {"shadow": 5}.get(poses.hand.name, 4)  # type: ignore[union-attr]
    columns = [*range(len(names))]
    return ordered(poses, columns[:wrist] + columns[-thumb:] + columns[wrist:-thumb])


MISTAKES: dict[str, tuple[Callable[[GraspPoses], GraspPoses], str]] = {
    "xyzw": (lambda p: turned(p, 1, 2, 3, 0), "in the order (x y z w) instead of (w x y z)"),
    "wxyz": (lambda p: turned(p, 3, 0, 1, 2), "in the order (w x y z) instead of (x y z w)"),
    "quarter": (quarter, "with --frame approach=-x,closing=+z,tcp=0"),
    "mm": (in_mm, "if their lengths are millimetres instead of metres"),
    "degrees": (lambda p: replace(p, posture=np.degrees(p.posture)), "joints are in degrees"),
    "reversed": (reversed_joints, "the order of their joints is another one (reversed)"),
}


def check(poses: GraspPoses, wrong: GraspPoses, words: str) -> None:
    """The mistake is named with both counts, nothing is changed silently, and it can be mended."""
    reading = suspected_reading(box(), wrong, poses.hand)  # type: ignore[arg-type]
    assert reading is not None
    assert words in str(reading)
    assert f" in {reading.stated} of {wrong.count} poses; " in str(reading)
    assert reading.fitting == wrong.count
    assert reading.stated < 0.8 * wrong.count
    mended = reading.applied(wrong)
    np.testing.assert_allclose(mended.poses, poses.poses, atol=1e-9)
    np.testing.assert_allclose(mended.posture, poses.posture, atol=1e-9)
    assert explained(box(), wrong, poses.hand).settings[READING] == str(reading)  # type: ignore[arg-type]


@pytest.mark.slow
@pytest.mark.parametrize("mistake", list(MISTAKES))
@pytest.mark.parametrize("name", HANDS)
def test_a_mistake_is_named_with_how_many_poses_touch(name: str, mistake: str) -> None:
    plant, words = MISTAKES[mistake]
    poses = right(name, 100 if mistake == "reversed" else 40)  # many orders touch as well
    check(poses, plant(poses), words)


def test_degrees_are_named_by_the_limits_of_joints_for_any_number_of_poses(tmp_path: Path) -> None:
    hand = read_hand(three_fingers(tmp_path))
    assert isinstance(hand, ArticulatedHand)
    bent = np.array([0.0, -0.5, 0.1, -0.2, 0.0, -1.0])
    postures = np.degrees([bent, 0.5 * bent, np.zeros(6)])
    for count in (1, 2, 3):
        wrong = GraspPoses(
            poses=np.tile(np.eye(4), (count, 1, 1)), posture=postures[:count], unit="m",
            joint_names=hand.joint_names, hand=hand,
        )  # fmt: skip
        reading = suspected_reading(box(), wrong, hand)
        assert reading is not None
        assert (reading.fitting, reading.stated) == (count, count // 3)
        assert "if their joints are in degrees, which --frame auto takes" in str(reading)
        mended = reading.applied(wrong)
        np.testing.assert_allclose(mended.posture, np.radians(wrong.posture))
        assert suspected_reading(box(), mended, hand) is None
    # Neither angles that are only beyond the limits nor a single damaged pose say so.
    for other in (bent + 2.0, [*np.tile(bent, (3, 1)), bent - 40.0]):
        values = np.reshape(other, (-1, 6))
        poses = np.tile(np.eye(4), (len(values), 1, 1))
        given = GraspPoses(poses=poses, posture=values, joint_names=hand.joint_names, unit="m")
        assert suspected_reading(box(), given, hand) is None


def test_lengths_of_joints_that_slide_are_no_degrees(tmp_path: Path) -> None:
    hand = read_hand(slider_hand.write(tmp_path))
    poses = GraspPoses(poses=np.eye(4), posture=np.full((1, 4), 30.0), unit="m")
    assert suspected_reading(box(), poses, hand) is None


@pytest.mark.slow
@pytest.mark.parametrize("name", ["allegro", "leap"])
def test_a_thumb_that_comes_first_is_named(name: str) -> None:
    poses = right(name, 100)
    check(poses, thumb_first(poses), "(the last finger, the thumb, first)")


@pytest.mark.slow
@pytest.mark.parametrize("name", HANDS)
def test_poses_that_touch_are_suspected_of_nothing(name: str) -> None:
    poses = right(name)
    assert suspected_reading(box(), poses, hand_of(name)) is None
    kept = explained(box(), poses, hand_of(name)).settings[READING]
    assert kept.startswith("kept the frame of the hand's base, ")


@pytest.mark.slow
@pytest.mark.parametrize("name", HANDS)
def test_a_scale_that_was_not_applied_is_named_and_cannot_be_mended(name: str) -> None:
    # The depth of a mesh that was scaled may be another one by 3 mm.
    clear = touching(hand_of(name), box(), deepest=0.012)
    poses = replace(clear, object_scale=0.08)
    reading = suspected_reading(box().scaled(12.5), poses, hand_of(name))
    assert reading is not None
    assert (reading.stated, reading.fitting) == (0, 40)
    assert "on the object at 0.08 times its size, the scale that they state, in 40" in str(reading)
    with pytest.raises(ContactError, match=r"at 0\.08 times its size"):
        reading.applied(poses)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["leap", "barrett"])
def test_poses_of_the_other_hand_are_named(name: str) -> None:
    left = mirrored(hand_of(name), 1, axes_kept=True)
    poses = replace(touching(left, box(), seed=3), hand=hand_of(name))
    reading = suspected_reading(box(), poses, hand_of(name))
    assert reading is not None
    assert "of a hand of the other side, mirrored along y, whose joints turn about the" in str(
        reading
    )
    assert reading.fitting == 40


def test_the_stated_frame_is_called_that_of_the_base() -> None:
    hand = hand_of("barrett")
    base = FRAMES["tcp"]
    assert frame_words(base, hand) == "the frame of the hand's base, base_link"
    assert frame_words(GripperFrame(link="palm"), hand) == "'link=palm'"
    assert frame_words(base, ParallelGripper.preset("franka")) == "'tcp'"


def test_a_mirrored_hand_is_the_mirror_image() -> None:
    hand = hand_of("barrett")
    other = mirrored(hand, 0, axes_kept=False)
    posture = np.random.default_rng(1).uniform(0.0, 1.0, (1, len(hand.joint_names)))
    mirror = np.diag([-1.0, 1.0, 1.0, 1.0])
    images = mirror @ hand.link_poses(posture) @ mirror
    np.testing.assert_allclose(other.link_poses(posture), images, atol=1e-12)
    one, two = (each.shape(0.0, posture[0]).vertices for each in (hand, other))
    size: Any = two.min(axis=0), two.max(axis=0)
    image = one * (-1.0, 1.0, 1.0)
    np.testing.assert_allclose(size, (image.min(axis=0), image.max(axis=0)), atol=1e-9)


@pytest.mark.slow
def test_the_evaluation_warns_and_the_command_line_says_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong = turned(right("allegro"), 1, 2, 3, 0)
    result = evaluate_grasps(box(), wrong, hand=hand_of("allegro"))
    words = "if their quaternions are in the order (x y z w) instead of (w x y z)"
    assert any(words in warning and "in 40" in warning for warning in result.warnings)
    np.testing.assert_array_equal(result.poses, wrong.poses)  # nothing is changed
    box().to_trimesh().export(tmp_path / "box.stl")
    write_poses(tmp_path / "wrong.csv", replace(wrong, hand=None))
    command = [
        "evaluate", str(tmp_path / "box.stl"), str(tmp_path / "wrong.csv"), "--unit", "m",
        "--hand", str(hand_file("allegro")), "-o", str(tmp_path / "out.csv"),
    ]  # fmt: skip
    assert main(command) == 0
    told = " ".join(" ".join(capsys.readouterr()).split())
    assert words in told
    assert main([*command, "--frame", "auto", "--overwrite"]) == 0
    told = " ".join(" ".join(capsys.readouterr()).split())
    assert "--frame auto: as stated (the frame of the hand's base, " in told
    assert "base_link) at least two links touch" in told
