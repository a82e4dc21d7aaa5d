"""Descriptions of robots that ask for more than any hand needs, or for ever."""

import os
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import trimesh

from grasp3d.errors import SettingError
from grasp3d.hand import robot_files
from grasp3d.hand.description_xml import MOST_ELEMENTS, MOST_FILES, size_of_files
from grasp3d.hand.hand_files import read_hand
from grasp3d.hand.link_tree import Joint, LinkTree
from tests.hand.test_robot_descriptions import FINGERS, URDF, mjcf, urdf

GEOM = '<geom type="sphere" size="0.01"/>'


def model(folder: Path, content: str) -> Path:
    """A model of the hand with further elements."""
    return mjcf(folder, more=content)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ('<asset><hfield name="f" nrow="30000" ncol="30000"/></asset>', "nrow x ncol"),
        ('<asset><texture name="f" width="6e4" height="60000"/></asset>', "texture"),
        ('<size nkey="2000000000"/>', "asks for a size of 2,000,000,000 in size (nkey)"),
        ('<size nuser_body="2000000000"/>', "nuser_body"),
        ('<custom><numeric name="n" size="2000000000"/></custom>', "in numeric (size)"),
        (f'<worldbody><replicate count="1e8">{GEOM}</replicate></worldbody>', "with their copies"),
        (
            3 * '<replicate count="100">' + GEOM + 3 * "</replicate>",
            "with their copies",
        ),
        (
            '<worldbody><body><composite type="particle" count="100 100 100"/></body></worldbody>',
            "with their copies",
        ),
        ((MOST_ELEMENTS + 1) * "<a/>", "has more than 100,000 elements"),
        ("<a>" * 300 + "</a>" * 300, "or 200 within each other"),
        ('<asset><model name="me" file="hand.xml"/></asset>', "includes itself, by way of hand"),
        ('<include file="./hand.xml"/>', "includes itself"),
    ],
)  # fmt: skip
def test_models_that_ask_for_too_much_are_refused_at_once(
    tmp_path: Path, content: str, words: str
) -> None:
    path = model(tmp_path, content)
    with pytest.raises(SettingError) as refused:
        size_of_files(path)
    assert str(refused.value).startswith(f"{path}: ")
    assert words in str(refused.value)


def test_included_models_are_looked_at(tmp_path: Path) -> None:
    """Also where they include the first one again, and where each includes two others."""
    inner = tmp_path / "inner.xml"
    path = model(tmp_path, '<include file="inner.xml"/>')
    inner.write_text('<mujoco><size nkey="20000"/></mujoco>')
    with pytest.raises(SettingError, match="nkey"):
        size_of_files(path)
    inner.write_text('<mujoco><include file="hand.xml"/></mujoco>')
    with pytest.raises(SettingError, match=r"includes itself, by way of inner[.]xml"):
        size_of_files(path)
    inner.write_text("<mujoco/>")
    assert size_of_files(path) == 2 * inner.stat().st_size  # by the look, and by its name
    for number in range(MOST_FILES):
        twice = 2 * f'<include file="{number + 1}.xml"/>'
        (tmp_path / f"{number}.xml").write_text(f"<mujoco>{twice if number < 20 else ''}</mujoco>")
    with pytest.raises(SettingError, match="includes models more than 100 times"):
        size_of_files(model(tmp_path, '<include file="0.xml"/>'))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no pipes")
@pytest.mark.parametrize(
    "content",
    [
        '<asset><mesh name="m" file="pipe"/></asset>',
        '<include file="pipe"/>',
        '<compiler meshdir="meshes"/><asset><mesh name="m" file="pipe"/></asset>',
        '<asset><texture name="m" type="cube" fileright="pipe"/></asset>',
    ],
)
def test_models_that_name_pipes_are_refused(tmp_path: Path, content: str) -> None:
    (tmp_path / "meshes").mkdir()
    os.mkfifo(tmp_path / ("meshes/pipe" if "meshdir" in content else "pipe"))
    with pytest.raises(SettingError, match="names pipe, which is a pipe or a device"):
        size_of_files(model(tmp_path, content))


@pytest.mark.slow
def test_what_passes_the_look_is_read_with_limits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A crash, too much memory or too much time ends a process, not this one."""
    large = '<texture name="t" type="2d" builtin="flat" width="8000" height="8000"/>'
    path = model(tmp_path, f"<asset>{large}</asset>")
    expected = read_hand(path, fingers=FINGERS)
    monkeypatch.setattr(robot_files, "MEMORY", 0.2)
    with pytest.raises(SettingError, match=r"the process that reads it took more than 0[.]2 GB"):
        read_hand(path, fingers=FINGERS)
    assert read_hand(mjcf(tmp_path), fingers=FINGERS) == expected
    monkeypatch.setattr(robot_files, "SECONDS", 0.0)
    monkeypatch.setattr(robot_files, "MEMORY", 4.0)
    with pytest.raises(SettingError, match=r"took longer than 0 s and was ended"):
        read_hand(path, fingers=FINGERS)


def test_no_log_of_mujoco_is_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = model(tmp_path, '<worldbody><body pos="nan 0 0"/></worldbody>')
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SettingError, match="MuJoCo cannot read it"):
        robot_files.read_links(path)
    assert [one.name for one in tmp_path.iterdir()] == [path.name]


def test_meshes_give_more_time(tmp_path: Path) -> None:
    mesh = tmp_path / "f.stl"
    trimesh.creation.icosphere(4).export(mesh)
    path = model(tmp_path, '<asset><mesh name="m" file="f.stl"/></asset>')
    assert size_of_files(path) == mesh.stat().st_size
    used = size_of_files(urdf(tmp_path, right='<mesh filename="f.stl"/>'))
    assert used > mesh.stat().st_size


LOOPS = {
    "itself": [("fixed", "left", "left")],
    "two": [("fixed", "left", "right"), ("fixed", "right", "left")],
    "apart": [("fixed", "camera", "camera"), ("prismatic", "hand", "left")],
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
    with pytest.raises(SettingError, match=r"joint j\d is part of a loop of joints"):
        robot_files.read_links(path)


def test_long_chains_of_joints_take_no_longer_for_each() -> None:
    names = tuple(map(str, range(20_000)))
    joints = {
        name: Joint(name, "fixed", above, np.eye(4), np.array([1.0, 0.0, 0.0]), None)
        for above, name in pairwise(names)
    }
    tree = LinkTree("chain", names, joints, lambda _: ())
    with pytest.raises(SettingError, match="no joint moves 19999"):
        tree.sliding_hand(("19999", "3"), None)
