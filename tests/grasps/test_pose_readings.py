"""Mistakes in files of poses, which are recognised by what the jaws would do without them."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from validate_readings import Mistake, misread, quaternions, scaled, transposed

import grasp3d
from grasp3d import ObjectMesh, load_mesh
from grasp3d.errors import ContactError
from grasp3d.grasps.evaluation import evaluate_grasps
from grasp3d.grasps.pose_files import read_poses
from grasp3d.grasps.pose_readings import (
    LEAST_GAIN,
    READING,
    PoseReading,
    explained,
    suspected_reading,
)
from grasp3d.grasps.poses import GraspPoses
from grasp3d.hand.frames import FRAMES
from grasp3d.hand.object_pose import ObjectPose
from grasp3d.hand.parallel_gripper import preset
from tests.helpers import shapes

Floats = Any
HAND = preset("franka")
MESHES = Path(__file__).parents[2] / "meshes"
INCH = 1.0 / 0.0254
QUARTER = np.array(
    [[0.0, -1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)
"""A quarter of a turn about the approach direction, after which it closes along its width."""

TURN = np.diag([-1.0, -1.0, 1.0, 1.0])
"""Half a turn about the approach direction, after which the gripper is the same."""


@cache
def spray() -> tuple[ObjectMesh, GraspPoses]:
    """A shipped mesh, and poses that were found on it, a little off."""
    mesh = load_mesh(MESHES / "spray.glb")
    reach = grasp3d.label_surface(mesh, hand=HAND).grasps.reach
    assert reach is not None
    found = reach.poses[np.isfinite(reach.poses).all(axis=(1, 2))]
    rng = np.random.default_rng(0)
    poses = found[rng.choice(len(found), 120, replace=False)].copy()
    poses[:, :3, 3] += rng.normal(0.0, 0.001, (120, 3))
    return mesh, GraspPoses(poses=poses, unit="m", hand=HAND)


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


MISTAKES: dict[str, tuple[Mistake, str]] = {
    "closing axis": (Mistake("graspgen", "hand"), "with --frame graspgen in"),
    "base": (Mistake("graspgen", "tcp"), "with --frame graspgen in"),
    "base of its own": (Mistake("hand", "tcp"), "with --frame hand in"),
    "flange": (Mistake("panda_link8", "hand"), "with --frame panda_link8 in"),
    "TCP": (Mistake("tcp", "graspgen"), "with --frame tcp in"),
    "axes": (Mistake("graspnetapi", "tcp"), "with --frame graspnetapi in"),
    "other axes": (
        Mistake("approach=-y,closing=z,tcp=base", "hand"),
        "approach=-y,closing=+z,tcp=base in",
    ),
    "origin": (
        Mistake("approach=z,closing=x,tcp=0.06", "graspgen"),
        "approach=+z,closing=+x,tcp=0.06",
    ),
    "wxyz": (
        Mistake("hand", "hand", quaternions(3, 0, 1, 2)),
        "order (w x y z) instead of (x y z w)",
    ),
    "xyzw": (
        Mistake("hand", "hand", quaternions(1, 2, 3, 0)),
        "order (x y z w) instead of (w x y z)",
    ),
    "zwxy": (Mistake("hand", "hand", quaternions(2, 3, 0, 1)), "halves of their quaternions"),
    "transposed": (Mistake("graspgen", "graspgen", transposed), "rotations are inverted"),
    "inverse": (
        Mistake("graspgen", "graspgen", np.linalg.inv),
        "poses of the object in the gripper's",
    ),
    "converted before": (
        Mistake("hand", "hand", quaternions(3, 0, 1, 2)),
        "in the frame 'hand', which",
    ),
    "mm": (Mistake("hand", "hand", scaled(1000.0)), "lengths are millimetres instead of metres"),
    "cm": (Mistake("tcp", "tcp", scaled(100.0)), "lengths are centimetres instead of metres"),
    "in": (
        Mistake("graspgen", "graspgen", scaled(1.0 / 0.0254)),
        "lengths are inches instead of metres",
    ),
    "scale": (Mistake("graspgen", "graspgen", scaled(0.5)), "an object of 0.5 times its size"),
}
"""What is wrong, and words of the reading that explains it."""


@pytest.mark.slow
@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_named_and_undone(name: str) -> None:
    mistake, words = MISTAKES[name]
    mesh, right = spray()
    wrong = misread(right, mistake)
    if name == "converted before":  # what a program gives that has read them so
        wrong = replace(wrong, gripper_frame=FRAMES["tcp"])
    reading = suspected_reading(mesh, wrong, HAND)
    assert reading is not None
    assert words in str(reading)
    assert reading.fitting - reading.stated >= LEAST_GAIN * reading.tried
    read = reading.applied(wrong)
    near = 0.009 if name == "origin" else 1e-9  # half a pad
    assert any(
        np.abs(read.poses[:, :3, :3] - one[:, :3, :3]).max() < 1e-9
        and np.abs(read.poses[:, :3, 3] - one[:, :3, 3]).max() < near
        for one in (right.poses, right.poses @ TURN)
    )
    assert suspected_reading(mesh, read, HAND) is None
    assert read.settings[READING] == str(reading)
    np.testing.assert_array_equal(explained(mesh, wrong, HAND).poses, read.poses)


@pytest.mark.slow
def test_poses_in_the_frame_of_a_robot_are_changed_there() -> None:
    mesh, right = spray()
    pose = ObjectPose.of("x=0.4m,z=0.1m,yaw=35deg,roll=20deg")
    moved = replace(right, poses=pose.matrix @ right.poses)
    wrong = misread(moved, Mistake("hand", "hand", quaternions(3, 0, 1, 2)))
    wrong = replace(wrong, poses=np.linalg.inv(pose.matrix) @ wrong.poses, object_pose=pose)
    reading = suspected_reading(mesh, wrong, HAND)
    assert "order (w x y z)" in str(reading)
    assert reading is not None
    np.testing.assert_allclose(reading.applied(wrong).poses, right.poses, atol=1e-9)


@pytest.mark.slow
def test_counts_are_of_a_sample_of_many() -> None:
    mesh, right = spray()
    many = misread(right.take(np.arange(1200) % right.count), Mistake("graspgen", "hand"))
    reading, once = (
        suspected_reading(mesh, poses, HAND) for poses in (many, many.take(np.arange(120)))
    )
    assert reading is not None
    assert once is not None
    assert "poses, a sample of the 1200; with --frame graspgen in " in str(reading)
    assert reading.tried <= 120  # the same pose again says nothing new
    assert (reading.fitting, reading.tried) == (once.fitting, once.tried)


@pytest.mark.slow
def test_units_of_poses_are_found_whatever_the_unit_of_the_mesh() -> None:
    mesh, right = spray()
    small = load_mesh((1000.0 * mesh.vertices, mesh.faces), unit="mm")
    right = replace(right, opening=0.05, pregrasp_opening=0.06)
    for factor, words in {1000.0: "millimetres instead of metres", INCH: "inches instead"}.items():
        wrong = misread(right, Mistake("hand", "hand", scaled(factor))).in_unit("mm")
        reading = suspected_reading(small, wrong, HAND)
        assert words in str(reading)
    assert reading is not None
    given = replace(wrong, opening=INCH * 50.0, pregrasp_opening=INCH * 60.0)
    read = reading.applied(given)
    np.testing.assert_allclose(read.opening, 50.0)
    np.testing.assert_allclose(read.pregrasp_opening, 60.0)
    with pytest.raises(ContactError, match="unit of the poses is not known"):
        reading.applied(replace(given, unit=None))


@pytest.mark.slow
def test_many_poses_at_one_place_are_one_pose() -> None:
    """Around one bad pose all readings fit that happen to fit there."""
    mesh, right = spray()
    rng = np.random.default_rng(0)
    for row in range(12):
        poses = np.tile(right.poses[row], (40, 1, 1))
        poses[:, :3, 3] += rng.normal(0.0, 0.002, (40, 3))
        turned = poses @ QUARTER
        assert suspected_reading(mesh, GraspPoses(poses=turned, unit="m", hand=HAND), HAND) is None


def suspected(mesh: ObjectMesh, poses: GraspPoses) -> PoseReading | None:
    return suspected_reading(mesh, poses, HAND)


def test_nothing_is_suspected_of_good_poses_and_of_few(cone: ObjectMesh, good: GraspPoses) -> None:
    assert suspected(cone, good) is None
    wrong = misread(good, Mistake("graspgen", "tcp"))
    assert suspected(cone, wrong.take(np.arange(4))) is None
    assert suspected(cone, good.take([])) is None
    kept = explained(cone, good, HAND)
    np.testing.assert_array_equal(kept.poses, good.poses)
    assert kept.settings[READING] == "kept 'tcp', as stated: no other frame is named"


def test_poses_beside_the_object_have_no_other_reading(cone: ObjectMesh, good: GraspPoses) -> None:
    """That nothing fits is no proof of a mistake."""
    beside = good.poses.copy()
    beside[:, :3, 3] += 0.2 * Rotation.random(40, random_state=1).apply([1.0, 0.0, 0.0])
    assert suspected(cone, replace(good, poses=beside)) is None


def test_several_readings_that_fit_are_not_named(cone: ObjectMesh, good: GraspPoses) -> None:
    """Turned about the middle of the object, these poses fit in all directions."""
    wrong = misread(good, Mistake("graspgen", "tcp"))
    reading = suspected(cone, wrong)
    assert reading is not None
    assert reading.frame is None
    told = str(reading)
    assert "with one of several other readings, of which none wins" in told
    named = told.partition("none wins (")[2].partition(": state it")[0].split("; ")
    assert len(named) == 3
    assert all(name.startswith("with --frame ") for name in named)
    assert "which --frame auto takes" not in told
    with pytest.raises(ContactError, match=r"give the frame \(--frame"):
        reading.applied(wrong)
    np.testing.assert_array_equal(explained(cone, wrong, HAND).poses, wrong.poses)


def test_evaluated_poses_are_warned_of(cone: ObjectMesh, good: GraspPoses) -> None:
    def warnings(poses: GraspPoses, mesh: ObjectMesh = cone) -> str:
        return " ".join(evaluate_grasps(mesh, poses, hand=HAND).warnings)

    assert "jaws" not in warnings(good)
    wrong = misread(good, Mistake("graspgen", "tcp"))
    assert "as stated ('tcp') the jaws close on the object" in warnings(wrong)
    results = evaluate_grasps(cone, wrong, hand=HAND)
    assert results.to_poses().settings["suspected_reading"] == str(results.reading)
    assert evaluate_grasps(cone, good, hand=HAND).reading is None
    wide = load_mesh(shapes.box((0.3, 0.3, 0.3)), unit="m", max_edge=1.0)
    inside = good.poses.copy()
    inside[:, :3, 3] *= 0.1
    text = warnings(replace(good, poses=inside), wide)
    assert f"starts in the object in {good.count} of {good.count} poses" in text
    assert "narrower than the stroke" in text


@pytest.mark.slow
def test_published_poses_in_other_orders() -> None:
    """Quaternions and frames of a mug's 2,000 poses mixed up."""
    folder = shapes.shared("datasets", "acronym")
    poses = read_poses(next(folder.glob("*.h5")), hand=HAND)
    mesh = load_mesh(next(folder.glob("*.obj")), unit="m", max_edge=1e9)
    assert poses.object_scale is not None
    mesh = load_mesh((poses.object_scale * mesh.vertices, mesh.faces), unit="m", max_edge=1e9)
    assert suspected(mesh, poses) is None
    for name in ("wxyz", "xyzw", "inverse", "base", "closing axis", "mm"):
        mistake, words = MISTAKES[name]
        assert words in str(suspected(mesh, misread(poses, mistake)))
