"""What every registered format has, and that a further one needs nothing but its own module."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from field_tables import format_table, pages
from scipy.spatial.transform import Rotation

import grasp3d
from grasp3d.cli import main
from grasp3d.errors import ContactError, SettingError
from grasp3d.formats import Format, GraspPoses, files, holds_poses, read_poses, write_grasps
from grasp3d.formats import format as registry
from grasp3d.formats.format import formats
from tests.hand.test_articulated_hand import hand_of
from tests.helpers import gpd_format

FRANKA = grasp3d.read_hand("franka")
NAMES = [*formats(), gpd_format.FORMAT.name]


@pytest.fixture(autouse=True)
def added() -> Iterator[None]:
    gpd_format.add()
    yield
    del registry._REGISTERED[gpd_format.FORMAT.name]  # noqa: SLF001, nobody else forgets one


def poses_for(form: Format, count: int = 4) -> GraspPoses:
    of_joints: dict[str, Any] = {"hand": FRANKA, "opening": np.full(count, 0.05)}
    if form.hands == ("articulated",):
        hand: Any = hand_of("allegro")
        posture = np.tile(np.linspace(0.1, 0.4, len(hand.joint_names)), (count, 1))
        of_joints = {"hand": hand, "posture": posture, "joint_names": hand.joint_names}
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = Rotation.random(count, random_state=1).as_matrix()
    poses[:, :3, 3] = np.arange(3.0 * count).reshape(count, 3) / 50.0
    known = {"scores": np.linspace(0.0, 1.0, count), "outcome": np.arange(count) % 2.0}
    return GraspPoses(poses=poses, unit="m", **known, **of_joints)


@pytest.mark.parametrize("name", NAMES)
def test_poses_return_from_every_format(tmp_path: Path, name: str) -> None:
    form = formats()[name]
    poses, path = poses_for(form), tmp_path / f"a{form.suffixes[0]}"
    write_grasps(path, poses, format=name)
    assert holds_poses(path)
    same, content = files._fitting(path)  # noqa: SLF001, in one format only
    assert [one.name for one in same if one.sniff(content)] == [name]
    back = read_poses(path, hand=poses.hand if form.hands else None, unit=None)
    np.testing.assert_allclose(back.poses, poses.poses, atol=1e-12)
    assert str(back.gripper_frame) == form.frame
    if form.hands == ("articulated",):
        np.testing.assert_allclose(back.posture, poses.posture, atol=1e-12)


def test_one_format_of_each_suffix_is_the_main_one() -> None:
    for suffix in registry.suffixes():
        fitting = [one for one in formats().values() if suffix in one.suffixes]
        assert len([one for one in fitting if one.main]) == (len(fitting) > 1) or len(fitting) == 1


def test_a_new_format_is_known_everywhere(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert len(Path(gpd_format.__file__).read_text().splitlines()) <= 60
    poses, path = poses_for(gpd_format.FORMAT), tmp_path / "a.gpd"
    grasp3d.write_grasps(path, poses)
    back = grasp3d.read_grasps(path, hand=FRANKA)
    assert isinstance(back, GraspPoses)
    np.testing.assert_allclose(back.poses, poses.poses, atol=1e-12)
    assert (back.unit, str(back.gripper_frame)) == ("m", "gpd")
    with pytest.raises(ContactError, match=r"Text of GPD files have the pose of the hand's base"):
        read_poses(path)
    with pytest.raises(SettingError, match=r"called 'xml'; known: acronym, .*gpd_text.*, parquet"):
        grasp3d.write_grasps(path, poses, format="xml")
    path.write_text("other")
    with pytest.raises(ContactError, match=r"expected lines of 7 numbers .* \(Text of GPD\)"):
        read_poses(path, hand=FRANKA)
    assert "| `.gpd` | `gpd_text` | `gpd` | metres |" in format_table()
    page = pages()["gpd_text.md"]
    assert page.startswith("# Text of GPD\n")
    assert "| of a grasp | x y z [m]" in page
    monkeypatch.setenv("COLUMNS", "200")
    for command in ("label", "evaluate"):
        with suppress(SystemExit):
            main([command, "--help-all"])
        assert "gpd_text" in capsys.readouterr().out, command


def test_matrices_are_read_in_the_frame_that_is_given(tmp_path: Path) -> None:
    many = poses_for(formats()["matrices"])
    poses = many.poses
    np.save(tmp_path / "many.npy", many.in_unit("mm").poses)
    found = read_poses(tmp_path / "many.npy", unit="mm")
    assert (str(found.gripper_frame), found.assumes_frame, found.unit) == ("tcp", True, "mm")
    np.testing.assert_allclose(found.in_unit("m").poses, poses, atol=1e-12)
    np.save(tmp_path / "one.npy", poses[0])
    assert read_poses(tmp_path / "one.npy").unit is None
    found = read_poses(tmp_path / "one.npy", unit="m", hand=FRANKA, frame="graspgen")
    np.testing.assert_allclose(
        found.poses[0, :3, 3], poses[0, :3, 3] + 0.1034 * poses[0, :3, 2], atol=1e-12
    )
    assert not found.assumes_frame


@pytest.mark.parametrize("suffix", [".json", ".csv", ".parquet"])
def test_further_columns_keep_whole_numbers_and_truth_values(tmp_path: Path, suffix: str) -> None:
    columns: dict[str, Any] = {"rank": np.arange(4), "collides": np.arange(4) % 2 == 0}
    grasp3d.write_grasps(
        tmp_path / f"a{suffix}", replace(poses_for(formats()["json"]), columns=columns)
    )
    found = read_poses(tmp_path / f"a{suffix}").columns
    assert {name: found[name].tolist() for name in columns} == {
        name: one.tolist() for name, one in columns.items()
    }
    assert [found[name].dtype.kind for name in columns] == ["i", "b"]


@pytest.mark.parametrize("names", ["x,y,z", "px,py,pz", " x, y, z", "px, py, pz"])
def test_positions_have_two_names(tmp_path: Path, names: str) -> None:
    (tmp_path / "a.csv").write_text(f"{names}, qx, qy, qz, qw, note\n1, 2, 3, 0, 0, 0, 1, a b\n")
    found = read_poses(tmp_path / "a.csv", unit="cm")
    assert found.poses[0, :3, 3].tolist() == [1.0, 2.0, 3.0]
    assert {name: one.tolist() for name, one in found.columns.items()} == {"note": ["a b"]}
    assert found.assumes_frame
    (tmp_path / "b.csv").write_text("x,y,qx,qy,qz,qw\n1,2,0,0,0,1\n")
    with pytest.raises(
        ContactError, match=r"column z is missing; poses have px py pz \(or x y z\) qx"
    ):
        read_poses(tmp_path / "b.csv")
