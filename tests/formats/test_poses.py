import pickle
from dataclasses import replace
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
        },
    )


def test_one_number_is_for_all_poses_and_what_is_not_given_is_not_known() -> None:
    poses = GraspPoses(poses=random_poses(3), opening=0.05)
    assert poses.opening.tolist() == [0.05] * 3
    for name in ("pregrasp_opening", "scores", "outcome"):
        assert np.isnan(getattr(poses, name)).all()
    assert poses.names == ("grasp_1", "grasp_2", "grasp_3")
    assert len(poses) == 3
    assert poses.hand is None


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
    assert (there.columns["epsilon"] == poses.columns["epsilon"]).all()
    back = there.in_unit(one)
    assert back.poses == pytest.approx(poses.poses)


def test_areas_are_in_the_unit_of_the_lengths() -> None:
    touched = replace(example(), columns={"area1": np.full(4, 1e-4), "shift": np.full(4, 1e-3)})
    in_mm = touched.in_unit("mm").columns
    np.testing.assert_allclose([in_mm["area1"][0], in_mm["shift"][0]], [100.0, 1.0])


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
    """Three poses of a hand with two joints, in metres."""
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


def test_postures_before_and_after_the_grasp_stay_with_their_grasps() -> None:
    poses = with_joints()
    some = poses.take([2, 0])
    assert some.joint_names == poses.joint_names
    for name in ("posture", "pregrasp_posture", "squeeze_posture", "pregrasp_poses"):
        assert (getattr(some, name) == getattr(poses, name)[[2, 0]]).all()
    assert some.squeeze_poses is None
    assert poses.take([]).posture.shape == (0, 2)


def test_poses_before_the_grasp_are_scaled_and_moved_with_it_and_postures_are_not() -> None:
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


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"joint_names": ("one",)}, "2 joints need as many names that differ"),
        ({"posture": [[0.0, 0.0], [0.0, np.nan]]}, "grasp 2: value 2 of its posture must be finit"),
        ({"pregrasp_poses": np.eye(4)}, "2 poses need as many pregrasp_poses"),
    ],
)
def test_impossible_postures_are_refused(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(ContactError, match=message):
        GraspPoses(**{"poses": random_poses(2), "posture": np.zeros((2, 2)), **fields})


def test_poses_can_be_sent_to_another_process_and_printed() -> None:
    poses = pickle.loads(pickle.dumps(example()))  # noqa: S301, our own bytes
    assert poses.names == example().names
    assert "GraspPoses(poses=float64[4, 4, 4]" in repr(poses)


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
        (
            changed(np.s_[1:, :3, 0], -1.0),
            r"pose 2 is left-handed \(determinant -1\), as are 2 of 3",
        ),
        (
            changed(np.s_[2, :3, :3], 1000.0),
            r"pose 3: its axes have the lengths \(1000, 1000, 1000\).*scale",
        ),
    ],
)
def test_what_is_no_pose_is_refused_with_the_probable_cause(poses: Any, message: str) -> None:
    with pytest.raises(ContactError, match=message):
        GraspPoses(poses=poses)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"opening": [0.1, 0.2]}, r"opening must be numbers of shape \(3,\)"),
        ({"opening": -0.1}, "grasp 1: opening must be a length of at least 0"),
        ({"outcome": [1.0, 0.0, 0.5]}, "grasp 3: outcome must be 1"),
        ({"names": ("a", "b")}, "3 poses need 3 names; got 2"),
        ({"names": ("a", "b", "\ud800")}, "grasp 3: a name must be text that can be printed"),
        ({"unit": "km"}, "unit of poses must be one of m, cm, mm, in; got 'km'"),
        ({"columns": {"opening": np.zeros(3)}}, "no column of poses can be called 'opening'"),
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
    """A ball of a diameter in the unit of its file, about the origin."""
    return grasp3d.load_mesh(shapes.sphere(1, 0.5 * size), unit=unit, max_edge=1e9)


def test_lengths_in_another_unit_are_noticed() -> None:
    assert pose_warning(toward_center(10, 1.0), ball()) is None
    read_in_millimetres = toward_center(10, 1000.0)  # numbers of metres
    found = pose_warning(read_in_millimetres, ball(100.0, "mm"))
    words = "if their lengths are in m, not in mm, give their unit: a column unit"
    assert words in str(found)


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


def test_no_poses_are_not_far() -> None:
    check_near(np.zeros((0, 4, 4)), ball())
    assert pose_warning(np.zeros((0, 4, 4)), ball()) is None


def test_columns_of_unequal_lengths_are_refused_by_name() -> None:
    with pytest.raises(ContactError, match="tags must have as many values in all grasps"):
        GraspPoses(poses=np.tile(np.eye(4), (2, 1, 1)), columns={"tags": [[1, 2], [1]]})
