"""Links and joints of a robot description, and the hand among them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.errors import SettingError
from grasp3d.hand.hand_geometry import SlidingFinger, SlidingHand
from grasp3d.system.names import printable

FARTHEST = 1e4
"""Distance of geometry from its frame that no hand has [m]."""

MAX_LISTED = 40
"""Most links that an error message lists."""


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint of a robot, with the link that it moves."""

    name: str
    kind: Literal["fixed", "slides", "turns"]
    parent: str
    """The link that carries it."""
    origin: Floats
    """Pose of the moved link at the joint's value 0, in the frame of its parent, shape (4, 4)."""
    axis: Floats
    """Direction in which it slides, or about which it turns, in the frame of the moved link, shape
    (3,)."""
    limits: tuple[float, float] | None
    """Smallest and largest value [m or rad]; None: unlimited."""
    follows: tuple[str, float, float] | None = None
    """Its value is that of another joint, of this name, times a factor, plus an offset."""


@dataclass(frozen=True, eq=False)
class LinkTree:
    """Links of a robot, which may branch anywhere; lengths in metres."""

    source: str
    """Name of the file, for messages."""
    links: tuple[str, ...]
    joints: Mapping[str, Joint]
    """The joint that moves each link, by the name of the link; the root has none."""
    geometry: Callable[[str], Floats]
    """Corners of the collision geometry of a link in its frame, shape (n, 3, 3)."""

    def __post_init__(self) -> None:
        reached = {name for name in self.links if name not in self.joints}
        for name in self.links:  # in an order in which parents come first, if there is one
            if name in self.joints and self.joints[name].parent in reached:
                reached.add(name)
        for name in self.links:
            if name not in reached:
                raise self._error(f"joint {self.joints[name].name} is part of a loop of joints")

    def children(self, link: str) -> tuple[str, ...]:
        """The links whose joints a link carries, in their order."""
        return tuple(name for name, joint in self.joints.items() if joint.parent == link)

    def sliding_hand(self, fingers: tuple[str, str], palm: str | None) -> SlidingHand:
        """The part of it that is a hand with two sliding fingers.

        Args:
            fingers: Names of the fingers' links.
            palm: Name of the palm's link; None: the link that carries the fingers.

        Raises:
            SettingError: There are no such links, no geometry, or fingers that do not slide.
        """
        for name in (*fingers, *([] if palm is None else [palm])):
            if name not in self.links:
                more = " ..." if len(self.links) > MAX_LISTED else ""
                listed = ", ".join(self.links[:MAX_LISTED]) + more
                raise self._error(f"no link is called {name!r}; known: {listed}")
        movers = [self._mover(link) for link in fingers]
        carrier = self.joints[movers[0]].parent
        if movers[0] == movers[1]:
            raise self._error(f"{fingers[0]} and {fingers[1]} are moved by one joint, together")
        around = self._rigid(carrier)
        parts = [
            self._finger(name, mover, around) for name, mover in zip(fingers, movers, strict=True)
        ]
        # Without `palm` only links below the carrier count: above it the robot's arm may be.
        links = self._below(carrier if palm is None else palm)
        if palm is not None and palm not in around:
            raise self._error(f"{palm} is not fixed to {carrier}, which carries the fingers")
        points = self._triangles({link: around[link] for link in links}).reshape(-1, 3)
        if not len(points):
            what = palm or f"{carrier}, which carries the fingers,"
            raise self._error(f"{what} has no collision geometry; name the palm's link (--palm)")
        one, two = (self.joints[mover] for mover in movers)
        return SlidingHand(self.source, carrier, (parts[0], parts[1]), points, _coupling(one, two))

    def _error(self, problem: str) -> SettingError:
        return SettingError(printable(f"{self.source}: {problem}"))

    def _mover(self, link: str) -> str:
        """The link, of a finger or above it, that the finger's joint moves."""
        name = link
        while name in self.joints:
            joint = self.joints[name]
            if joint.kind == "turns":
                raise self._error(
                    f"joint {joint.name} turns {link}; only fingers that slide can be read: "
                    "describe this gripper in a JSON file"
                )
            if joint.kind == "slides":
                return name
            name = joint.parent
        raise self._error(f"no joint moves {link}; name the links of the fingers")

    def _finger(self, name: str, mover: str, around: Mapping[str, Floats]) -> SlidingFinger:
        joint = self.joints[mover]
        if joint.parent not in around:
            raise self._error(f"the fingers' joints must be on one link; that of {name} is not")
        pose = around[joint.parent] @ joint.origin
        poses = {link: pose @ relative for link, relative in self._below(mover).items()}
        triangles = self._triangles(poses)
        if not len(triangles):
            raise self._error(f"{name} has no collision geometry")
        axis = pose[:3, :3] @ joint.axis
        return SlidingFinger(name, joint.name, axis, self._limits(joint), triangles)

    def _limits(self, joint: Joint) -> tuple[float, float]:
        if joint.follows is not None:
            name, factor, offset = joint.follows
            source = next((one for one in self.joints.values() if one.name == name), None)
            if source is not None and source.limits is not None:
                low, high = sorted(factor * limit + offset for limit in source.limits)
                return low, high
        if joint.limits is None or not joint.limits[0] < joint.limits[1]:
            raise self._error(f"joint {joint.name} has no limits, from which the stroke follows")
        return joint.limits

    def _below(self, link: str) -> dict[str, Floats]:
        """Poses of a link and all that is fixed below it, in its frame."""
        poses = {link: np.eye(4)}
        for name in self.links:  # parents come before children
            joint = self.joints.get(name)
            if joint is not None and joint.kind == "fixed" and joint.parent in poses:
                poses[name] = poses[joint.parent] @ joint.origin
        return poses

    def _rigid(self, link: str) -> dict[str, Floats]:
        """Poses of all links that are fixed to one, in its frame."""
        root, pose = link, np.eye(4)
        while root in self.joints and self.joints[root].kind == "fixed":
            pose = self.joints[root].origin @ pose
            root = self.joints[root].parent
        to_link = np.linalg.inv(pose)
        return {name: to_link @ relative for name, relative in self._below(root).items()}

    def _triangles(self, poses: Mapping[str, Floats]) -> Floats:
        parts = [self.geometry(link) @ pose[:3, :3].T + pose[:3, 3] for link, pose in poses.items()]
        triangles = np.concatenate([np.zeros((0, 3, 3)), *parts])
        if not np.abs(triangles).max(initial=0.0) < FARTHEST:
            raise self._error(f"collision geometry is {FARTHEST:g} m away, or has infinite numbers")
        return triangles


def _coupling(one: Joint, two: Joint) -> float | None:
    """Change of joint two per change of joint one; None: they are not coupled."""
    if two.follows is not None and two.follows[0] == one.name:
        return two.follows[1]
    if one.follows is not None and one.follows[0] == two.name and one.follows[1]:
        return 1.0 / one.follows[1]
    if one.follows is not None and two.follows is not None and one.follows[0] == two.follows[0]:
        return two.follows[1] / one.follows[1] if one.follows[1] else None
    return None
