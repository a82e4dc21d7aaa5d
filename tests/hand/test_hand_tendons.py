"""Tendons that only pull, springs and brakes of hands with joints, in closed form."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import linprog

import grasp3d
from grasp3d.arrays import Floats
from grasp3d.contact.contacts import Contacts
from grasp3d.errors import SettingError
from grasp3d.hand.articulated.actuation import actuation_of, torques_of
from grasp3d.hand.articulated.articulated_hand import ArticulatedHand
from grasp3d.hand.link_tree import Spring, Tendon
from grasp3d.quality import Actuation, HandGrasp, Weight, hand_payload
from grasp3d.quality.tasks import STANDARD_GRAVITY
from tests.helpers.hands import FINGER

HEAD = {"format": "grasp3d articulated hand", "version": 1, "description": "two.urdf"}
POSTURE = np.array([-0.1, -0.2] * 2)
FLEXOR = {"arms": {"knuckle0": -0.013, "bend0": -0.005}, "tension": 30.0}


def hand_of(folder: Path, **stated: Any) -> ArticulatedHand:
    """Two opposite fingers of two parallel joints each, with what a description states."""
    box = '<box size="0.01 0.01 0.04"/>'
    fingers = [
        FINGER.format(n=n, x=x, y=0.0, yaw=yaw, shape=box, kind="revolute", effort=0.4)
        for n, (x, yaw) in enumerate([(0.03, 0.0), (-0.03, math.pi)])
    ]
    palm = '<link name="palm"><collision><geometry><sphere radius="0.01"/></geometry></collision>'
    text = f'<robot name="two">{palm}</link>{"".join(fingers)}</robot>'
    (folder / "two.urdf").write_text(text, encoding="utf-8")
    path = folder / "two.json"
    path.write_text(json.dumps({**HEAD, **stated}), encoding="utf-8")
    hand = grasp3d.read_hand(path)
    assert isinstance(hand, ArticulatedHand)
    return hand


def drives_of(hand: ArticulatedHand, posture: Floats = POSTURE) -> Actuation:
    """Its drives in a posture."""
    torques = torques_of(hand)
    assert torques is not None
    return actuation_of(hand, posture, torques)


def tip_of(hand: ArticulatedHand, finger: int) -> tuple[Floats, Floats]:
    """Where a fingertip is, and its Jacobian (3, p)."""
    posture = POSTURE[: len(hand.joint_names)]
    poses = hand.link_poses(posture)
    link = hand.link_names.index(f"outer{finger}")
    tip = poses[0, link, :3, 3] + 0.03 * poses[0, link, :3, 2]
    return tip, hand.jacobians(poses, np.array([0]), np.array([link]), tip)[0]


def presses(hand: ArticulatedHand, force: Floats) -> bool:
    """Whether the drives press a force with the first fingertip, and nothing with the other."""
    drives = drives_of(hand, POSTURE[: len(hand.joint_names)])
    torques = tip_of(hand, 0)[1].T @ force
    limits = list(zip(drives.lower, drives.upper, strict=True))
    none = np.zeros(len(drives.lower))
    found = linprog(none, A_eq=drives.columns, b_eq=torques - drives.offset, bounds=limits)
    return found.status == 0


def test_couplings_that_look_alike_are_opposites(tmp_path: Path) -> None:
    """One tendon on two joints presses along the line between the axes, a rigid pair anywhere."""
    pair = {"joints": ["knuckle0", "bend0"], "ratios": [1, 1]}
    differential, rigid = (
        hand_of(tmp_path, couplings=[{"kind": kind, **pair}]) for kind in ("differential", "rigid")
    )
    (poses,) = differential.link_poses(POSTURE)
    inner, outer = (
        poses[differential.link_names.index(name), :3, 3] for name in ("inner0", "outer0")
    )
    along = (outer - inner) / np.linalg.norm(outer - inner)
    across = np.cross(along, [0.0, 1.0, 0.0])
    for force in (along, -along, np.array([0.0, 1.0, 0.0]), along + [0.0, 2.0, 0.0]):
        assert presses(differential, force)
    for force in (across, -across, along + 1e-3 * across):
        assert not presses(differential, force)
    for force in (along, across, -across, np.array([0.0, 1.0, 0.0])):
        assert presses(rigid, force)


def test_a_tendon_presses_along_one_ray_up_to_its_tension(tmp_path: Path) -> None:
    hand = hand_of(tmp_path, tendons=[FLEXOR], brakes={"knuckle1": None, "bend1": 0.1})
    drives = drives_of(hand)
    assert drives.names == (
        "tendon of knuckle0 and bend0", "the brake of knuckle1", "the brake of bend1",
    )  # fmt: skip
    across = tip_of(hand, 0)[1][[0, 2], :2].T
    most = np.linalg.solve(across, [-0.013 * 30.0, -0.005 * 30.0])
    for factor, expected in ((0.5, True), (0.999, True), (1.001, False), (-0.1, False)):
        assert presses(hand, factor * np.array([most[0], 0.0, most[1]])) == expected
    assert not presses(hand, np.array([0.5 * most[0], 0.0, 0.51 * most[1]]))


def test_pretension_and_springs_shift_what_is_pressed(tmp_path: Path) -> None:
    springs = {"knuckle0": {"stiffness": 0.2, "rest": 0.1}, "bend0": {"torque": 0.05}}
    tight = {**FLEXOR, "pretension": 10.0}
    hand = hand_of(
        tmp_path, tendons=[tight], springs=springs, brakes={"knuckle1": None, "bend1": None}
    )
    across = tip_of(hand, 0)[1][[0, 2], :2].T
    pushed = np.array([0.2 * (0.1 - POSTURE[0]), 0.05])
    for tension, expected in ((9.0, False), (10.1, True), (29.9, True), (30.1, False)):
        force = np.linalg.solve(across, tension * np.array([-0.013, -0.005]) + pushed)
        assert presses(hand, np.array([force[0], 0.0, force[1]])) == expected


def held(hand: ArticulatedHand, down: float, friction: float) -> float:
    """Mass that both fingertips hold between them [kg]; down: 1 along -z, or -1."""
    tips = [tip_of(hand, finger) for finger in (0, 1)]
    points = np.array([tip for tip, _ in tips])
    points -= points.mean(axis=0)
    contacts = Contacts(points, -points, friction)
    grasp = HandGrasp(contacts, [rows for _, rows in tips], drives_of(hand))
    return hand_payload(grasp, Weight(direction=(0.0, 0.0, -down))).value


@pytest.mark.parametrize("stiffness", [0.0, 0.02])
def test_payload_of_planar_fingers_with_tendons_has_a_closed_form(
    tmp_path: Path, stiffness: float
) -> None:
    tendons = [
        {"arms": {f"knuckle{n}": -0.013, f"bend{n}": -0.005}, "tension": 30.0} for n in (0, 1)
    ]
    names = [f"{part}{n}" for n in (0, 1) for part in ("knuckle", "bend")]
    springs = {
        name: {"stiffness": stiffness, "rest": 2.0 * value}
        for name, value in zip(names, POSTURE.tolist(), strict=True)
    }
    hand = hand_of(tmp_path, tendons=tendons, springs=springs)
    across = tip_of(hand, 0)[1][[0, 2], :2].T
    per_newton = np.linalg.solve(across, [-0.013, -0.005])
    constant = np.linalg.solve(across, stiffness * POSTURE[:2])
    friction = 1.5 * abs(per_newton[1] / per_newton[0])
    # Both tensions are the same; where the force leaves the cone it holds no more.
    tensions = np.linspace(0.0, 30.0, 300001)
    inward, upward = np.outer(tensions, per_newton).T + constant[:, None]
    inside = (-inward >= 0.0) & (np.abs(upward) <= friction * -inward)
    for down in (1.0, -1.0):
        expected = max(0.0, 2.0 * (down * upward[inside]).max() / STANDARD_GRAVITY)
        assert held(hand, down, friction) == pytest.approx(expected, rel=1e-4, abs=1e-6)


def test_descriptions_state_what_they_were_read_from(tmp_path: Path) -> None:
    stated = {
        "tendons": [{"name": "flexor", "pretension": 1.0, **FLEXOR}],
        "springs": {"bend1": {"stiffness": 0.2, "rest": -0.1, "torque": 0.0}},
        "brakes": {"knuckle1": None, "bend0": 2.0},
    }
    hand = hand_of(tmp_path, **stated)
    assert hand.tendons == (Tendon("flexor", FLEXOR["arms"], (1.0, 30.0)),)  # type: ignore[arg-type]
    written = hand.description()
    assert {key: written[key] for key in stated} == stated
    # What is pulled or held has no motor, unless one is stated; the others have their efforts.
    np.testing.assert_array_equal(hand.torques, [0.0, 0.0, 0.0, 0.4])
    assert hand_of(tmp_path, torques={"bend0": 0.3}, **stated).torques[1] == 0.3


@pytest.mark.parametrize(
    ("stated", "words"),
    [
        ({"tendons": [{**FLEXOR, "tension": 0.0}]}, "tendons must be a list of"),
        ({"tendons": [{**FLEXOR, "pretension": 31.0}]}, "tendons must be a list of"),
        ({"tendons": [{**FLEXOR, "stiffness": 1.0}]}, "tendons must be a list of"),
        ({"tendons": [{"arms": {"bend0": 0.0}, "tension": 1.0}]}, "tendons must be a list of"),
        ({"tendons": [{"arms": {"bnd0": 0.01}, "tension": 1.0}]}, "tendons: 'bnd0' is no joint"),
        ({"springs": {"bend0": {"stiffness": -1.0}}}, "springs must be an object"),
        ({"springs": {"bend0": {"rest": 1.0}}}, "springs must be an object"),
        ({"springs": {"palm": {"torque": 1.0}}}, "springs: 'palm' is no joint that moves"),
        ({"brakes": {"bend0": 0.0}}, "brakes must be an object"),
        ({"brakes": {"bend7": None}}, "brakes: 'bend7' is no joint that moves"),
        ({"break": {"bend0": None}}, "no key is called 'break'"),
    ],
)
def test_what_makes_no_sense_is_refused(tmp_path: Path, stated: Any, words: str) -> None:
    with pytest.raises(SettingError, match=words) as caught:
        hand_of(tmp_path, **stated)
    assert "\n" not in str(caught.value)


MODEL = """<mujoco model="finger"><compiler angle="radian"/><worldbody>
 <body name="palm"><geom type="sphere" size="0.01"/>
  <body name="inner"><joint name="knuckle" axis="0 1 0" range="-1 1" stiffness="0.2"
    springref="0.3"/><geom type="box" size=".005 .005 .02" pos="0 0 .02"/>
   <body name="outer" pos="0 0 .04"><joint name="bend" axis="0 1 0" range="-1 1" frictionloss="1"/>
    <geom type="box" size=".005 .005 .015" pos="0 0 .015"/></body></body></body></worldbody>
 <tendon><fixed name="t"><joint joint="knuckle" coef="-0.01"/><joint joint="bend" coef="-0.006"/>
  </fixed></tendon>
 <actuator><motor name="flexor" tendon="t" gear="2" ctrlrange="-15 0" ctrllimited="true"/>
  <motor name="extensor" joint="bend" gear="0.5" forcerange="0.1 0.4" forcelimited="true"/>
  <motor name="both" joint="knuckle" forcerange="-0.3 0.3" forcelimited="true"/></actuator>
</mujoco>"""


def test_models_state_tendons_by_actuators_of_one_sign(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    path = tmp_path / "finger.xml"
    path.write_text(MODEL, encoding="utf-8")
    hand = grasp3d.read_hand(path)
    assert isinstance(hand, ArticulatedHand)
    assert hand.tendons == (
        Tendon("flexor", {"knuckle": 0.02, "bend": 0.012}, (0.0, 15.0)),
        Tendon("extensor", {"bend": 0.5}, (0.1, 0.4)),
    )
    assert hand.couplings == ()
    assert hand.springs == {"knuckle": Spring(0.2, 0.3)}  # friction is no brake
    assert hand.brakes == {}
    np.testing.assert_array_equal(hand.torques, [0.3, 0.0])
    said = "; ".join(hand.assumed)
    assert "tendons are those of the file: flexor, extensor" in said
    assert "springs are those of the file: knuckle" in said


def test_models_whose_limits_are_wider_than_one_way_have_no_motors_there(tmp_path: Path) -> None:
    """A joint's limit of what acts on it is no motor, and a range of forces allows no control."""
    pytest.importorskip("mujoco")
    path = tmp_path / "finger.xml"

    def read(old: str, new: str) -> ArticulatedHand:
        assert MODEL.count(old) == 1
        path.write_text(MODEL.replace(old, new), encoding="utf-8")
        hand = grasp3d.read_hand(path)
        assert isinstance(hand, ArticulatedHand)
        return hand

    limit = 'actuatorfrcrange="-0.4 0.4" actuatorfrclimited="true" name='
    assert read('name="bend"', limit + '"bend"').torques.tolist() == [0.3, 0.0]
    assert read('name="knuckle"', limit + '"knuckle"').torques.tolist() == [0.4, 0.0]
    pulled = 'ctrlrange="-15 0" ctrllimited="true"'
    for forces, least, most in ((-30, 0.0, 15.0), (-10, 0.0, 10.0)):
        hand = read(pulled, f'{pulled} forcerange="{forces} 30" forcelimited="true"')
        assert hand.couplings == ()
        assert hand.tendons[0] == Tendon("flexor", {"knuckle": 0.02, "bend": 0.012}, (least, most))
    both = 'joint="knuckle" forcerange="-0.3 0.3"'
    small = read(both, both + ' ctrlrange="-0.2 0.1" ctrllimited="true"')
    assert small.torques.tolist() == [0.2, 0.0]
