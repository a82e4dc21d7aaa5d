"""Hands of a few shapes beside objects, for tests of contacts."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import trimesh

import grasp3d
from grasp3d.arrays import ArrayLike, Floats
from grasp3d.hand.articulated_hand import ArticulatedHand
from grasp3d.hand.link_tree import Joint, LinkShape, LinkTree
from grasp3d.mesh import ObjectMesh


def at(x: float = 0.0, y: float = 0.0, z: float = 0.0, rotation: ArrayLike | None = None) -> Floats:
    """A pose."""
    pose = np.eye(4)
    pose[:3, 3] = x, y, z
    if rotation is not None:
        pose[:3, :3] = rotation
    return pose


def shape(kind: Any, *size: float, pose: Floats | None = None) -> LinkShape:
    """A shape of a link."""
    return LinkShape(kind, np.eye(4) if pose is None else pose, size)


def hand_of(
    links: Mapping[str, Sequence[LinkShape]],
    joints: Mapping[str, Joint] | None = None,
    closing: ArrayLike | None = None,
) -> ArticulatedHand:
    """A hand of links with shapes; links without a joint are fixed to the first one."""
    names = tuple(links)
    below = dict(joints or {})
    for name in names[1:]:
        fixed = Joint(f"{name} fixed", "fixed", names[0], np.eye(4), np.zeros(3), None)
        below.setdefault(name, fixed)
    tree = LinkTree("test hand", names, below, lambda name: tuple(links[name]))
    count = sum(joint.kind != "fixed" for joint in below.values())
    return ArticulatedHand(
        name="test hand",
        tree=tree,
        palm=names[0],
        approach=np.array([0.0, 0.0, 1.0]),
        fingertips=names[1:],
        sensors={},
        torques=np.full(count, np.nan),
        preshapes={"open": np.zeros(count)},
        closing=np.zeros(count) if closing is None else np.asarray(closing, dtype=np.float64),
    )


def solid(surface: trimesh.Trimesh, unit: Any = "m") -> ObjectMesh:
    """A mesh without refinement."""
    return grasp3d.load_mesh(surface, unit=unit, max_edge=1e3)


def core(one: LinkShape) -> tuple[Any, Any, float]:
    """Vertices and faces of a shape, or of its core with the radius of the ball around it."""
    if one.kind == "mesh":
        hull = trimesh.convex.convex_hull(one.vertices)
        return hull.vertices, hull.faces, 0.0
    if one.kind == "box":
        box = trimesh.creation.box(2.0 * np.array(one.size))
        return box.vertices, box.faces, 0.0
    if one.kind == "cylinder":  # 2e-8 m inside the exact cylinder
        round_one = trimesh.creation.cylinder(one.size[0], 2.0 * one.size[1], sections=1500)
        return round_one.vertices, round_one.faces, 0.0
    half = one.size[1] if one.kind == "capsule" else 0.0
    ends = np.array([[0.0, 0.0, -half], [0.0, 0.0, half], [0.0, 0.0, 0.5 * half]])
    return ends, np.array([[0, 1, 2]]), one.size[0]
