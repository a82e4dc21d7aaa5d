from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import grasp3d
from grasp3d.errors import ContactError
from grasp3d.formats.poses import GraspPoses
from grasp3d.hand.pose_checks import check_near, pose_warning
from grasp3d.settings.units import METRES
from tests.helpers import shapes


def random_poses(count: int, seed: int = 0, distance: float = 0.05) -> np.ndarray:
    rng = np.random.default_rng(seed)
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = Rotation.random(count, rng=rng).as_matrix()
    poses[:, :3, 3] = distance * rng.normal(size=(count, 3))
    return poses


def example(count: int = 4) -> GraspPoses:
    return GraspPoses(
        poses=random_poses(count),
        opening=np.linspace(0.01, 0.05, count),
        unit="m",
        columns={
            "label": np.array(["S", "M", "U", "S"])[:count],
            "contacts": np.arange(6.0 * count).reshape(count, 2, 3),
            "epsilon": np.linspace(0.0, 1.0, count),
            "shift": np.full(count, 1e-3),
            "area1": np.full(count, 1e-4),
        },
    )


def test_one_number_is_for_all_poses_and_what_is_not_given_is_not_known() -> None:
    poses = GraspPoses(poses=random_poses(3), opening=0.05)
    assert poses.opening.tolist() == [0.05] * 3
    for name in ("pregrasp_opening", "scores", "outcome"):
        assert np.isnan(getattr(poses, name)).all()
    assert poses.names == ("grasp_1", "grasp_2", "grasp_3")
    assert (len(poses), poses.hand) == (3, None)
    assert "GraspPoses(poses=float64[3, 4, 4]" in repr(poses)


def test_arrays_are_copies_that_cannot_be_changed() -> None:
    given = random_poses(2)
    poses = GraspPoses(poses=given, columns={"epsilon": np.zeros(2)})
    given[:] = 0.0
    assert poses.poses[0, 3, 3] == 1.0
    for array in (poses.poses, poses.opening, poses.columns["epsilon"]):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


def test_exact_rotations_stay_bit_identical_and_rounded_ones_become_rotations() -> None:
    exact = random_poses(20)
    assert (GraspPoses(poses=exact).poses == exact).all()
    rounded = np.round(exact, 4)
    found = GraspPoses(poses=rounded).poses
    products = found[:, :3, :3] @ found[:, :3, :3].transpose(0, 2, 1)
    assert np.abs(products - np.eye(3)).max() < 1e-12
    assert np.abs(found - exact).max() < 2e-4


@given(st.sampled_from(list(METRES)), st.sampled_from(list(METRES)))
def test_units_there_and_back(one: Any, other: Any) -> None:
    poses = example().in_unit(one)
    there = poses.in_unit(other)
    factor = METRES[one] / METRES[other]
    assert there.unit == other
    assert there.poses[:, :3, 3] == pytest.approx(poses.poses[:, :3, 3] * factor)
    assert (there.poses[:, :3, :3] == poses.poses[:, :3, :3]).all()
    assert there.opening == pytest.approx(poses.opening * factor)
    assert there.columns["contacts"] == pytest.approx(poses.columns["contacts"] * factor)
    assert there.columns["shift"] == pytest.approx(poses.columns["shift"] * factor)
    assert there.columns["area1"] == pytest.approx(poses.columns["area1"] * factor**2)
    assert (there.columns["epsilon"] == poses.columns["epsilon"]).all()
    assert there.in_unit(one).poses == pytest.approx(poses.poses)


def test_a_unit_that_is_not_known_cannot_be_converted() -> None:
    with pytest.raises(ContactError, match=r"unit of the poses is not known.*unit="):
        GraspPoses(poses=random_poses(1)).in_unit("m")


def test_take_by_indices_and_by_mask() -> None:
    poses = example()
    chosen = poses.take([2, 0])
    assert chosen.names == ("grasp_3", "grasp_1")
    assert chosen.columns["label"].tolist() == ["U", "S"]
    assert (chosen.poses == poses.poses[[2, 0]]).all()
    assert poses.take(poses.columns["label"] == "S").names == ("grasp_1", "grasp_4")
    assert len(poses.take(np.zeros(4, dtype=bool))) == len(poses.take([])) == 0


def with_joints() -> GraspPoses:
    moved = random_poses(3)
    moved[:, 2, 3] -= 0.01
    return GraspPoses(
        poses=random_poses(3),
        posture=np.arange(6.0).reshape(3, 2),
        joint_names=("index", "thumb"),
        pregrasp_posture=[[0.1, 0.2], [0.3, np.nan], [0.5, 0.6]],
        squeeze_posture=np.ones((3, 2)),
        pregrasp_poses=moved,
        unit="m",
    )


def test_what_is_before_and_after_a_grasp_stays_with_it() -> None:
    poses = with_joints()
    assert poses.pregrasp_poses is not None
    way = np.linalg.inv(poses.poses) @ poses.pregrasp_poses
    in_mm, moved = poses.in_unit("mm"), poses.moved(random_poses(1, seed=5)[0])
    assert in_mm.pregrasp_poses is not None
    assert moved.pregrasp_poses is not None
    np.testing.assert_allclose(np.linalg.inv(moved.poses) @ moved.pregrasp_poses, way, atol=1e-12)
    np.testing.assert_allclose(
        in_mm.pregrasp_poses[:, 2, 3], poses.pregrasp_poses[:, 2, 3] * 1000.0
    )
    assert (in_mm.posture == poses.posture).all()
    some = poses.take([2, 0])
    for name in ("posture", "pregrasp_posture", "squeeze_posture", "pregrasp_poses"):
        assert (getattr(some, name) == getattr(poses, name)[[2, 0]]).all()
    assert (some.joint_names, some.squeeze_poses) == (poses.joint_names, None)
    assert poses.take([]).posture.shape == (0, 2)


def changed(index: Any, factor: float, value: float = 0.0) -> np.ndarray:
    """Poses with other numbers: multiplied by a factor, and with a value added."""
    poses = random_poses(3)
    poses[index] = factor * poses[index] + value
    return poses


@pytest.mark.parametrize(
    ("poses", "message"),
    [
        (np.zeros((3, 3)), r"shape \(k, 4, 4\); got \(3, 3\)"),
        ([np.eye(4), np.eye(3)], "must be 4x4 matrices of numbers"),
        (changed((1, 0, 3), np.nan), "pose 2 has numbers that are not finite"),
        (random_poses(2).transpose(0, 2, 1), "pose 1: the last row .* is it transposed"),
        (changed(np.s_[1:, :3, 0], -1.0), r"pose 2 is left-handed \(det.* -1\), as are 2 of 3"),
        (changed(np.s_[2, :3, :3], 1000.0), r"pose 3: its axes have the lengths \(1000, 10.*scale"),
    ],
)
def test_what_is_no_pose_is_refused_with_the_probable_cause(poses: Any, message: str) -> None:
    with pytest.raises(ContactError, match=message):
        GraspPoses(poses=poses)


JOINTS = {"posture": np.zeros((3, 2))}


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"opening": [0.1, 0.2]}, r"opening must be numbers of shape \(3,\)"),
        ({**JOINTS, "joint_names": ("one",)}, "2 joints need as many names that differ"),
        ({"posture": [[0, 0], [0, np.nan], [0, 0]]}, "grasp 2: value 2 of its posture must be fi"),
        ({**JOINTS, "pregrasp_poses": np.eye(4)}, "3 poses need as many pregrasp_poses"),
        ({"opening": -0.1}, "grasp 1: opening must be a length of at least 0"),
        ({"outcome": [1.0, 0.0, 0.5]}, "grasp 3: outcome must be 1"),
        ({"names": ("a", "b")}, "3 poses need 3 names; got 2"),
        ({"names": ("a", "b", "\ud800")}, "grasp 3: a name must be text that can be printed"),
        ({"unit": "km"}, "unit of poses must be one of m, cm, mm, in; got 'km'"),
        ({"columns": {"success": np.zeros(3)}}, "no column of poses can be called 'success'"),
        ({"columns": {"a": [[1, 2], [1], [1]]}}, "a must have as many values in all grasps"),
    ],
)
def test_impossible_fields_are_refused(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(ContactError, match=message):
        GraspPoses(poses=random_poses(3), **fields)


def toward_center(count: int, unit: float) -> np.ndarray:
    """Poses on a sphere of 5 cm about the origin that approach it; lengths in metres / unit."""
    poses = random_poses(count)
    poses[:, :3, 3] = -0.05 / unit * poses[:, :3, 2]
    return poses


def ball(size: float = 0.1, unit: Any = "m") -> grasp3d.ObjectMesh:
    return grasp3d.load_mesh(shapes.sphere(1, 0.5 * size), unit=unit, max_edge=1e9)


@pytest.mark.parametrize(
    ("unit", "size", "mesh_unit", "stated", "words"),
    [
        (0.001, 0.1, "m", None, "if their lengths are in mm, not in m, give their unit: a column"),
        (1.0, 0.1, "mm", "m", "if the mesh is in m, not in mm, give --unit m"),
        (1e-6, 0.1, "m", "m", "in another frame? Give the pose of the object in it"),
    ],
)
def test_poses_that_are_all_far_are_refused_with_the_likely_unit(
    unit: float, size: float, mesh_unit: Any, stated: Any, words: str
) -> None:
    poses = toward_center(10, unit)
    with pytest.raises(ContactError, match=r"^all poses \(10\) are far from the object, ") as error:
        check_near(poses, ball(size, mesh_unit), stated=stated)
    assert words in str(error.value)
    check_near(poses, ball(size, mesh_unit), reach=1e9)
    poses[0, :3, 3] = 0.0
    check_near(poses, ball(size, mesh_unit))
    counted = pose_warning(poses, ball(size, mesh_unit))
    assert "9 of 10 poses are over 20 object sizes away" in str(counted)
    found = pose_warning(toward_center(10, 1000.0), ball(100.0, "mm"))  # numbers of metres
    words = "if their lengths are in m, not in mm, give their unit: a column unit"
    assert words in str(found)
    for near in (toward_center(10, 1.0), np.zeros((0, 4, 4))):
        check_near(near, ball())
        assert pose_warning(near, ball()) is None
