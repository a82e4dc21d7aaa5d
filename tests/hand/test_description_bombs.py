"""Descriptions of robots that ask for more than any hand needs, or for ever."""

import sys
from pathlib import Path

import pytest

from grasp3d.errors import FileUnreadError, SettingError
from grasp3d.hand.hand_files import read_hand
from grasp3d.hand.mujoco_model import read_links
from grasp3d.system import limited_reading
from tests.hand.test_robot_descriptions import FINGERS, URDF, mjcf

GEOM = '<geom type="sphere" size="0.01"/>'


def model(folder: Path, content: str) -> Path:
    """A model of the hand with further elements."""
    return mjcf(folder, more=content)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="limits of memory are Linux's")
@pytest.mark.parametrize(
    "content",
    [
        '<size nkey="2000000000"/>',
        f'<worldbody><replicate count="1e8">{GEOM}</replicate></worldbody>',
        '<include file="./hand.xml"/>',
    ],
)
def test_models_that_ask_for_too_much_end_a_process_of_their_own(
    tmp_path: Path, content: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = model(tmp_path, content)
    monkeypatch.setattr(limited_reading, "SECONDS", 5.0)
    monkeypatch.setattr(limited_reading, "MEMORY", 5e8)
    with (
        limited_reading.limited_reading(),
        pytest.raises((SettingError, FileUnreadError)) as refused,
    ):
        read_hand(path, fingers=FINGERS)
    assert str(refused.value).startswith(f"{path}: ")
    assert str(refused.value).isprintable()


def test_a_hand_is_the_same_when_a_child_process_reads_it(tmp_path: Path) -> None:
    path = mjcf(tmp_path)
    with limited_reading.limited_reading():
        found = read_hand(path, fingers=FINGERS)
    assert found == read_hand(path, fingers=FINGERS)


def test_no_log_of_mujoco_is_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = model(tmp_path, '<worldbody><body pos="nan 0 0"/></worldbody>')
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SettingError, match="MuJoCo cannot read it"):
        read_links(path)
    assert [one.name for one in tmp_path.iterdir()] == [path.name]


LOOPS = {
    "itself": [("fixed", "left", "left")],
    "two": [("fixed", "left", "right"), ("fixed", "right", "left")],
    "apart": [("fixed", "camera", "camera"), ("continuous", "hand", "left")],
}
"""Joints as kind, parent and child."""


@pytest.mark.parametrize("loop", LOOPS)
def test_loops_of_joints_are_refused(tmp_path: Path, loop: str) -> None:
    text = URDF.format(kind="prismatic", axis="0 1 0", right="<box size='1 1 1'/>", limit="")
    joints = "".join(
        f'<joint name="j{n}" type="{kind}"><parent link="{parent}"/><child link="{child}"/></joint>'
        for n, (kind, parent, child) in enumerate(LOOPS[loop])
    )
    path = tmp_path / "hand.urdf"
    path.write_text(text[: text.index("<joint")] + joints + "</robot>")
    with pytest.raises(SettingError, match=r"MuJoCo cannot read it .*URDF body not found"):
        read_links(path)
