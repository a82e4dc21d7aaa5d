"""Poses of hands with joints: labels, numbers and reasons of known grasps."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import grasp3d
from grasp3d import Contacts, Label, critical_friction_angle
from grasp3d.errors import ContactError, SettingError
from grasp3d.formats import GraspPoses
from grasp3d.grasps.link_grasps import LinkGrasps
from grasp3d.hand.articulated_hand import ArticulatedHand
from grasp3d.hand.table import Approach, Table
from grasp3d.mesh import ObjectMesh
from grasp3d.surface.fields import HAND_GRASPS
from tests.helpers import shapes, slider_hand
from tests.helpers.slider_hand import BOX, TOUCHING

Floats = NDArray[np.float64]
SAMPLED = math.radians(1.0)
FINE = grasp3d.GraspModel(sensor_resolution=math.radians(10.0))


@pytest.fixture(scope="module")
def box() -> ObjectMesh:
    return grasp3d.load_mesh(shapes.box(BOX), unit="m")


def given(*postures: Any, shift: Floats | None = None, **options: Any) -> GraspPoses:
    """The hand's axis through the middle of the box, or shifted; the joints' values."""
    poses = np.tile(np.eye(4), (len(postures), 1, 1))
    if shift is not None:
        poses[:, :3, 3] = shift
    values = [np.broadcast_to(posture, 4) for posture in postures]
    return GraspPoses(poses=poses, posture=np.array(values), unit="m", **options)


def evaluated(box: ObjectMesh, folder: Path, *postures: Any, **options: Any) -> LinkGrasps:
    found = grasp3d.evaluate_grasps(
        box, given(*postures), FINE, hand=slider_hand.hand(folder, **options)
    )
    assert isinstance(found, LinkGrasps)
    return found


def test_poses_are_written_where_the_contacts_are(box: ObjectMesh, tmp_path: Path) -> None:
    hand = slider_hand.hand(tmp_path)
    poses = given(TOUCHING - 2e-3, joint_names=hand.joint_names)
    found = grasp3d.evaluate_grasps(box, poses, FINE, hand=hand, contact_rule="closed")
    assert np.abs(found.to_poses().posture - poses.posture).max() > 1e-3
    path = tmp_path / "found.csv"
    grasp3d.write_grasps(path, found)
    back = grasp3d.evaluate_grasps(
        box, grasp3d.read_grasps(path, hand=hand), FINE, hand=hand, contact_distance="0.2mm"
    )
    assert back.links.tolist() == found.links.tolist() != [""]
    np.testing.assert_allclose(back.margin, found.margin, atol=SAMPLED)


def test_four_fingers_on_a_box(box: ObjectMesh, tmp_path: Path) -> None:
    found = evaluated(box, tmp_path, TOUCHING)
    assert found.label.tolist() == [Label.S]
    assert found.links.tolist() == ["finger_0 finger_1 finger_2 finger_3"]
    # Points near the surface are averaged, which leaves contacts off the middle a little.
    assert found.critical_angle[0] == pytest.approx(0.0, abs=SAMPLED)
    assert found.margin[0] == pytest.approx(math.atan(0.5) - math.radians(5.0), abs=SAMPLED)
    assert found.max_resolution[0] == pytest.approx(2.0 * math.atan(0.5), abs=2.0 * SAMPLED)
    assert (found.reason.tolist(), found.reachable.tolist()) == ([""], [True])
    assert found.rank.tolist() == [6]


def test_critical_angle_is_that_of_the_contacts_bit_for_bit(
    box: ObjectMesh, tmp_path: Path
) -> None:
    postures = TOUCHING + np.random.default_rng(0).uniform(-0.004, 0.002, size=(5, 4))
    found = evaluated(box, tmp_path, *postures)
    for row in range(5):
        points, normals = found.contacts_of(row)
        contacts = Contacts(points - box.center_mass, normals)
        assert found.critical_angle[row] == critical_friction_angle(contacts)


def test_a_location_error_costs_a_hand_what_the_surface_turns_and_torques_need(
    box: ObjectMesh, tmp_path: Path
) -> None:
    """In the middle of flat sides nothing turns; an error that reaches an edge leaves no S."""
    exact = evaluated(box, tmp_path, TOUCHING)
    hand, poses = slider_hand.hand(tmp_path), given(TOUCHING)
    margins = [float(exact.margin[0])]
    for error in (1e-3, 2e-3, 0.04):
        model = replace(FINE, location_error=error)
        found = grasp3d.evaluate_grasps(box, poses, model, hand=hand)
        assert isinstance(found, LinkGrasps)
        margins.append(float(found.margin[0]))
        assert found.critical_angle_best.tolist() == [0.0]
        assert (found.label[0] == Label.S) == (margins[-1] > 0.0)
    assert margins == sorted(margins, reverse=True)
    assert margins[0] > margins[1] > 0.0 > margins[3]


def test_links_have_the_resolution_that_they_state_or_that_of_the_model(
    box: ObjectMesh, tmp_path: Path
) -> None:
    stated = {f"finger_{number}": math.radians(30.0) for number in range(4)}
    found = evaluated(box, tmp_path, TOUCHING, sensors=stated)
    assert found.label.tolist() == [Label.S]
    assert found.margin[0] == pytest.approx(math.atan(0.5) - math.radians(15.0), abs=SAMPLED)
    assert found.to_poses().settings["sensor_resolutions"] == pytest.approx(
        {"palm": math.radians(10.0), **stated}
    )
    coarse = dict.fromkeys(["finger_1", "finger_3"], math.radians(80.0))
    found = evaluated(box, tmp_path, TOUCHING, sensors=coarse)
    # Their tilts exceed friction.
    assert found.label.tolist() == [Label.M]
    assert found.margin[0] == pytest.approx(math.atan(0.5) - math.radians(40.0), abs=SAMPLED)


@pytest.mark.parametrize(
    ("posture", "label", "reason"),
    [
        ([TOUCHING, TOUCHING, TOUCHING, -0.02], Label.U,
         "joint 4 (slide_3) is 20 mm beyond its limit"),
        ([TOUCHING + 0.014, TOUCHING, TOUCHING, TOUCHING], Label.U,
         "finger_0 14 mm inside the object"),
        (0.01, Label.U, "no link within 5 mm of the object"),
        ([TOUCHING, 0, 0, 0], Label.U, "touches with one link only, finger_0"),
    ],
)  # fmt: skip
def test_reasons(box: ObjectMesh, tmp_path: Path, posture: Any, label: Label, reason: str) -> None:
    found = evaluated(box, tmp_path, posture)
    assert (found.reason.tolist(), found.label.tolist()) == ([reason], [label])
    inside = "limit" in reason or "inside" in reason
    assert found.reachable.tolist() == [not inside]
    if not inside:
        assert np.isnan([found.critical_angle[0], found.epsilon[0], found.margin[0]]).all()


def test_joints_that_follow_have_limits_of_their_own(box: ObjectMesh, tmp_path: Path) -> None:
    coupled = {"joints": ["slide_0", "slide_1"], "ratios": [1, 2]}
    hand = grasp3d.read_hand(slider_hand.write(tmp_path, couplings=[coupled]))
    assert isinstance(hand, ArticulatedHand)
    np.testing.assert_allclose(hand.limits_of_joints, [[0.0, 0.03], [0.0, 0.06], [0.0, 0.06]])
    postures = np.array([[0.04, 0.0, 0.0], [0.03, 0.0, 0.0], [0.04, 0.0, 0.09]])
    poses = GraspPoses(poses=np.tile(np.eye(4), (3, 1, 1)), posture=postures, unit="m")
    found = grasp3d.evaluate_grasps(box, poses, FINE, hand=hand)
    first, second, third = found.reason.tolist()
    assert first == "joint slide_1 is 20 mm beyond its limit"
    assert "limit" not in second
    assert third == "joint 3 (slide_3) is 30 mm beyond its limit"


def test_reasons_of_collisions(box: ObjectMesh, tmp_path: Path) -> None:
    found = evaluated(box, tmp_path, TOUCHING)
    contacts = replace(
        found.contacts, self_collision=np.array([[0, 2]]), self_depth=np.array([0.007])
    )
    overlapping = replace(found, contacts=contacts)
    assert overlapping.reason.tolist() == ["palm and finger_1 overlap by 7 mm"]
    below = replace(found, contacts=replace(found.contacts, table_depth=np.array([0.02])))
    assert below.reason.tolist() == ["20 mm below the table"]
    assert overlapping.reachable.tolist() == below.reachable.tolist() == [False]


def test_table_and_approach(box: ObjectMesh, tmp_path: Path) -> None:
    hand = slider_hand.hand(tmp_path)
    found = grasp3d.evaluate_grasps(
        box, given(TOUCHING), FINE, hand=hand, table=Table.below(box),
        approach=Approach(np.array([0.0, 0, -1]), within=1.0),
    )  # fmt: skip
    assert found.reason.tolist() == ["42 mm below the table"]  # the palm
    found = grasp3d.evaluate_grasps(
        box, given(TOUCHING), FINE, hand=hand, approach=Approach(np.array([0.0, 0, -1]), within=1.0)
    )
    assert found.reason.tolist() == ["comes 180° from the approach direction, more than 57°"]


def test_results_in_other_units_are_the_same(box: ObjectMesh, tmp_path: Path) -> None:
    hand, poses = slider_hand.hand(tmp_path), given(TOUCHING - 0.002, 0.01)
    millimetres = grasp3d.load_mesh(shapes.box(1000.0 * np.array(BOX)), unit="mm")
    one, other = (
        grasp3d.evaluate_grasps(mesh, poses, FINE, hand=hand) for mesh in (box, millimetres)
    )
    assert one.label.tolist() == other.label.tolist()
    assert one.reason.tolist() == other.reason.tolist()
    np.testing.assert_allclose(one.gap, other.gap, atol=1e-6)
    np.testing.assert_allclose(one.epsilon, other.epsilon, rtol=2e-2)
    assert one.rank.tolist() == other.rank.tolist()


def test_contacts_outside_the_region_are_refused(tmp_path: Path) -> None:
    part = grasp3d.load_mesh(shapes.box(BOX), unit="m", region="box:0,-1,-1,1,1,1")
    found = evaluated(part, tmp_path, TOUCHING)
    assert found.reason.tolist() == ["touches outside --region"]
    assert found.label.tolist() == [Label.U]


def test_joints_are_matched_by_name(box: ObjectMesh, tmp_path: Path) -> None:
    hand = slider_hand.hand(tmp_path)
    values = np.array([TOUCHING, 0.01, 0.02, 0.03])
    poses = given(values[::-1], joint_names=tuple(reversed(hand.joint_names)))
    found = grasp3d.evaluate_grasps(box, poses, hand=hand)
    assert found.given.posture.tolist() == [values.tolist()]
    assert found.given.joint_names == hand.joint_names
    assert found.links.tolist() == ["finger_0"]
    unnamed = grasp3d.evaluate_grasps(box, given(values), hand=hand)
    assert unnamed.links.tolist() == ["finger_0"]
    order = "the order of the joints is not stated: that of sliders is assumed"
    assert order in unnamed.warnings
    with pytest.raises(ContactError, match=r"no values of them: .* columns called joint:"):
        grasp3d.evaluate_grasps(box, np.eye(4)[None], hand=hand)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"model": grasp3d.GraspModel(method="extremes")}, "takes no method extremes"),
        ({"max_distance": 0.1}, "max_distance applies to contacts"),
    ],
)
def test_settings_that_do_not_apply_are_refused(
    box: ObjectMesh, tmp_path: Path, options: dict[str, Any], message: str
) -> None:
    hand = slider_hand.hand(tmp_path)
    with pytest.raises(SettingError, match=message):
        grasp3d.evaluate_grasps(box, given(TOUCHING), **options, hand=hand)


def test_chosen_poses_and_tables(box: ObjectMesh, tmp_path: Path) -> None:
    found = evaluated(box, tmp_path, 0.01, TOUCHING, TOUCHING - 0.003)
    chosen = found.take(np.array([2, 0]))
    for name in ("label", "critical_angle", "epsilon", "gap", "rank", "reason"):
        np.testing.assert_array_equal(getattr(chosen, name), getattr(found, name)[[2, 0]])
    frame = found.to_dataframe()
    assert frame["label"].tolist() == ["U", "S", "S"]
    assert frame["reason"].tolist()[1:] == ["", ""]
    assert frame["gap_finger_0"].round(6).tolist()[1:] == [0.0, 0.003]
    poses = found.to_poses()
    assert poses.joint_names == tuple(f"slide_{number}" for number in range(4))
    assert poses.columns["links"].tolist()[0] == ""
    columns = {name for name in poses.columns if not name.startswith("gap_")}
    assert columns == {field.name for field in HAND_GRASPS if field.when == "always"} - {"score"}
    assert poses.in_unit("mm").columns["gap"][2] == pytest.approx(3.0)
    assert poses.settings["contact_rule"] == "given"
    assert grasp3d.grasps.ranked_rows(found).tolist() == [1, 2, 0]


def test_joints_beyond_their_limits_cast_doubt_on_an_assumed_order(
    box: ObjectMesh, tmp_path: Path
) -> None:
    hand = grasp3d.read_hand(slider_hand.write(tmp_path))
    for wrong, told in ((1, False), (2, True)):
        postures = np.full((10, 4), TOUCHING)
        postures[:wrong, 2] = 0.1
        poses = GraspPoses(poses=np.tile(np.eye(4), (10, 1, 1)), posture=postures, unit="m")
        warnings = grasp3d.evaluate_grasps(box, poses, hand=hand).warnings
        (said,) = (one for one in warnings if one.startswith("the order of the joints is not"))
        assert ("beyond their limits in 2 of 10 poses: are these of another hand" in said) == told
