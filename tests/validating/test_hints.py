import math

from grasp3d import GraspModel, ParallelGripper
from grasp3d.hand.closed_jaws import Closing
from grasp3d.validating.disagreements import NONE, failed_hints, held_hints, is_small

FRANKA = ParallelGripper.preset("franka")
GOOD = {
    "contact_area": 200e-6, "center_of_mass_distance": 0.01, "opening": 0.05, "grip_force": 5.0,
    "reachable": 1.0, "critical_angle": 0.2,
}  # fmt: skip


def failed(**changed: float) -> tuple[str, ...]:
    return failed_hints(GOOD | changed, FRANKA, 0.1, 70.0)


def held(state: Closing = Closing.CLOSED, **changed: float) -> tuple[str, ...]:
    return held_hints(GOOD | changed, FRANKA, GraspModel(), state)


def test_each_cause_of_a_failure_has_its_sentence() -> None:
    assert failed() == (NONE,)
    assert failed(contact_area=5e-6)[0].startswith("small contact (5 mm²)")
    assert failed(center_of_mass_distance=0.03)[0].startswith("the centre of mass is 30 mm off")
    assert failed(opening=0.078)[0].startswith("the open gripper leaves 1 mm on each side")
    assert failed(grip_force=90.0)[0] == (
        "the load needs 90 N of each finger, and 70 N are at hand"
    )
    assert "no finite force" in failed(grip_force=math.inf)[0]
    assert "may not have been reached" in failed(reachable=0.0)[0]
    assert len(failed(contact_area=5e-6, reachable=0.0)) == 2
    unknown = {name: value for name, value in GOOD.items() if name != "grip_force"}
    assert failed_hints(unknown, FRANKA, 0.1, None) == (NONE,)


def test_each_cause_of_a_success_has_its_sentence() -> None:
    assert held(Closing.NOTHING)[0].startswith("the jaws close on nothing: pose, gripper or mesh")
    assert "M, not U: at the perceived normals friction 0.5 is enough" in held()[0]
    above = held(critical_angle=math.atan(0.7))
    assert above == ("force-closed from a friction of 0.7 on: the true one may be above 0.5",)
    assert held(critical_angle=1.7) == (NONE,)
    assert held(contact_area=5e-6, critical_angle=1.7)[0].startswith("small contact (5 mm²): an e")


def test_round_tips_have_small_contacts_too() -> None:
    tips = ParallelGripper.preset("tactile")
    assert is_small(1e-9, tips)
    assert not is_small(2.0 * math.pi * tips.tip_radius * tips.compliance, tips)
