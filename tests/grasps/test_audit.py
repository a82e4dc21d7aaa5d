"""Mistakes in files of poses, which the audit finds by what the hand would touch without them."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import grasp3d
from grasp3d import ObjectMesh, load_mesh
from grasp3d.errors import ContactError
from grasp3d.formats.poses import GraspPoses
from grasp3d.grasps.audit import FEWEST, READING, UNCHANGED, audit_poses, explained
from grasp3d.grasps.evaluation import evaluate_grasps
from grasp3d.hand.frames import FRAMES, GripperFrame, ObjectPose
from grasp3d.hand.hand import Hand
from grasp3d.hand.parallel_gripper import ParallelGripper
from tests.hand.test_articulated_hand import hand_of
from tests.helpers import shapes
from tests.helpers.hand_grasps import touching

Floats = Any
HAND = ParallelGripper.preset("franka")
MESHES = Path(__file__).parents[2] / "meshes"
INCH = 1.0 / 0.0254
QUARTER = np.array(
    [[0.0, -1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)
"""A quarter of a turn about the approach direction, after which it closes along its width."""

TURN = np.diag([-1.0, -1.0, 1.0, 1.0])
"""Half a turn about the approach direction, after which the gripper is the same."""


@dataclass(frozen=True)
class Mistake:
    """The frame in which a file has poses, the one in which it is read, and what else is wrong."""

    true: GripperFrame
    stated: GripperFrame
    change: Callable[[Floats], Floats] = np.asarray


def mistake(true: str, stated: str, change: Callable[[Floats], Floats] = np.asarray) -> Mistake:
    return Mistake(FRAMES[true], FRAMES[stated], change)


def turned(poses: Floats, rotations: Floats) -> Floats:
    changed = poses.copy()
    changed[:, :3, :3] = rotations
    return changed


def quaternions(*order: int) -> Callable[[Floats], Floats]:
    """Quaternions (x y z w) that are stored in another order."""

    def change(poses: Floats) -> Floats:
        stored = Rotation.from_matrix(poses[:, :3, :3]).as_quat()[:, order]
        return turned(poses, Rotation.from_quat(stored).as_matrix())

    return change


def scaled(factor: float) -> Callable[[Floats], Floats]:
    return lambda poses: poses * np.where(np.arange(4) == 3, [[factor]] * 3 + [[1.0]], 1.0)


def transposed(poses: Floats) -> Floats:
    return turned(poses, poses[:, :3, :3].transpose(0, 2, 1))


def misread(poses: GraspPoses, mistake: Mistake, hand: Hand = HAND) -> GraspPoses:
    """The poses as they are read from a file with a mistake."""
    in_file = mistake.change(poses.poses @ np.linalg.inv(mistake.true.to_tcp(hand)))
    read = in_file @ mistake.stated.to_tcp(hand)
    return replace(poses, poses=read, gripper_frame=mistake.stated)


@cache
def found_on(file: str) -> tuple[ObjectMesh, GraspPoses]:
    mesh = load_mesh(MESHES / file, unit="m")
    best = grasp3d.best_grasps(grasp3d.label_surface(mesh, hand=HAND), 100)
    return mesh, GraspPoses(poses=best.poses, unit="m", hand=HAND)


@pytest.fixture(scope="module")
def cone() -> ObjectMesh:
    """An object without symmetry, off the origin of its file."""
    vertices, faces = shapes.lopsided()
    return load_mesh((0.03 * vertices + [0.02, -0.01, 0.05], faces), unit="m", max_edge=1.0)


@pytest.fixture(scope="module")
def good(cone: ObjectMesh) -> GraspPoses:
    """Poses at the middle of the object from all sides: turned about it they fit as well."""
    poses = np.tile(np.eye(4), (40, 1, 1))
    poses[:, :3, :3] = Rotation.random(40, random_state=0).as_matrix()
    poses[:, :3, 3] = cone.center
    return GraspPoses(poses=poses, unit="m", hand=HAND)


BURG_AT_BASE = GripperFrame(approach="-z", closing="x", origin="base")
MISTAKES: dict[str, tuple[Mistake, str]] = {
    "closing axis": (mistake("graspgen", "hand"), "with --frame graspgen in"),
    "base": (mistake("graspgen", "tcp"), "with --frame graspgen in"),
    "flange": (mistake("panda_link8", "hand"), "with --frame panda_link8 in"),
    "TCP": (mistake("tcp", "graspgen"), "with --frame tcp in"),
    "axes at the base": (
        Mistake(BURG_AT_BASE, FRAMES["graspgen"]),
        "with the axes of burg at the base, which --frame auto takes, in",
    ),
    "wxyz": (
        mistake("hand", "hand", quaternions(3, 0, 1, 2)),
        "with their quaternions in the order (w x y z) instead of (x y z w), which",
    ),
    "xyzw": (
        mistake("hand", "hand", quaternions(1, 2, 3, 0)),
        "with their quaternions in the order (x y z w) instead of (w x y z), which",
    ),
    "transposed": (mistake("graspgen", "graspgen", transposed), "with their rotations transposed"),
    "frame and order": (
        mistake("graspgen", "tcp", quaternions(3, 0, 1, 2)),
        "with --frame graspgen and their quaternions in the order (w x y z)",
    ),
    "mm": (mistake("hand", "hand", scaled(1000.0)), "with their lengths in mm instead of m,"),
    "in": (mistake("graspgen", "graspgen", scaled(INCH)), "their lengths in inches instead of m,"),
    "m": (mistake("graspgen", "graspgen", scaled(0.001)), "their lengths in m instead of mm,"),
    "frame and mm": (
        mistake("graspgen", "tcp", scaled(1000.0)),
        "with --frame graspgen and their lengths in mm instead of m, which --frame auto takes,",
    ),
}
"""What is wrong, and words of the reading in which the poses are right."""


@pytest.mark.slow
@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_named_and_undone(name: str) -> None:
    mistake, words = MISTAKES[name]
    mesh, right = found_on("mug.glb")
    wrong = misread(right, mistake)
    reading = audit_poses(mesh, wrong, HAND)
    assert reading is not None
    assert words in str(reading)
    # Some that are held at an edge touch less than a twentieth of a pad.
    assert reading.fitting >= max(2 * reading.stated, 0.8 * right.count)
    read = reading.applied(wrong)
    assert any(np.abs(read.poses - one).max() < 1e-9 for one in (right.poses, right.poses @ TURN))
    assert audit_poses(mesh, read, HAND) is None
    assert read.settings[READING] == str(reading)
    np.testing.assert_array_equal(explained(mesh, wrong, HAND).poses, read.poses)


@pytest.mark.slow
@pytest.mark.parametrize("file", ["banana.ply", "hammer.ply", "bottle.off"])
def test_poses_that_are_turned_do_not_pass_in_silence(file: str) -> None:
    mesh, right = found_on(file)
    assert audit_poses(mesh, right, HAND) is None
    sideways = right.changed(lambda poses: poses @ QUARTER)
    reading = audit_poses(mesh, sideways, HAND)
    assert reading is not None
    assert reading.fitting >= 2 * reading.stated
    counts = f"in {reading.stated} of {right.count} poses; "
    assert counts in str(reading)
    warnings = evaluate_grasps(mesh, sideways, hand=HAND).warnings
    assert str(reading) in warnings


@pytest.mark.slow
@pytest.mark.parametrize("file", ["mug.glb", "box.obj"])
def test_there_is_no_alarm_at_poses_of_which_many_miss(file: str) -> None:
    mesh, right = found_on(file)
    rng = np.random.default_rng(0)
    for count in (8, 100):
        for millimetres, degrees in ((2.0, 3.0), (5.0, 15.0), (10.0, 15.0), (20.0, 15.0)):
            poses = right.poses[rng.integers(0, right.count, count)].copy()
            poses[:, :3, 3] += rng.normal(0.0, 0.001 * millimetres, (count, 3))
            turns = rng.normal(0.0, np.radians(degrees), (count, 3))
            poses[:, :3, :3] = poses[:, :3, :3] @ Rotation.from_rotvec(turns).as_matrix()
            assert audit_poses(mesh, GraspPoses(poses=poses, unit="m", hand=HAND), HAND) is None


@pytest.mark.slow
def test_poses_in_the_frame_of_a_robot_are_changed_there() -> None:
    mesh, right = found_on("mug.glb")
    pose = ObjectPose.of("0.4,0,0.1,35")
    moved = replace(right, poses=pose.matrix @ right.poses)
    wrong = misread(moved, mistake("hand", "hand", quaternions(3, 0, 1, 2)))
    wrong = replace(wrong, poses=np.linalg.inv(pose.matrix) @ wrong.poses, object_pose=pose)
    reading = audit_poses(mesh, wrong, HAND)
    assert reading is not None
    np.testing.assert_allclose(reading.applied(wrong).poses, right.poses, atol=1e-9)


def test_nothing_is_said_of_good_poses_and_of_few(cone: ObjectMesh, good: GraspPoses) -> None:
    assert audit_poses(cone, good, HAND) is None
    wrong = misread(good, mistake("graspgen", "tcp"))
    assert audit_poses(cone, wrong.take(np.arange(FEWEST - 1)), HAND) is None
    assert audit_poses(cone, good.take([]), HAND) is None
    kept = explained(cone, good, HAND)
    np.testing.assert_array_equal(kept.poses, good.poses)
    assert kept.settings[READING] == UNCHANGED


def test_several_readings_that_fit_are_not_named(cone: ObjectMesh, good: GraspPoses) -> None:
    """Turned about the middle of the object, these poses fit in all directions."""
    wrong = misread(good, mistake("graspgen", "tcp"))
    reading = audit_poses(cone, wrong, HAND)
    assert reading is not None
    assert not reading.stands_out
    told = str(reading)
    assert "in several other readings, of which none stands out, in up to" in told
    assert "--frame" not in told
    with pytest.raises(ContactError, match=r"give the frame \(--frame"):
        reading.applied(wrong)
    np.testing.assert_array_equal(explained(cone, wrong, HAND).poses, wrong.poses)


def test_evaluated_poses_are_warned_of(cone: ObjectMesh, good: GraspPoses) -> None:
    def warnings(poses: GraspPoses, mesh: ObjectMesh = cone) -> str:
        return " ".join(evaluate_grasps(mesh, poses, hand=HAND).warnings)

    assert "jaws" not in warnings(good)
    wrong = misread(good, mistake("graspgen", "tcp"))
    assert "as stated ('tcp') jaws that are thin close on the object" in warnings(wrong)
    results = evaluate_grasps(cone, wrong, hand=HAND)
    assert results.to_poses().settings["suspected_reading"] == str(results.reading)
    assert evaluate_grasps(cone, good, hand=HAND).reading is None
    wide = load_mesh(shapes.box((0.3, 0.3, 0.3)), unit="m", max_edge=1.0)
    assert f"starts in the object in {good.count} of {good.count} poses" in warnings(good, wide)


# Hands with joints: their links touch a box.


@cache
def box() -> ObjectMesh:
    return load_mesh(shapes.box((0.05, 0.07, 0.12)), unit="m")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["barrett", "shadow"])
def test_a_mistake_in_poses_of_a_hand_is_named(name: str) -> None:
    hand = hand_of(name)
    poses = touching(hand, box(), 40)
    assert audit_poses(box(), poses, hand) is None
    assert explained(box(), poses, hand).settings[READING] == UNCHANGED
    for name_of, words in (
        ("xyzw", "in the order (x y z w) instead of (w x y z)"),
        ("mm", "with their lengths in mm instead of m"),
    ):
        wrong = misread(poses, MISTAKES[name_of][0], hand)
        reading = audit_poses(box(), wrong, hand)
        assert reading is not None
        assert words in str(reading)
        assert f" in {reading.stated} of 40 poses; " in str(reading)
        assert reading.fitting == 40
        np.testing.assert_allclose(reading.applied(wrong).poses, poses.poses, atol=1e-9)
    if name == "shadow":
        palm = np.linalg.inv(GripperFrame(link="palm").to_tcp(hand))
        reading = audit_poses(box(), replace(poses, poses=poses.poses @ palm), hand)
        assert "--frame palm in 40" in str(reading)
