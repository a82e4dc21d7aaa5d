"""Reasons of outcomes that contradict a label, from the numbers of grasps."""

import math

import numpy as np

from grasp3d import ParallelGripper
from grasp3d.hand.closed_jaws import Closing, Touch
from grasp3d.validating.disagreements import REASONS, Kind, Numbers, causes_of, reasons_of

FRANKA = ParallelGripper.preset("franka")
GOOD = {
    "contact_area": 200e-6, "center_of_mass_distance": 0.01, "opening": 0.05, "grip_force": 5.0,
    "reachable": 1.0, "critical_angle": 0.2, "payload": 1.5,
}  # fmt: skip


def numbers(
    state: Closing = Closing.CLOSED,
    touch: Touch = Touch.FACE,
    hand: ParallelGripper = FRANKA,
    **changed: float,
) -> Numbers:
    """Those of two grasps, of which the first is good."""
    values = {name: np.array([GOOD.get(name, 1.0), value]) for name, value in changed.items()}
    scores = {name: np.full(2, value) for name, value in GOOD.items()} | values
    return Numbers(
        scores=scores, state=np.array([Closing.CLOSED, state]),
        touch=np.array([[Touch.FACE] * 2, [Touch.FACE, touch]]), hand=hand, size=0.1,
        available=70.0, friction=0.5,
    )  # fmt: skip


def causes(kind: Kind, given: Numbers) -> list[str]:
    return [str(one) for one in causes_of(given, reasons_of(given, kind), 1)]


def test_each_reason_of_a_failure_has_its_sentence() -> None:
    def failed(touch: Touch = Touch.FACE, **changed: float) -> list[str]:
        return causes("failed", numbers(touch=touch, **changed))  # type: ignore[arg-type]

    assert failed() == ["no visible cause: dynamics, deformation, or a mesh that differs"]
    assert failed(contact_area=5e-6)[0].startswith("small contact (5 mm²): the object can roll")
    assert failed(center_of_mass_distance=0.03)[0] == (
        "centre of mass far off the contacts (30 mm): the weight twists the object"
    )
    assert failed(opening=0.078)[0].startswith("little room for the open gripper (1 mm on each s")
    assert failed(touch=Touch.PAD_RIM)[0].startswith("contact on the pad's rim only: it holds by")
    assert len(failed(contact_area=5e-6, opening=0.078)) == 2


def test_each_reason_of_a_success_has_its_sentence() -> None:
    def held(**changed: float) -> list[str]:
        return causes("held", numbers(**changed))  # type: ignore[arg-type]

    (friction,) = held(critical_angle=math.atan(0.7))
    assert friction.startswith("friction (force-closed from 0.7 on, labels at 0.5): the true one m")
    assert held(critical_angle=1.7)[0].startswith("no visible cause")
    assert held(grip_force=math.nan) == held()
    (unreachable,) = held(reachable=0.0)
    assert unreachable.startswith("not reachable: the gripper of the attempt came otherwise")
    assert held(grip_force=90.0, payload=0.4)[0].startswith(
        "payload below the load (90 N, 70 N at hand, payload 0.4 kg)"
    )
    assert "(no force suffices, 70 N" in held(grip_force=math.inf)[0]
    assert held(contact_area=5e-6, critical_angle=1.7)[0].startswith("small contact (5 mm²): an e")
    assert causes("held_open", numbers(state=Closing.STARTS_INSIDE))[0].startswith(
        "a finger starts in the object: pose, gripper or mesh differ"
    )


def test_the_last_reason_is_that_of_grasps_without_another_one() -> None:
    found = reasons_of(numbers(contact_area=5e-6), "failed")
    assert {reason.name: mask.tolist() for reason, mask in found.items() if mask.any()} == {
        "small contact": [False, True], "no visible cause": [True, False],
    }  # fmt: skip
    assert len({(one.kind, one.name) for one in REASONS}) == len(REASONS)


def test_round_tips_have_small_contacts_too() -> None:
    tips = ParallelGripper.preset("tactile")
    area = 2.0 * math.pi * tips.tip_radius * tips.compliance
    assert numbers(hand=tips, contact_area=1e-9).small.tolist()[1]
    assert not numbers(hand=tips, contact_area=area).small[1]
