"""Links and joints of a robot description."""

import math
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy.spatial import QhullError

from grasp3d.arrays import Floats, locked
from grasp3d.errors import SettingError
from grasp3d.system.names import printable, unknown

FARTHEST = 1e3
"""Distance of geometry from its frame that is impossible for a hand [m]."""

FLAT = 1e-9
"""Width of a mesh, relative to its length, up to which it has no volume."""

MAX_LISTED = 40
"""Most links that an error message lists."""


JointKind = Literal["fixed", "slides", "turns", "free"]
ShapeKind = Literal["box", "cylinder", "capsule", "sphere", "mesh"]


@dataclass(frozen=True, eq=False)
class LinkShape:
    """A piece of the collision geometry of a link; lengths in metres."""

    kind: ShapeKind
    pose: Floats
    """From the shape's frame to the link's, shape (4, 4)."""
    size: tuple[float, ...] = ()
    """Box: three half lengths; cylinder and capsule: radius, half length (of the capsule's
    segment) along z; sphere: radius; mesh: empty."""
    surface: Floats = field(default_factory=lambda: locked(np.zeros((0, 3, 3))))
    """Mesh: corners of its triangles in the shape's frame, shape (t, 3, 3); else none."""

    @cached_property
    def vertices(self) -> Floats:
        """Mesh: corners of its convex hull in the shape's frame, shape (n, 3); none if it is flat.

        Physics engines use convex hulls as well.
        """
        from trimesh import convex

        with suppress(QhullError, ValueError):
            points = np.unique(self.surface.reshape(-1, 3), axis=0)
            widths = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
            if widths[-1] > FLAT * widths[0]:
                return locked(convex.convex_hull(points).vertices)
        return locked(np.zeros((0, 3)))

    def triangles(self) -> Floats:
        """Corners of its triangles, not of its hull, in the link's frame, shape (t, 3, 3)."""
        faces = self.surface if self.kind == "mesh" else np.asarray(self._solid().triangles)
        return np.asarray(faces @ self.pose[:3, :3].T + self.pose[:3, 3])

    def _solid(self) -> Any:
        from trimesh import creation  # imports much that reading poses does not need

        if self.kind == "box":
            return creation.box(2.0 * np.array(self.size))
        if self.kind == "sphere":
            return creation.icosphere(radius=self.size[0])
        if self.kind == "cylinder":
            return creation.cylinder(self.size[0], 2.0 * self.size[1])
        shape = creation.capsule(height=2.0 * self.size[1], radius=self.size[0])
        return shape.apply_translation(-shape.bounds.mean(axis=0))


class LinkMass(NamedTuple):
    """Mass and centre of mass of a link."""

    mass: float
    """[kg]"""
    center: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Its centre of mass in the link's frame [m]."""


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint of a robot, with the link that it moves."""

    name: str
    kind: JointKind
    """free: it moves in another way, as floating and ball joints do."""
    parent: str
    """The link that carries it."""
    origin: Floats
    """Pose of the moved link at the joint's value 0, in the frame of its parent, shape (4, 4)."""
    axis: Floats
    """Direction of sliding or axis of turning, in the frame of the moved link, shape (3,)."""
    limits: tuple[float, float] = (-math.inf, math.inf)
    """Smallest and largest value [m or rad]; infinite: unlimited."""
    follows: tuple[str, float, float] | None = None
    """Joint that it follows, factor and offset: its value is factor times that one's plus
    offset."""
    position: Floats = field(default_factory=lambda: locked(np.zeros(3)))
    """A point on the axis of turning, in the frame of the moved link, shape (3,)."""
    effort: float | None = None
    """Greatest torque or force that the file states [N m or N]; None: not stated."""


@dataclass(frozen=True, eq=False)
class LinkTree:
    """Links of a robot, which may branch anywhere; lengths in metres."""

    source: str
    """Name of the file, for messages."""
    links: tuple[str, ...]
    joints: Mapping[str, Joint]
    """The joint that moves each link, by the name of the link; the root has none."""
    shapes: Callable[[str], tuple[LinkShape, ...]]
    """Collision geometry of a link, by its name."""
    masses: Mapping[str, LinkMass] = field(default_factory=dict)
    """Masses by link, where the file states them."""
    closures: tuple[str, ...] = ()
    """Constraints between links besides the joints: closed loops, and couplings that are not
    linear."""
    unseen: tuple[str, ...] = ()
    """Links with visual geometry, but no collision geometry."""

    def geometry(self, link: str) -> Floats:
        """Corners of the collision geometry of a link in its frame, shape (n, 3, 3)."""
        parts = [shape.triangles() for shape in self.shapes(link)]
        return np.concatenate([np.zeros((0, 3, 3)), *parts])

    def branch(self, base: str) -> "LinkTree":
        """A link and all links below it, as a tree of its own.

        Raises:
            SettingError: There is no such link.
        """
        self.check_links([base])
        kept = tuple(name for name in self.links if base in self.chain(name))
        joints = {name: one for name, one in self.joints.items() if name in kept and name != base}
        masses = {name: one for name, one in self.masses.items() if name in kept}
        unseen = tuple(name for name in self.unseen if name in kept)
        return replace(self, links=kept, joints=joints, masses=masses, unseen=unseen)

    @cached_property
    def by_name(self) -> dict[str, Joint]:
        """Joints that move, by their own names."""
        return {one.name: one for one in self.joints.values() if one.kind != "fixed"}

    def chain(self, link: str) -> list[str]:
        """A link and all links above it, up to the root."""
        found = [link]
        while found[-1] in self.joints:
            found.append(self.joints[found[-1]].parent)
        return found

    def source_of(self, joint: Joint) -> tuple[str, float, float]:
        """The joint that determines a joint's value in the end: name, factor and offset.

        Raises:
            SettingError: It follows a joint that does not exist, or itself.
        """
        name, factor, offset, seen, follows = joint.name, 1.0, 0.0, {joint.name}, joint.follows
        while follows is not None:
            name, more, start = follows
            if name in seen or name not in self.by_name:
                raise self.error(f"joint {joint.name} follows {name}, which it cannot")
            seen.add(name)
            follows = self.by_name[name].follows
            factor, offset = factor * more, offset + factor * start
        return name, factor, offset

    def check_links(self, names: Iterable[str]) -> None:
        """Raise SettingError if a name is not that of a link."""
        for name in names:
            if name not in self.links:
                raise self.error(unknown("link", name, self.links, self.links[:MAX_LISTED]))

    def children(self, link: str) -> tuple[str, ...]:
        """The links whose joints a link carries, in order."""
        return tuple(name for name, joint in self.joints.items() if joint.parent == link)

    def error(self, problem: str) -> SettingError:
        """Make an error that names the file and the problem."""
        return SettingError(printable(f"{self.source}: {problem}"))

    def below(self, link: str) -> dict[str, Floats]:
        """Poses of a link and of all links fixed below it, in its frame."""
        poses = {link: np.eye(4)}
        for name in self.links:  # parents come before children
            joint = self.joints.get(name)
            if joint is not None and joint.kind == "fixed" and joint.parent in poses:
                poses[name] = poses[joint.parent] @ joint.origin
        return poses

    def rigid(self, link: str) -> dict[str, Floats]:
        """Poses of a link and of all links fixed to it, in its frame."""
        root, pose = link, np.eye(4)
        while root in self.joints and self.joints[root].kind == "fixed":
            pose = self.joints[root].origin @ pose
            root = self.joints[root].parent
        to_link = np.linalg.inv(pose)
        return {name: to_link @ relative for name, relative in self.below(root).items()}

    def triangles(self, poses: Mapping[str, Floats]) -> Floats:
        """Corners of the collision geometry of links at poses, shape (n, 3, 3).

        Raises:
            SettingError: Some of it is too far away.
        """
        parts = [self.geometry(link) @ pose[:3, :3].T + pose[:3, 3] for link, pose in poses.items()]
        triangles = np.concatenate([np.zeros((0, 3, 3)), *parts])
        if not np.abs(triangles).max(initial=0.0) < FARTHEST:
            raise self.error(f"collision geometry is {FARTHEST:g} m away, or has infinite numbers")
        return triangles
