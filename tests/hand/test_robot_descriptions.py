"""Grippers from URDF and MuJoCo models of known sizes, and files that no hand should need."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from grasp3d.arrays import Floats
from grasp3d.errors import FileUnreadError, SettingError
from grasp3d.hand.choices import AXES
from grasp3d.hand.hand_files import read_hand
from grasp3d.hand.link_tree import Joint, LinkShape, LinkTree
from grasp3d.hand.measured_gripper import measured_gripper
from grasp3d.hand.mujoco_model import read_links
from grasp3d.hand.parallel_gripper import ParallelGripper
from grasp3d.system import limited_reading

FINGERS = ("left", "right")

URDF = """<robot name="hand">
 <link name="arm"><collision><geometry><box size="1 1 1"/></geometry></collision></link>
 <link name="hand"><collision><origin xyz="0 0 0.03"/>
  <geometry><box size="0.06 0.12 0.06"/></geometry></collision></link>
 <link name="camera"><collision><origin xyz="0.02 0 0"/>
  <geometry><box size="0.04 0.02 0.02"/></geometry></collision></link>
 <link name="left"><collision><origin xyz="0 0.005 0.02"/>
  <geometry><box size="0.02 0.01 0.04"/></geometry></collision></link>
 <link name="right"><collision><origin xyz="0 0.005 0.02"/>
  <geometry>{right}</geometry></collision></link>
 <joint name="wrist" type="fixed"><parent link="arm"/><child link="hand"/>
  <origin xyz="0 0 0.5"/></joint>
 <joint name="mount" type="fixed"><parent link="hand"/><child link="camera"/>
  <origin xyz="0.01 0 0.03"/></joint>
 <joint name="slide_left" type="{kind}"><parent link="hand"/><child link="left"/>
  <origin xyz="0 0.001 0.06"/><axis xyz="0 1 0"/><limit lower="0" upper="0.03"/></joint>
 <joint name="slide_right" type="prismatic"><parent link="hand"/><child link="right"/>
  <origin xyz="0 -0.001 0.06" rpy="0 0 3.14159265358979"/><axis xyz="{axis}"/>
  {limit}</joint>
</robot>"""
BOX = '<box size="0.02 0.01 0.04"/>'
LIMIT = '<limit lower="0" upper="0.03"/>'
"""A palm of 60 x 120 x 60 mm with a camera on it, fingers of 20 x 10 x 40 mm at its front, 2 to
62 mm apart; the right one is turned by half a turn."""

MJCF = """<mujoco>
 <compiler angle="radian"/>
 <worldbody>
  <body name="hand" pos="1 2 3" euler="0.3 0.2 0.1">
   <geom type="box" size="0.03 0.06 0.03" pos="0 0 0.03"/>
   <geom name="ball" type="sphere" size="0.5" contype="0" conaffinity="0"/>
   <body name="camera" pos="0.01 0 0.03"><geom type="box" size="0.02 0.01 0.01" pos="0.02 0 0"/>
   </body>
   <body name="left" pos="0 0.001 0.06">
    <joint name="slide_left" type="slide" axis="0 1 0" limited="true" range="0 0.03"/>
    <geom type="box" size="0.01 0.005 0.02" pos="0 0.005 0.02"/>
   </body>
   <body name="right" pos="0 {y} 0.06" quat="0 0 0 1">
    <joint name="slide_right" type="slide" axis="0 1 0" limited="true" range="0 0.03" ref="{ref}"/>
    <geom type="box" size="0.01 0.005 0.02" pos="0 0.005 0.02"/>
   </body>
  </body>
 </worldbody>
 {more}
</mujoco>"""


def urdf(folder: Path, **changed: str) -> Path:
    values = {"kind": "prismatic", "axis": "0 1 0", "right": BOX, "limit": LIMIT} | changed
    path = folder / "hand.urdf"
    path.write_text(URDF.format(**values), encoding="utf-8")
    return path


def mjcf(folder: Path, y: float = -0.001, ref: float = 0.0, more: str = "") -> Path:
    path = folder / "hand.xml"
    path.write_text(MJCF.format(y=y, ref=ref, more=more), encoding="utf-8")
    return path


def with_palm(path: Path, old: str, new: str) -> Path:
    text = path.read_text(encoding="utf-8")
    assert text.count(old) == 1
    path.write_text(text.replace(old, new), encoding="utf-8")
    return path


def check_hand(gripper: ParallelGripper) -> None:
    """Check the sizes of the hand that URDF and MJCF describe."""
    lengths = {
        "min_opening": 2, "max_opening": 62, "finger_thickness": 10, "finger_width": 20,
        "finger_length": 40, "pad_width": 20, "pad_height": 40, "palm_thickness": 120,
        "palm_width": 100, "palm_length": 60, "base_to_tcp": 80,
    }  # fmt: skip
    for name, length in lengths.items():
        assert 1e3 * getattr(gripper, name) == pytest.approx(length, abs=1e-5), name
    assert (gripper.base_axes, gripper.inner_faces) == (("-y", "z"), ())
    assert gripper.joint_names == ("slide_left", "slide_right")
    assert gripper.joint_scale == pytest.approx((0.5, 0.5))
    assert gripper.joint_closed == pytest.approx((-0.001, -0.001))


@pytest.mark.parametrize("limit", [LIMIT, '<mimic joint="slide_left"/>'])
def test_a_urdf_gives_boxes_stroke_and_frame(tmp_path: Path, limit: str) -> None:
    """A finger that follows the other has its limits; undeclared prefixes are passed over."""
    path = urdf(tmp_path, limit=limit)
    more = '<xacro:property name="a" value="1"/></robot>'
    path.write_text(path.read_text(encoding="utf-8").replace("</robot>", more), encoding="utf-8")
    check_hand(read_hand(path, fingers=FINGERS))


@pytest.mark.parametrize(("y", "ref"), [(-0.001, 0.0), (-0.011, 0.01)])
def test_a_mujoco_model_gives_the_same(tmp_path: Path, y: float, ref: float) -> None:
    """Also where the file shows the finger at a reference value of its joint."""
    check_hand(read_hand(mjcf(tmp_path, y, ref), fingers=FINGERS))


def test_fingers_palm_and_tcp_can_be_named(tmp_path: Path) -> None:
    other = read_hand(urdf(tmp_path), fingers=("right", "left"))
    assert other.base_axes == ("y", "z")
    assert other.joint_names == ("slide_right", "slide_left")
    gripper = read_hand(urdf(tmp_path), fingers=FINGERS, palm="hand", tcp=0.09)
    assert gripper.base_to_tcp == 0.09
    assert gripper.pad_height == pytest.approx(0.02)
    assert gripper.palm_width == pytest.approx(0.1)
    camera = read_hand(urdf(tmp_path), fingers=FINGERS, palm="camera")
    assert camera.palm_length == pytest.approx(0.02)
    assert camera.finger_length == pytest.approx(0.06)
    assert camera.palm_thickness == camera.max_opening  # at least the stroke
    with pytest.raises(SettingError, match=r"'rihgt' \(did you mean right\?\); known: arm"):
        read_hand(urdf(tmp_path), fingers=("left", "rihgt"))


def test_a_link_of_that_name_is_the_tcp(tmp_path: Path) -> None:
    path = urdf(tmp_path)
    more = (
        '<link name="hand_tcp"/><joint name="mark" type="fixed"><parent link="hand"/>'
        '<child link="hand_tcp"/><origin xyz="0 0 {}"/></joint></robot>'
    )
    text = path.read_text(encoding="utf-8")
    for height, found, words in (
        ("0.09", 0.09, "the TCP is the link hand_tcp"),
        ("0.2", 0.08, "the TCP is in the middle of their flat parts"),  # beyond the fingers
    ):
        path.write_text(text.replace("</robot>", more.format(height)), encoding="utf-8")
        gripper = read_hand(path)
        assert gripper.base_to_tcp == pytest.approx(found)
        assert words in gripper.source
    assert read_hand(path, tcp=0.085).base_to_tcp == 0.085


def test_meshes_are_read_from_packages_and_beside_the_file(tmp_path: Path) -> None:
    folder = tmp_path / "my_hand" / "urdf"
    (tmp_path / "my_hand" / "meshes").mkdir(parents=True)
    folder.mkdir()
    trimesh.creation.box([20.0, 10.0, 40.0]).export(tmp_path / "my_hand/meshes/f.stl")
    for name in (
        "package://my_hand/meshes/f.stl",
        "package://my_hand//meshes/f.stl",
        "../meshes/f.stl",
    ):
        mesh = f'<mesh filename="{name}" scale="0.001 0.001 0.001"/>'
        check_hand(read_hand(urdf(folder, right=mesh), fingers=FINGERS))


CAMERA = {urdf: '<box size="0.04 0.02 0.02"/>', mjcf: 'type="box" size="0.02 0.01 0.01"'}
"""The shape of the camera in each kind of file."""


@pytest.mark.parametrize(
    ("file", "shape", "sizes"),
    [
        (urdf, '<sphere radius="0.01"/>', (20, 20, 20)),
        (urdf, '<cylinder radius="0.01" length="0.04"/>', (20, 20, 40)),
        (mjcf, 'type="sphere" size="0.01"', (20, 20, 20)),
        (mjcf, 'type="ellipsoid" size="0.01 0.02 0.005"', (20, 40, 10)),
        (mjcf, 'type="cylinder" size="0.01 0.02"', (20, 20, 40)),
        (mjcf, 'type="cylinder" size="0.01 0.02" quat="1 1 0 0"', (20, 40, 20)),
        (mjcf, 'type="capsule" size="0.01 0.02"', (20, 20, 60)),
    ],
)
def test_all_shapes_have_their_size(
    tmp_path: Path, file: Any, shape: str, sizes: tuple[float, float, float]
) -> None:
    path = with_palm(file(tmp_path), CAMERA[file], shape)
    points = read_links(path).geometry("camera").reshape(-1, 3)
    assert 1e3 * np.ptp(points, axis=0) == pytest.approx(sizes, rel=0.01)


def test_geometry_that_collides_in_pairs_is_read(tmp_path: Path) -> None:
    palm = read_links(mjcf(tmp_path)).shapes("hand")
    pair = '<contact><pair geom1="ball" geom2="ball"/></contact>'
    ball, *same = read_links(mjcf(tmp_path, more=pair)).shapes("hand")[::-1]
    assert (ball.kind, ball.size, len(same)) == ("sphere", (0.5,), len(palm))


def test_what_is_no_model_and_endless_shapes_are_refused(tmp_path: Path) -> None:
    path = with_palm(mjcf(tmp_path), CAMERA[mjcf], 'type="plane" size="1 1 1"')
    with pytest.raises(SettingError, match="of camera has no finite shape"):
        read_hand(path, fingers=FINGERS)
    for text in ("<robot>", "", '<!DOCTYPE a [<!ENTITY b SYSTEM "a.txt">]><mujoco>&b;</mujoco>'):
        path.write_text(text, encoding="utf-8")
        with pytest.raises(SettingError, match=r"no|cannot") as refused:
            read_hand(path, fingers=FINGERS)
        assert "\n" not in str(refused.value)


Shapes = dict[str, Floats]


def shapes_along(closing: str, approach: str, gap: float) -> Shapes:
    """Fingers of 20 x 8 x 50 mm in front of a palm, in any directions: triangles by links."""
    x, z = np.array(AXES[closing]), np.array(AXES[approach])
    frame = np.stack([x, np.cross(z, x), z])
    boxes = {"palm": [[-0.08, -0.02, 0.0], [0.08, 0.02, 0.1]]}
    for name, side in zip(FINGERS, (-1.0, 1.0), strict=True):
        ends = sorted((side * 0.5 * gap, side * (0.5 * gap + 0.02)))
        boxes[name] = [[ends[0], -0.004, 0.1], [ends[1], 0.004, 0.15]]
    return {name: trimesh.creation.box(bounds=box).triangles @ frame for name, box in boxes.items()}


def measured(shapes: Shapes, closing: str = "x") -> ParallelGripper:
    """The gripper whose fingers slide by 20 mm each."""
    joints = {
        name: Joint(name, "slides", "palm", np.eye(4), side * np.array(AXES[closing]), (0.0, 0.02))
        for name, side in zip(FINGERS, (-1.0, 1.0), strict=True)
    }
    tree = LinkTree(
        "hand",
        ("palm", *FINGERS),
        joints,
        lambda link: (LinkShape("mesh", np.eye(4), surface=shapes[link]),),
    )
    return measured_gripper(tree, FINGERS)


@pytest.mark.slow
@given(
    st.sampled_from([(a, b) for a in AXES for b in AXES if a[-1] != b[-1]]),
    st.floats(0.0, 0.05),
    st.floats(0.0, 1.0),
)
def test_joints_give_the_opening_in_any_frame(
    axes: tuple[str, str], gap: float, fraction: float
) -> None:
    shapes = shapes_along(*axes, gap)
    gripper = measured(shapes, axes[0])
    assert gripper.base_axes == axes
    opening = gripper.min_opening + fraction * (gripper.max_opening - gripper.min_opening)
    x = np.array(AXES[axes[0]])
    sides = []
    for number, (name, side) in enumerate(zip(FINGERS, (-1.0, 1.0), strict=True)):
        value = gripper.joint_closed[number] + gripper.joint_scale[number] * opening
        assert -1e-8 <= value <= 0.02 + 1e-8
        sides.append((shapes[name] + value * side * x) @ x)
    assert sides[1].min() - sides[0].max() == pytest.approx(opening, abs=1e-7)
    in_frame = shapes["palm"] @ gripper.base_pose[:3, :3].T + gripper.base_pose[:3, 3]
    assert in_frame[..., 2].max() == pytest.approx(gripper.end - gripper.finger_length)


def test_parts_of_the_fingers_beside_the_palm_belong_to_it() -> None:
    shapes = shapes_along("x", "z", 0.01)
    shapes["palm"] = shapes["palm"] * [0.1, 0.1, 1.1]  # its front is within the fingers
    gripper = measured(shapes)
    assert gripper.palm_thickness == pytest.approx(0.01 + 2 * 0.02 + 2 * 0.02)
    assert gripper.palm_width == pytest.approx(0.008)
    assert gripper.finger_length == pytest.approx(0.04)


def test_fingers_that_overlap_slightly_touch_when_they_are_closed() -> None:
    gripper = measured(shapes_along("x", "z", -0.001))
    assert (gripper.min_opening, gripper.max_opening) == (0.0, pytest.approx(0.04))
    with pytest.raises(SettingError, match="are -3 mm apart"):
        measured(shapes_along("x", "z", -0.003))
    pointed = shapes_along("x", "z", 0.01)
    pointed["right"] = np.array([[[0.005, 0.0, 0.1], [0.02, -0.01, 0.15], [0.02, 0.01, 0.15]]])
    with pytest.raises(SettingError, match="no flat inner sides"):
        measured(pointed)


ENDS = '<limit lower="0" upper="0.03"/></joint>\n <joint'
AXIS = '<axis xyz="0 1 0"/>'
LEFT = f'<collision><origin xyz="0 0.005 0.02"/>\n  <geometry>{BOX}</geometry></collision>'
FAULTS: dict[str, tuple[str | None, str, str]] = {
    "a link twice": ('<link name="arm">', '<link name="left"/><link name="arm">', "two links are"),
    "no limits": (ENDS, "</joint>\n <joint", "joint slide_left has no limits; state"),
    "limits in the wrong order": (ENDS, ENDS.replace("0.03", "-3"), "has limits from 0 to -3"),
    "a size of 0": (CAMERA[urdf], '<sphere radius="0"/>', "size 0 must be positive in geom Eleme"),
    "a scale of 0": (CAMERA[urdf], '<mesh filename="f" scale="0 1 1"/>', "scale of mesh must not"),
    "nothing to follow": (AXIS, AXIS + '<mimic joint="lift"/>', "slide_left follows lift, which"),
    "what does not move": (AXIS, AXIS + '<mimic joint="mount"/>', "slide_left follows mount, whi"),
    "far": ("0 0 0.5", "0 0 1e308", "hand or its geometry is more than 1,000 m large or away"),
    "a finger that turns": ("prismatic", "revolute", "joint slide_left turns left; only fingers"),
    "a wrong way": ('xyz="0 1 0"/>\n', 'xyz="0 -1 0"/>\n', "are -28 mm apart when they are clo"),
    "the same way": (
        f'"/>\n  {LIMIT}', f'"/>{LIMIT}<mimic joint="slide_left" multiplier="-1"/>',
        "slide_left and slide_right move them in the same direction",
    ),
    "no mesh": (BOX, '<mesh filename="f.stl"/>', "there is no mesh f.stl of link left"),
    "no geometry": (LEFT, "", "left has no collision geometry"),
    "no XML": ("</robot>", "", "is not valid XML"),
    "nothing": (None, "", "is not valid XML"),
    "another root": (None, "<other/>", "no"),
    "foreign entities": (None, '<!DOCTYPE a [<!ENTITY b SYSTEM "a.txt">]><robot>&b;</robot>', "no"),
}  # fmt: skip
"""What is replaced, by what, and what is said."""


@pytest.mark.parametrize("fault", FAULTS)
def test_faults_of_a_urdf_are_said_in_one_sentence(tmp_path: Path, fault: str) -> None:
    path, (old, new, words) = urdf(tmp_path), FAULTS[fault]
    text = path.read_text(encoding="utf-8")
    assert old is None or old in text
    path.write_text(new if old is None else text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(SettingError) as refused:
        read_hand(path, fingers=FINGERS)
    assert str(refused.value).startswith(str(path))
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


def test_meshes_of_collada_have_their_unit(tmp_path: Path) -> None:
    mesh = trimesh.creation.box([20.0, 10.0, 40.0])
    data = trimesh.exchange.dae.export_collada(mesh)
    unit = b'<unit name="millimeter" meter="0.001"/>'
    data = data.replace(b"<up_axis>", unit + b"<up_axis>")
    (tmp_path / "f.dae").write_bytes(data)
    check_hand(read_hand(urdf(tmp_path, right='<mesh filename="f.dae"/>'), fingers=FINGERS))
    (tmp_path / "f.dae").write_bytes(b"<COLLADA/>")
    with pytest.raises(SettingError, match=r"mesh of link right: .*cannot be read as COLLADA"):
        read_hand(urdf(tmp_path, right='<mesh filename="f.dae"/>'), fingers=FINGERS)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="limits of memory are Linux's")
@pytest.mark.parametrize(
    "content",
    [
        '<size nkey="2000000000"/>',
        '<worldbody><replicate count="1e8"><geom size=".01"/></replicate></worldbody>',
        '<include file="./hand.xml"/>',
    ],
)
def test_models_that_ask_for_too_much_end_a_process_of_their_own(
    tmp_path: Path, content: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = mjcf(tmp_path, more=content)
    monkeypatch.setattr(limited_reading, "SECONDS", 5.0)
    monkeypatch.setattr(limited_reading, "MEMORY", 5e8)
    with (
        limited_reading.limited_reading(),
        pytest.raises((SettingError, FileUnreadError)) as refused,
    ):
        read_hand(path, fingers=FINGERS)
    assert str(refused.value).startswith(f"{path}: ")
    assert str(refused.value).isprintable()


def test_no_log_of_mujoco_is_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = mjcf(tmp_path, more='<worldbody><body pos="nan 0 0"/></worldbody>')
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SettingError, match="MuJoCo cannot read it"):
        read_links(path)
    assert [one.name for one in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize(
    "loop",
    [
        [("fixed", "left", "left")],
        [("fixed", "left", "right"), ("fixed", "right", "left")],
        [("fixed", "camera", "camera"), ("continuous", "hand", "left")],
    ],
)
def test_loops_of_joints_are_refused(tmp_path: Path, loop: list[tuple[str, str, str]]) -> None:
    path = urdf(tmp_path)
    joints = "".join(
        f'<joint name="j{n}" type="{kind}"><parent link="{parent}"/><child link="{child}"/></joint>'
        for n, (kind, parent, child) in enumerate(loop)
    )
    text = path.read_text(encoding="utf-8")
    path.write_text(text[: text.index("<joint")] + joints + "</robot>", encoding="utf-8")
    with pytest.raises(SettingError, match=r"MuJoCo cannot read it .*URDF body not found"):
        read_links(path)
