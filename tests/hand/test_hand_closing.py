"""Hands that close on an object, and overlaps of links with each other."""

import itertools
import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from grasp3d import read_hand
from grasp3d._kernels.hands.closing import OVERLAPS
from grasp3d.arrays import Floats
from grasp3d.errors import SettingError
from grasp3d.hand.articulated_hand import ArticulatedHand
from grasp3d.hand.link_contacts import HandContacts, HandScene, hand_contacts, reaches
from grasp3d.hand.link_tree import Joint, LinkShape
from grasp3d.mesh import ObjectMesh, load_mesh
from tests.helpers import shapes as known
from tests.helpers.hands import hand_file
from tests.helpers.link_scenes import at, core, hand_of, shape, solid

SIZE = 60
"""Random postures of each hand."""

X = np.array([1.0, 0.0, 0.0])
Y = np.array([0.0, 1.0, 0.0])


@cache
def ball() -> ObjectMesh:
    return solid(trimesh.creation.icosphere(4, radius=0.03))


def slider(name: str, axis: Floats, limits: tuple[float, float]) -> Joint:
    return Joint(name, "slides", "palm", np.eye(4), axis, limits)


FINGERS = {
    name: [shape("capsule", 0.007, 0.02, pose=at(x))]
    for name, x in (("left", -0.067), ("right", 0.067))
}
"""Two capsules along z that slide from 60 mm away toward the middle."""

SLIDERS = {"left": slider("a", X, (0.0, 0.1)), "right": slider("b", -X, (0.0, 0.1))}


def pincer(limits: tuple[float, float] = (0.0, 0.1)) -> ArticulatedHand:
    joints = {name: replace(joint, limits=limits) for name, joint in SLIDERS.items()}
    return hand_of({"palm": [], **FINGERS}, joints, [1.0, 1.0])


def finger() -> ArticulatedHand:
    """Two links of 40 mm along z; both joints bend them toward +x."""
    links = [shape("capsule", 0.006, 0.02, pose=at(0, 0, 0.02))]
    joints = {
        "proximal": Joint("a", "turns", "palm", np.eye(4), Y, (0.0, 2.0)),
        "distal": Joint("b", "turns", "proximal", at(0, 0, 0.04), Y, (0.0, 2.0)),
    }
    return hand_of({"palm": [], "proximal": links, "distal": links}, joints, [1.0, 1.0])


def found_at(
    hand: ArticulatedHand, mesh: ObjectMesh, pose: Floats, posture: Any, **options: Any
) -> HandContacts:
    return hand_contacts(mesh, hand, pose[None], np.atleast_2d(posture), **options)


def test_closing_fingers_stop_where_they_touch() -> None:
    found = found_at(pincer(), ball(), at(0.005), [0.0, 0.0], rule="closed")
    np.testing.assert_allclose(found.posture, [[0.025, 0.035]], atol=2e-4)
    assert np.abs(found.gaps[0, 1:]).max() < 1e-4
    assert found.touching.tolist() == [[False, True, True]]
    short = found_at(pincer((0.0, 0.02)), ball(), np.eye(4), [0.0, 0.0], rule="closed")
    np.testing.assert_allclose(short.posture, [[0.02, 0.02]], atol=1e-12)
    assert not short.touching.any()
    inside = found_at(pincer(), ball(), at(0.04), [0.0, 0.0], rule="closed")
    assert inside.posture[0, 0] == 0.0
    assert inside.gaps[0, 1] < -0.005


@pytest.mark.parametrize("away", [0.0105, 0.013, 0.017, 0.0222, 0.03])
@pytest.mark.parametrize("thick", [0.0, 2e-5])
def test_a_finger_does_not_pass_through_a_thin_wall(thick: float, away: float) -> None:
    wall = trimesh.creation.box([thick, 0.1, 0.1], at(away + 0.5 * thick))
    if not thick:  # a sheet without an inside
        wall.update_faces(wall.face_normals[:, 0] < -0.5)
    found = found_at(finger(), solid(wall), np.eye(4), [0.0, 0.0], rule="closed")
    assert np.abs(found.gaps[0, 1:]).min() < 1e-4
    assert found.gaps[0, 1:].min() > -1e-4
    assert 0.04 * math.sin(found.posture[0, 0]) < away - 0.006 + 2e-4


@pytest.mark.parametrize("away", [0.05, 0.055, 0.06, 0.063, 0.066, 0.07, 0.075])
@pytest.mark.parametrize("kind", ["sphere", "mesh"])
def test_fingers_far_from_the_object_do_not_pass_through_each_other(kind: str, away: float) -> None:
    """Balls of 10 mm, and plates of 6 mm that stand askew in their frames, slide up to another."""
    half, turned = 0.01, np.eye(4)
    link = shape("sphere", half)
    if kind == "mesh":
        half, turned = 0.003, trimesh.transformations.rotation_matrix(math.pi / 4, Y)
        plate = trimesh.creation.box([2.0 * half, 0.04, 0.04])
        surface = np.asarray(plate.apply_transform(turned).triangles)
        link = LinkShape("mesh", np.linalg.inv(turned), surface=surface)
    joints = {
        name: Joint(name, "slides", "palm", at(sign * away), -sign * X, (0.0, 0.2))
        for name, sign in (("left", -1.0), ("right", 1.0))
    }
    hand = hand_of({"palm": [], "left": [link], "right": [link]}, joints, [1.0, 1.0])
    found = found_at(hand, ball(), at(1.0), [0.0, 0.0], rule="closed")
    np.testing.assert_allclose(found.posture, [[away - half] * 2], atol=2.5e-3)
    assert 0.0 <= found.self_depth[0] <= 5e-4


def test_links_that_overlap_at_the_start_do_not_stop_others() -> None:
    """The stated value of a joint that does not close the hand may put links into each other."""
    other = {"thumb": [shape("sphere", 0.01, pose=at(0.067, 0.0, 0.0))]}
    slides = {**SLIDERS, "thumb": slider("c", Y, (-0.1, 0.1))}
    hand = hand_of({"palm": [], **FINGERS, **other}, slides, [1.0, 1.0, 0.0])
    hand = replace(hand, preshapes={"open": np.array([0.0, 0.0, 0.1])})
    found = found_at(hand, ball(), np.eye(4), [0.0, 0.0, 0.0], rule="closed")
    np.testing.assert_allclose(found.posture, [[0.03, 0.03, 0.0]], atol=2e-4)


def around_ball(hand: ArticulatedHand, size: int) -> tuple[Floats, Floats]:
    """Poses at which the palm faces the ball from about 70 mm, turned at random, and postures."""
    rng = np.random.default_rng(1)
    opened = hand.preshapes["open"]
    palm = hand.link_poses(opened)[0, hand.link_names.index(hand.palm), :3, 3]
    poses = np.tile(np.eye(4), (size, 1, 1))
    poses[:, :3, :3] = Rotation.random(size, rng=rng).as_matrix()
    poses[:, :3, 3] = rng.normal(0.0, 0.015, (size, 3)) - poses[:, :3, :3] @ (
        palm + 0.07 * hand.approach
    )
    return poses, np.tile(opened, (size, 1))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["allegro", "barrett", "shadow"])
def test_joints_stop_at_touches_limits_or_where_links_meet(name: str) -> None:
    """And no link that moves gets deeper than it was."""
    hand = read_hand(hand_file(name))
    poses, postures = around_ball(hand, 20)
    found = hand_contacts(ball(), hand, poses, postures, rule="closed")
    scene = HandScene(ball(), hand, 0.005)
    before = scene.link_gaps(scene.touch(scene.frames(poses, postures)))
    links = [np.flatnonzero(scene.bodies.links == link) for link in range(len(hand.link_names))]
    moves = np.array([(reaches(scene)[some] > 0.0).any(axis=0) for some in links])
    moved = (moves & (hand.closing != 0.0)).any(axis=1) & np.array(list(map(len, links)), bool)
    depth = np.minimum(before[:, moved] - 1e-6, -1e-4)
    assert (found.gaps[:, moved] >= depth).all()
    assert (found.self_depth <= OVERLAPS).all()
    low, high = hand.limits_of_joints.T
    forward = hand.closing > 0.0
    ended = np.where(forward, found.posture >= high, found.posture <= low) | (hand.closing == 0.0)
    stopped = ended | ((found.gaps <= 1e-4)[:, :, None] & moves).any(axis=1)
    for row in np.flatnonzero(~stopped.all(axis=1)):
        further = found.posture[row] + np.where(stopped[row], 0.0, 5e-3 * np.sign(hand.closing))
        frames, left = scene.frames(poses[row : row + 1], further[None]), ~stopped[row]
        allowed = scene.may_overlap.copy()
        while left.any():
            (overlap,), (pair,) = scene.overlaps(frames, allowed)
            assert overlap > OVERLAPS, (row, np.flatnonzero(left))
            left &= moves[pair[0]] == moves[pair[1]]
            allowed[pair[0], pair[1]] = allowed[pair[1], pair[0]] = 1


def test_links_that_overlap_are_named_with_their_depth() -> None:
    rods = {
        name: [shape("cylinder", 0.01, 0.05, pose=at(0, y, 0))]
        for name, y in (("one", 0.1), ("two", 0.117))
    }
    joints = {"one": slider("a", Y, (0.0, 0.1)), "two": slider("b", Y, (-0.1, 0.1))}
    hand = hand_of({"palm": [shape("box", 0.02, 0.02, 0.02)], **rods}, joints)
    apart = found_at(hand, ball(), at(1.0), [0.0, 0.05])
    assert apart.self_collision.tolist() == [[-1, -1]]
    assert apart.self_depth[0] == 0.0
    # By design they overlap in the open posture, and the palm is next to each.
    assert found_at(hand, ball(), at(1.0), [0.0, 0.0]).self_depth[0] == 0.0
    third = {**rods, "three": [shape("sphere", 0.01, pose=at(0, 0.15, 0))]}
    joints["three"] = slider("c", Y, (-0.1, 0.1))
    hand = hand_of({"palm": [], **third}, joints)
    found = found_at(hand, ball(), at(1.0), [0.0, 0.0, -0.02])
    assert found.self_collision.tolist() == [[2, 3]]
    assert found.self_depth[0] == pytest.approx(0.007, abs=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["allegro", "barrett", "shadow"])
def test_overlaps_of_links_are_those_of_fcl(name: str) -> None:
    """Of hulls, at random postures: all that are deeper than 1 mm are found, and no others."""
    hand = read_hand(hand_file(name))
    scene = HandScene(ball(), hand, 0.005)
    low, high = hand.limits_of_joints.T
    postures = low + (high - low) * np.random.default_rng(0).random((SIZE, len(low)))
    frames = scene.frames(np.tile(np.eye(4), (SIZE, 1, 1)), postures)
    found, _ = scene.overlaps(frames, scene.may_overlap)
    exact = np.array([overlap_by_fcl(scene, placed) for placed in frames])
    assert (exact > 0.001).sum() > 5
    assert (found[exact > 0.001] > 0.0).all()
    assert (exact[found > 1e-6] > 0.0).all()


def overlap_by_fcl(scene: HandScene, frames: Floats) -> float:
    """The deepest overlap of two links that may not overlap [m], 0: there is none."""
    fcl, bodies = known.reader("fcl"), scene.bodies
    placed = frames[bodies.links, :, :3] @ bodies.poses
    placed[..., 3] += frames[bodies.links, :, 3]
    shapes = [one for some in scene.hand.shapes for one in some]
    objects = [
        fcl.CollisionObject(convex(one), fcl.Transform(pose[:, :3], pose[:, 3]))
        for one, pose in zip(shapes, placed, strict=True)
    ]
    middles = np.einsum("mij,mj->mi", placed[..., :3], bodies.boxes[:, :3]) + placed[..., 3]
    deepest, request = 0.0, fcl.CollisionRequest(enable_contact=True)
    for i, j in itertools.combinations(range(len(objects)), 2):
        far = np.linalg.norm(middles[i] - middles[j]) > bodies.boxes[[i, j], 6].sum()
        if far or scene.may_overlap[bodies.links[i], bodies.links[j]]:
            continue
        result = fcl.CollisionResult()
        fcl.collide(objects[i], objects[j], request, result)
        deepest = max([deepest, *(abs(each.penetration_depth) for each in result.contacts)])
    return deepest


@cache
def convex(one: LinkShape) -> Any:
    """FCL's convex shape: its own of round ones are off."""
    vertices, _, radius = core(one)
    around = trimesh.creation.icosphere(2, radius).vertices if radius else np.zeros((1, 3))
    hull = trimesh.convex.convex_hull((vertices[:, None] + around).reshape(-1, 3))
    rows = np.insert(hull.faces, 0, 3, axis=1).ravel()
    return known.reader("fcl").Convex(hull.vertices, len(hull.faces), rows)


def test_what_does_not_fit_is_refused() -> None:
    with pytest.raises(SettingError, match="2 poses have 1 postures"):
        hand_contacts(ball(), pincer(), [np.eye(4)] * 2, np.zeros((1, 2)))
    with pytest.raises(SettingError, match="no collision geometry"):
        hand_contacts(ball(), hand_of({"palm": []}), np.eye(4)[None], np.zeros((1, 0)))
    with pytest.raises(SettingError, match="hands and grippers are given in metres"):
        found_at(pincer(), load_mesh(trimesh.creation.box()), at(), [0.0, 0.0])
    rule: Any = "taken"
    with pytest.raises(SettingError, match="no rule is called"):
        found_at(pincer(), ball(), at(), [0.0, 0.0], rule=rule)
