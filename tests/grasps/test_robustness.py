"""Scores of what closed jaws touch, and of poses that are a little wrong."""

import math
from functools import cache
from typing import Any

import numpy as np
import pytest
import trimesh

from grasp3d import GraspModel, Load, ObjectMesh, evaluate_grasps, load_mesh, read_hand
from grasp3d.contact.contacts import evenly_pressed_radius
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.grasps.robustness import LOST, PAYLOAD_RTOL
from grasp3d.quality.tasks import STANDARD_GRAVITY
from grasp3d.stability.label import Label
from tests.helpers import shapes
from tests.helpers.closing_jaws import Floats, pads, pose, random_poses
from tests.helpers.patches import force_of_points

MODEL = GraspModel()
BETA = MODEL.sure_angle
FORCE = 20.0


def mesh_of(surface: Any, unit: str = "m") -> ObjectMesh:
    return load_mesh(surface, unit=unit, max_edge=1e3)


@cache
def box() -> ObjectMesh:
    return mesh_of(shapes.box((0.06, 0.05, 0.03)))


@cache
def blob() -> ObjectMesh:
    vertices, faces = shapes.lopsided()
    return mesh_of((0.025 * vertices, faces))


def evaluated(
    mesh: ObjectMesh, poses: Any, hand: Any = None, *, fixed: bool = False, **options: Any
) -> EvaluatedPoses:
    options |= {"object_motion": "fixed"} if fixed else {}
    result = evaluate_grasps(
        mesh, np.asarray(poses).reshape(-1, 4, 4), MODEL, hand=hand or pads(), **options
    )
    assert isinstance(result, EvaluatedPoses)
    return result


def test_opposed_patches_about_the_centre_of_mass_hold_what_friction_allows() -> None:
    """Forces of length F within b = beta - alpha/2 of either side of the axis, added up.

    The sums are bounded by the line from (0, 2 F sin b) to F (cos b, sin b), F sin 2b from zero.
    """
    load = Load(mass=0.3, grip_force=FORCE)
    found = evaluated(box(), pose(), load=load).robustness
    held = FORCE * math.sin(2.0 * BETA) / STANDARD_GRAVITY
    assert found.stated.payload[0] == pytest.approx(held, rel=PAYLOAD_RTOL)
    ratio = held / 0.3
    assert found.stated.score[0] == pytest.approx(ratio / (1.0 + ratio), abs=PAYLOAD_RTOL)
    assert found.score[0] == pytest.approx(found.stated.score[0], rel=1e-12)
    bare = evaluated(box(), pose()).robustness.stated  # the weight per force
    ratio = math.sin(2.0 * BETA)
    assert bare.payload[0] * STANDARD_GRAVITY == pytest.approx(ratio, rel=PAYLOAD_RTOL)
    assert bare.score[0] == pytest.approx(ratio / (1.0 + ratio), abs=PAYLOAD_RTOL)


def test_a_load_that_is_too_heavy_lacks_an_angle() -> None:
    """The load is held where 2 F sin of twice the angle of friction would do; about in proportion.

    Below that the score is negative, the more the heavier the load is.
    """
    held = FORCE * math.sin(2.0 * BETA) / STANDARD_GRAVITY
    masses = (0.95 * held, 1.05 * held, 1.5 * held, 2.5 * held)
    found = [
        evaluated(box(), pose(), load=Load(mass=mass, grip_force=FORCE)).robustness
        for mass in masses
    ]
    scores = [one.stated.score[0] for one in found]
    assert scores[0] > 0.5
    assert 0.0 >= scores[1] > scores[2] > scores[3] >= LOST
    assert [one.label[0] for one in found[:2]] == [Label.S, Label.M]


def test_contacts_near_the_border_may_be_lost() -> None:
    """The contacts are 5 mm from it: two deviations of an error of 5 mm, four of one of 2.5 mm."""
    for error, deviations in (("5mm", 2.0), ("2.5mm", 4.0)):
        found = evaluated(box(), pose(), pose_error=error).robustness
        stay = 0.5 * (1.0 + math.erf(deviations / math.sqrt(2.0)))
        alone = evaluated(box(), pose()).robustness.score[0]
        # On the faces of a box nearby poses are about as good.
        assert found.score[0] == pytest.approx((1.0 + alone) * stay - 1.0, abs=0.06)
        assert found.score[0] < found.stated.score[0]
    # 4 mm inside the pad's end.
    tall, at = mesh_of(shapes.box((0.03, 0.03, 0.12))), pose((0.0, 0.0, 0.057))
    for error, label in (("3mm", Label.S), ("4.5mm", Label.M)):
        assert evaluated(tall, at, pose_error=error).robustness.label[0] == label


def pressed(results: EvaluatedPoses, row: int) -> Floats:
    """Points of the patches of a pose, drawn toward their centres as for an even pressure."""
    jaws, middle = results.jaws, results.jaws.points[row, :, None]
    radius = evenly_pressed_radius(0.5 * jaws.extents[row], jaws.area[row])
    arms = jaws.corners[row] - middle
    share = np.minimum(radius / np.linalg.norm(arms, axis=2).max(axis=1), 1.0)
    return middle + share[:, None, None] * arms


@pytest.mark.slow
def test_payloads_are_those_of_cone_programs() -> None:
    """Least force of a program in the hardest of many directions of weight, on a lopsided blob."""
    mesh = blob()
    load = Load(mass=0.1, grip_force=1.0)
    results = evaluated(mesh, random_poses(60, 0.004, seed=2), pads(compliance=0.002), load=load)
    found, compared = results.robustness, 0
    random = np.random.default_rng(0)
    directions = random.standard_normal((300, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    friction = np.full(2, math.tan(BETA))
    for row in np.flatnonzero(found.stated.payload > 0.01)[:6]:
        points = pressed(results, row) - mesh.center_mass
        normals = results.jaws.normals[row]

        def force(direction: Floats, points: Any = points, normals: Any = normals) -> float:
            wrench = np.append(direction, np.zeros(3))
            return force_of_points(points, normals, friction, wrench, "norm")

        needed = 1.0 / (found.stated.payload[row] * STANDARD_GRAVITY)  # per newton of weight
        forces = np.array([force(one) for one in directions])
        assert forces.max() <= needed * (1.0 + 1e-6)
        worst = directions[forces.argmax()]
        for step in (0.1, 0.03, 0.01):  # climb to the hardest direction
            for _ in range(12):
                other = worst + step * random.standard_normal(3)
                other /= np.linalg.norm(other)
                if force(other) > force(worst):
                    worst = other
        assert force(worst) >= needed * (1.0 - 2.0 * PAYLOAD_RTOL)
        compared += 1
    assert compared == 6


def test_a_patch_that_hangs_over_the_pad_carries_less() -> None:
    """The centre of mass is on the axis of the box, the contacts move away from it along z."""
    tall = mesh_of(shapes.box((0.03, 0.03, 0.12)))
    poses = [pose((0.0, 0.0, height)) for height in (0.0, 0.02, 0.057, 0.064)]
    found = evaluated(tall, poses, fixed=True).robustness
    assert (np.diff(found.stated.payload) < 0.0).all()
    assert found.pad_margin is not None
    # Half the pad is 5 mm; of the last one the lower millimetre touches.
    np.testing.assert_allclose(found.pad_margin, [0.005, 0.005, 0.004, 0.0005], atol=1e-8)


def test_patches_that_do_not_close_have_the_angle_that_they_lack() -> None:
    """Wedge of 2 x 20 degrees: friction holds 22 degrees at best beside alpha/2, so it is fixed."""
    angle = math.radians(20.0)
    half = 0.1 * math.tan(angle)
    corners = [[-half, y, 0.0] for y in (-0.02, 0.02)] + [[half, y, 0.0] for y in (-0.02, 0.02)]
    corners += [[0.0, y, 0.1] for y in (-0.02, 0.02)]
    wedge = trimesh.Trimesh(corners).convex_hull
    found = evaluated(
        mesh_of(wedge), pose((0.0, 0.0, 0.05)), pads(compliance=1e-5), fixed=True
    ).robustness
    assert found.stated.score[0] == pytest.approx((BETA - angle) / math.pi, abs=2e-3)


def test_without_errors_and_load_tried_labels_are_the_labels() -> None:
    results = evaluated(blob(), random_poses(150, 0.01, seed=3), pads(compliance=0.002))
    found = results.robustness
    np.testing.assert_array_equal(np.where(results.reachable, found.label, Label.U), results.label)
    assert found.tried == 1
    assert (found.score[~results.jaws.closed] == LOST).all()
    assert set(results.label) == {Label.U, Label.M, Label.S}


@pytest.mark.slow
def test_errors_are_never_better_than_none() -> None:
    poses, hand = random_poses(40, 0.008, seed=5), pads(compliance=0.002)
    exact = evaluated(blob(), poses, hand)
    for error in ("0.1mm", "0.7mm,0.5deg", "3deg", "5mm,3deg"):
        found = evaluated(blob(), poses, hand, pose_error=error).robustness
        # Where fingers start in the object, U becomes M.
        assert not ((found.label == Label.S) & (exact.robustness.label < Label.S)).any()
    assert (found.label < exact.robustness.label).any()


def test_fingers_that_start_in_the_object_by_less_than_the_error_give_way() -> None:
    """The box of 60 mm is 12 mm off the middle of a stroke of 80: 2 mm of it are in a finger."""
    off = pose((0.012, 0.0, 0.0))
    refused = evaluated(box(), off)
    assert not refused.jaws.closed[0]
    short = evaluated(box(), off, pose_error="0.5mm")
    assert not short.jaws.closed[0]
    given = evaluated(box(), off, pose_error="4mm")
    assert given.jaws.closed[0]
    assert 0.0 < abs(given.jaws.shift[0]) <= 0.004
    assert given.robustness.label[0] == Label.M
    assert given.to_table()["shift"].to_pylist() == [given.jaws.shift[0]]
    # Fingers that start in the object by less than the compliance close, but their way is free.
    franka, wide = read_hand("franka"), mesh_of(shapes.box((0.07, 0.05, 0.03)))
    for offset in (0.0053, 0.0065, 0.008):
        at = pose((offset, 0.0, 0.0))
        assert not evaluated(wide, at, franka).reachable[0]
        found = evaluated(wide, at, franka, pose_error="5mm")
        assert found.jaws.closed[0]
        assert found.reachable[0]
        assert 0.0 < abs(found.jaws.shift[0]) <= 0.005


def test_of_patches_beside_each_other_the_best_line_counts() -> None:
    """Two steps on either side of a plate: a line between their edges is the least inclined."""
    steps = [
        trimesh.creation.box(size, trimesh.transformations.translation_matrix((x, 0.0, z)))
        for size, x, z in (
            ((0.004, 0.04, 0.02), -0.004, 0.012),
            ((0.004, 0.04, 0.02), 0.004, -0.012),
            ((0.006, 0.04, 0.044), 0.0, 0.0),
        )
    ]
    mesh = mesh_of(trimesh.boolean.union(steps))
    found = evaluated(mesh, pose((0.0, 0.0, 0.0)), pads(), fixed=True)
    low, high = np.sort(found.jaws.points[0, :, 2])
    apart = high - low - 0.5 * found.jaws.extents[0, :, 1].sum()
    assert apart > 0.003
    score = found.robustness.stated.score[0]
    assert score == pytest.approx((BETA - math.atan2(apart, 0.012)) / math.pi, abs=1e-4)
    assert score > (BETA - found.critical_angle[0]) / math.pi + 0.05


def test_contacts_outside_the_region_have_no_score() -> None:
    region = "box:-1,-1,-1,19mm,1,1"
    mesh = load_mesh(shapes.box((60.0, 50.0, 30.0)), unit="mm", max_edge="8mm", region=region)
    found = evaluated(mesh, pose()).robustness
    assert found.label[0] == found.stated.label[0] == Label.U
    assert found.score[0] == LOST
