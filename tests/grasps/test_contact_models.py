"""Contacts of closed jaws as points, soft contacts and patches."""

import math
from dataclasses import replace
from typing import Any, get_args

import numpy as np
import pytest
import trimesh

import grasp3d
from grasp3d import Contacts, GraspModel, Label, Load, ParallelGripper
from grasp3d.contact.contacts import evenly_pressed_radius
from grasp3d.errors import SettingError
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.grasps.evaluation import evaluate_grasps
from grasp3d.grasps.poses import GraspPoses
from grasp3d.settings.grasp_model import ContactModel
from tests.helpers.closing_jaws import pads

FROM_ABOVE = np.diag([1.0, -1.0, -1.0, 1.0])
BOX = grasp3d.load_mesh(trimesh.creation.box([0.06, 0.04, 0.02]), unit="m")
WEDGE = grasp3d.load_mesh(
    trimesh.convex.convex_hull(
        [
            [x * (0.03 + 0.4 * z), y, z]
            for x in (-1, 1)
            for y in (-0.02, 0.02)
            for z in (-0.01, 0.01)
        ]
    ),
    unit="m",
)


def contacts_of(found: EvaluatedPoses) -> Contacts:
    """The contacts where the jaws close."""
    return found.grasps.contacts.contacts(found.model)


def at_heights(*heights: float) -> GraspPoses:
    poses = np.stack([FROM_ABOVE] * len(heights))
    poses[:, 2, 3] = heights
    return GraspPoses(poses=poses)


def evaluated(
    mesh: Any, poses: GraspPoses, hand: ParallelGripper | None = None, **model: Any
) -> EvaluatedPoses:
    """Evaluate poses on an object that does not give way."""
    load = Load(mass=0.2, grip_force=40.0)
    jaws = hand or replace(ParallelGripper.preset("franka"), inner_faces=())
    return evaluate_grasps(
        mesh, poses, GraspModel(**model), hand=jaws, object_motion="fixed", load=load
    )


def test_a_point_has_the_given_torsion_radius_alone() -> None:
    found = contacts_of(evaluated(BOX, at_heights(0.0), torsion_radius="2mm"))
    assert found.patch is None
    assert found.torsion_radius.tolist() == [[0.002, 0.002]]
    plain = contacts_of(evaluated(BOX, at_heights(0.0)))
    assert not plain.torsion_radius.any()


def test_soft_contacts_resist_torsion_by_what_they_touch() -> None:
    found = evaluated(BOX, at_heights(0.0, 0.013), contact="soft", friction=0.4)
    contacts, jaws = contacts_of(found), found.jaws
    assert contacts.patch is None
    assert contacts.torsion_radius == pytest.approx(
        0.4 * evenly_pressed_radius(0.5 * jaws.extents, jaws.area)
    )
    # A pad of 17.4 x 17.6 mm: on average its points are 0.3826 x 17.5 mm from its middle.
    assert contacts.torsion_radius[0] == pytest.approx(0.4 * 0.3826 * 0.0175, rel=0.03)
    assert (contacts.torsion_radius[1] < 0.8 * contacts.torsion_radius[0]).all()
    given = contacts_of(evaluated(BOX, at_heights(0.0), contact="soft", torsion_radius="1mm"))
    assert given.torsion_radius.tolist() == [[0.001, 0.001]]


def test_patches_extend_along_the_grippers_axes() -> None:
    found = evaluated(BOX, at_heights(0.0, 0.013), contact="patch")
    contacts, extents = contacts_of(found), found.jaws.extents
    axes = FROM_ABOVE[:3, 1:3].T
    assert contacts.patch == pytest.approx(0.5 * extents[..., None] * axes, abs=1e-12)


def test_patches_on_inclined_faces_lie_in_their_planes() -> None:
    found = evaluated(WEDGE, at_heights(0.0), pads(compliance=0.002), contact="patch", friction=0.9)
    contacts = contacts_of(found)
    inclined = np.abs(contacts.normals[0, :, 2])
    assert (inclined > 0.2).all()
    assert np.abs((contacts.patch * contacts.normals[..., None, :]).sum(axis=-1)).max() < 1e-15
    along_z = 0.5 * found.jaws.extents[0, :, 1] * np.sqrt(1.0 - inclined**2)
    assert np.linalg.norm(contacts.patch[0, :, 1], axis=-1) == pytest.approx(along_z)


def test_labels_of_points_and_soft_contacts_are_the_same() -> None:
    poses = at_heights(0.0, 0.01, 0.018)
    labels = [
        evaluated(WEDGE, poses, contact=name, friction=0.3).label for name in ("point", "soft")
    ]
    assert np.array_equal(*labels)


def test_a_pad_turned_half_about_its_approach_is_the_same_pad() -> None:
    turned = at_heights(0.003, 0.012)
    half = np.diag([-1.0, -1.0, 1.0, 1.0])
    both = [turned, GraspPoses(poses=turned.poses @ half)]
    found = [evaluated(WEDGE, poses, contact="patch", friction=0.6) for poses in both]
    assert found[1].critical_angle == pytest.approx(found[0].critical_angle, abs=2e-5)
    for one in ("grip_force", "payload"):
        first, second = (getattr(each.holding, one) for each in found)
        assert second == pytest.approx(first, rel=3e-3)


def test_a_small_patch_needs_more_force_for_a_weight_beside_it() -> None:
    """At the edge the pads touch 0.8 mm of their height: the same points, but the box turns.

    The ends of that strip bear more of a torque than pressure that is even.
    """
    for contact, factor in (("soft", 1.5), ("patch", 1.4)):
        found = evaluated(BOX, at_heights(0.0, 0.018), contact=contact)
        assert found.jaws.area[1, 0] < 0.1 * found.jaws.area[0, 0]
        assert found.holding.grip_force[1] > factor * found.holding.grip_force[0]
        assert found.holding.payload[1] < found.holding.payload[0] / factor
    soft, patch = (
        evaluated(BOX, at_heights(0.0), contact=name).holding for name in ("soft", "patch")
    )
    assert patch.grip_force[0] < soft.grip_force[0]


def test_the_load_takes_the_torsion_of_the_contacts_at_each_friction() -> None:
    found = evaluated(BOX, at_heights(0.0), contact="patch", friction="0.4..0.6")
    case, contacts = found.load_case, contacts_of(found)
    assert case.own_torsion
    assert not case.hard
    low = case.at_friction(contacts, 0.25)
    assert low.torsion_radius == pytest.approx(0.5 * contacts.torsion_radius)
    assert np.array_equal(low.patch, contacts.patch)
    assert case.settings()["force_torsion_radius"] is None
    given = evaluated(BOX, at_heights(0.0), contact="soft", torsion_radius="1mm").load_case
    assert (given.own_torsion, given.torsion_radius) == (False, 0.001)


def test_patches_bring_beta_star_to_the_best_line() -> None:
    """Pads that close on two blocks beside each other: only a line of their middles is inclined."""
    upper = trimesh.creation.box([0.02, 0.04, 0.02], transform(-0.01, 0.004))
    lower = trimesh.creation.box([0.02, 0.04, 0.02], transform(0.01, -0.004))
    mesh = grasp3d.load_mesh(trimesh.boolean.union([upper, lower]), unit="m")
    point = evaluated(mesh, at_heights(0.0), contact="point")
    patch = evaluated(mesh, at_heights(0.0), contact="patch")
    heights = point.jaws.points[0, :, 2]
    extents = point.jaws.extents[0, :, 1]
    width = point.opening[0]
    offset = abs(heights[1] - heights[0])
    assert offset > 0.002
    assert point.critical_angle[0] == pytest.approx(math.atan2(offset, width))
    left = max(offset - 0.5 * extents.sum(), 0.0)
    assert patch.critical_angle[0] == pytest.approx(math.atan2(left, width), abs=2e-5)
    assert patch.critical_angle[0] < point.critical_angle[0] - 0.01
    assert patch.label[0] == Label.S


def transform(x: float, z: float) -> np.ndarray:
    matrix = np.eye(4)
    matrix[[0, 2], 3] = x, z
    return matrix


def test_files_say_what_a_contact_is() -> None:
    for name in get_args(ContactModel):
        found = evaluated(BOX, at_heights(0.0), contact=name)
        assert found.to_poses().settings["contact"] == name
        assert ("force_torsion_radius" in found.to_poses().settings) == (name == "point")


def test_measures_of_points_are_refused_for_patches() -> None:
    found = evaluated(BOX, at_heights(0.0), contact="patch")
    with pytest.raises(SettingError, match="those of point contacts"):
        found.metrics("grasp_isotropy")
    assert np.isfinite(
        evaluated(BOX, at_heights(0.0), contact="soft").metrics("grasp_isotropy")["grasp_isotropy"]
    ).all()


@pytest.mark.parametrize("contact", ["soft", "patch"])
def test_contacts_without_a_gripper_are_points(contact: str) -> None:
    model = GraspModel(contact=contact)  # type: ignore[arg-type]
    sides = [[[0.03, 0.0, 0.0], [-0.03, 0.0, 0.0]]]
    calls: list[Any] = [
        lambda: grasp3d.label_surface(BOX, model),
        lambda: grasp3d.scan_surface(BOX, fixed=sides[0][:1], model=model),
        lambda: grasp3d.evaluate_grasps(BOX, sides, model),
        lambda: grasp3d.planar.scan(grasp3d.planar.Circle(1.0), model=model),
    ]
    for call in calls:
        with pytest.raises(SettingError, match=f"--contact {contact}.* applies to poses of a grip"):
            call()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"contact": "sticky"}, "no contact is called 'sticky'; known: point, soft, patch"),
        ({"contact": "patch", "method": "extremes"}, "does not take method extremes"),
        ({"contact": "patch", "location_error": "1mm"}, "does not take location_error"),
        ({"contact": "patch", "per_finger": "normal_error=1;"}, "does not take per_finger"),
    ],
)
def test_models_that_do_not_fit_are_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(SettingError, match=message):
        GraspModel(**arguments)
