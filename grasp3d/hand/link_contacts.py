"""Contacts of a hand with joints: which links touch an object, where, and at what distance."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from grasp3d._kernels.hands.closing import (
    OVERLAPS,
    Closing,
    ClosingScratch,
    make_closing_scratch,
    self_overlaps,
)
from grasp3d._kernels.hands.closing import close as close_hands
from grasp3d._kernels.hands.kinematics import SLIDES
from grasp3d._kernels.hands.touching import Touches, TouchScratch, make_touch_scratch, touch
from grasp3d.arrays import ArrayLike, Bools, Floats, Ints, locked, short_repr
from grasp3d.errors import SettingError
from grasp3d.hand.articulated_hand import ArticulatedHand
from grasp3d.hand.choices import ContactRule
from grasp3d.hand.jaws import IN_METRES
from grasp3d.hand.link_bodies import reach_along
from grasp3d.hand.pose_checks import checked_poses
from grasp3d.hand.table import Table
from grasp3d.settings.checks import check_choice, check_range
from grasp3d.system.context import in_threads

if TYPE_CHECKING:
    from grasp3d.mesh import ObjectMesh


SEARCH = 2.0
"""Largest gap that is measured, in contact distances."""

CHUNK = 16
"""Poses that a thread evaluates at once."""


class HandScene:
    """A hand and an object as the kernels take them, in the frame of the mesh."""

    def __init__(self, mesh: "ObjectMesh", hand: ArticulatedHand, distance: float) -> None:
        """Prepare the surface (once per mesh) and the hand (once per hand).

        Args:
            mesh: The object.
            hand: The hand.
            distance: Contact distance [m].
        """
        self.hand, self.distance = hand, distance
        self.bodies, self.surface = hand.bodies, mesh.touched_surface

    def frames(self, poses: Floats, postures: Floats) -> Floats:
        """Frames of the links in the mesh's frame [m], shape (k, L, 3, 4).

        Args:
            poses: From the hand's frame to the mesh's, translations in metres, shape (k, 4, 4).
            postures: Values of the joints, shape (k, p).
        """
        return np.ascontiguousarray(poses[:, None, :3] @ self.hand.link_poses(postures))

    def touch(
        self, frames: Floats, *, contacts: bool = True, search: float | None = None
    ) -> Touches:
        """Measure gaps up to a distance, and find contacts if they are wanted."""
        count, links, shapes = len(frames), frames.shape[1], len(self.bodies.kinds)
        listed = links if contacts else 0
        touches = Touches(
            gaps=np.full((count, shapes), np.inf),
            points=np.zeros((count, shapes, 3)),
            contacts=np.full((count, listed, 7), np.nan),
        )
        limit = SEARCH * self.distance if search is None else search

        def run(rows: slice, scratch: Any) -> None:
            touch(
                frames, self.distance, limit, rows.start, rows.stop, self.bodies, self.surface,
                touches, scratch,
            )  # fmt: skip

        in_threads(run, count, CHUNK, lambda: make_touch_scratch(self.bodies))
        return touches

    def link_gaps(self, touches: Touches) -> Floats:
        """Signed distance of each link [m], shape (k, L)."""
        gaps = np.full((len(touches.gaps), len(self.hand.link_names)), np.inf)
        np.minimum.at(gaps.T, self.bodies.links, touches.gaps.T)
        return gaps

    def table_depth(self, frames: Floats, table: Table | None) -> Floats:
        """How deep the hand is in a table [m], shape (k,); nan without a table."""
        if table is None:
            return np.full(len(frames), np.nan)
        lowest = np.full(len(frames), np.inf)
        for link, shape in ((k, one) for k, some in enumerate(self.hand.shapes) for one in some):
            pose = frames[:, link, :, :3] @ shape.pose[:3]
            pose[..., 3] += frames[:, link, :, 3]
            up = table.normal @ pose  # (k, 4), in the shape's frame
            lowest = np.minimum(lowest, up[:, 3] - reach_along(shape, -up[:, :3]))
        return np.asarray(table.offset - lowest)

    def overlaps(self, frames: Floats, allowed: Ints) -> tuple[Floats, Ints]:
        """Depth of the deepest overlap of two links [m], (k,), and the two links, (k, 2).

        Args:
            frames: As `frames` returns them.
            allowed: 1 for pairs of links that may overlap (L, L).
        """
        depths, pairs = np.zeros(len(frames)), np.full((len(frames), 2), -1)

        def run(rows: slice, _: object) -> None:
            self_overlaps(frames, rows.start, rows.stop, allowed, self.bodies, depths, pairs)

        in_threads(run, len(frames), CHUNK)
        return depths, pairs

    @cached_property
    def may_overlap(self) -> Ints:
        """1 for links joined rigidly or by a joint, or overlapping at the open preshape (L, L)."""
        hand = self.hand
        chain, count = hand.chain, len(hand.link_names)
        rigid = np.arange(count)
        allowed = np.eye(count, dtype=np.int64)
        for link in range(1, count):
            parent = rigid[chain.parents[link]]
            if chain.columns[link] < 0:
                rigid[link] = parent
            else:
                allowed[link, parent] = allowed[parent, link] = 1
        allowed = np.ascontiguousarray(allowed[np.ix_(rigid, rigid)])
        frames = self.frames(np.eye(4)[None], hand.preshapes["open"][None])
        while True:
            (depth,), (pair,) = self.overlaps(frames, allowed)
            if depth <= OVERLAPS:
                return allowed
            allowed[pair[0], pair[1]] = allowed[pair[1], pair[0]] = 1


SMALLEST_STEP, LARGEST_STEP = 1e-3, 0.03
"""Bounds of the steps of links that may meet [m]."""


def close(scene: HandScene, poses: Floats, postures: Floats) -> Floats:
    """Close hands from postures until links touch (conservative advancement).

    All joints move together, each at its speed. A link that touches stops all joints that move it;
    the others go on. Joints also stop at their limits. Where two links of the hand meet, the joints
    that move only one of them stop.

    Args:
        scene: Hand and object.
        poses: From the hand's frame to the mesh's [m], shape (k, 4, 4).
        postures: Postures from which they close, shape (k, p).

    Returns:
        Postures, shape (k, p).
    """
    hand, bodies, values = scene.hand, scene.bodies, postures.copy()
    speeds, limits, reach = hand.closing, hand.limits_of_joints, reaches(scene)
    moves = (reach > 0.0) & (speeds != 0.0)
    apart = scene.may_overlap[np.ix_(bodies.links, bodies.links)] == 0
    pairs = np.argwhere(np.triu(apart & (moves[:, None] != moves).any(axis=2))).copy(order="C")
    closing = Closing(speeds.copy(), limits.copy(), reach, _largest_steps(scene), pairs)
    matrices = np.array(poses, order="C")  # kernels are compiled for writable arrays

    def run(rows: slice, scratch: tuple[ClosingScratch, TouchScratch]) -> None:
        close_hands(
            matrices, values, rows.start, rows.stop, closing, hand.chain, bodies, scene.surface,
            *scratch,
        )  # fmt: skip

    links = len(hand.link_names)

    def make_scratch() -> tuple[ClosingScratch, TouchScratch]:
        return make_closing_scratch(closing, links), make_touch_scratch(bodies)

    in_threads(run, len(poses), CHUNK, make_scratch)
    return values


def _largest_steps(scene: HandScene) -> Floats:
    """Largest steps of shapes with which links do not pass through each other [m], shape (m,).

    For two equal links `overlaps` detects the path from touching to coinciding, except its ends, so
    together they move by three quarters of it. Shapes thinner than 3 mm, or thinner than the
    thickest shape of their link, may pass.
    """
    steps = np.zeros(len(scene.hand.link_names))
    np.maximum.at(steps, scene.bodies.links, 0.75 * scene.hand.half_widths)
    return np.clip(steps[scene.bodies.links], SMALLEST_STEP, LARGEST_STEP)


def reaches(scene: HandScene) -> Floats:
    """Bounds on how far joints move a shape's points, per m or rad, shape (m, p); 0: not moved."""
    hand, bodies, chain = scene.hand, scene.bodies, scene.hand.chain
    reach = np.zeros((len(bodies.links), len(hand.joint_names)))
    for body, link in enumerate(bodies.links):
        middle = bodies.poses[body, :, :3] @ bodies.boxes[body, :3] + bodies.poses[body, :, 3]
        length, at = float(np.linalg.norm(middle)) + bodies.boxes[body, 6], int(link)
        while chain.parents[at] >= 0:
            column = chain.columns[at]
            arm = length + float(np.linalg.norm(chain.positions[at]))
            if column >= 0:
                sliding = hand.chain.kinds[at] == SLIDES
                reach[body, column] += abs(chain.factors[at]) * (1.0 if sliding else arm)
            length += float(np.linalg.norm(chain.origins[at][:3, 3]))
            at = int(chain.parents[at])
    return reach


CONTACT_DISTANCE = 0.005
"""Gap up to which a link counts as touching [m]: published postures are off by millimetres."""

TOUCHED = 3e-4
"""Gap up to which a link counts as touching after the hand has closed [m]."""


@dataclass(frozen=True, eq=False, kw_only=True)
class HandContacts:
    """Contacts of a hand at k poses: at most one for each of its L links."""

    rule: ContactRule
    """Rule by which they were found."""
    poses: Floats
    """From the hand's frame to the mesh's [m], shape (k, 4, 4)."""
    posture: Floats
    """Values of the joints [rad or m], shape (k, p)."""
    points: Floats
    """Where each link touches the object's surface [m], shape (k, L, 3); nan: it does not."""
    normals: Floats
    """Mean unit normals into the object there, shape (k, L, 3)."""
    gap: Floats
    """Signed distance of the link's shapes from that point [m], shape (k, L)."""
    gaps: Floats
    """Signed distance of each link from the object [m], shape (k, L); inf: beyond twice the contact
    distance. A negative value is a depth: the larger of how deep points of the link are in the
    object and how deep points of the surface are in the link. It is found by local search: right
    within 0.1 mm or 2 % for all but 5 of 2,464 poses, for these too shallow by at most 0.4 mm.
    """
    self_collision: Ints
    """The two links that overlap most, shape (k, 2); -1: none."""
    self_depth: Floats
    """How deep these two overlap [m], shape (k,); 0: not at all."""
    table_depth: Floats
    """How deep the hand is in the table [m], shape (k,); <= 0: above; nan: no table."""

    __repr__ = short_repr

    @property
    def touching(self) -> Bools:
        """Whether each link touches, shape (k, L)."""
        return ~np.isnan(self.gap)

    def take(self, rows: Ints) -> "HandContacts":
        """The contacts of the chosen poses, in that order."""
        arrays: Any = {n: locked(one[rows]) for n, one in vars(self).items() if n != "rule"}
        return replace(self, **arrays)


def hand_contacts(
    mesh: "ObjectMesh",
    hand: ArticulatedHand,
    poses: ArrayLike,
    posture: ArrayLike,
    *,
    rule: ContactRule = "given",
    contact_distance: float = CONTACT_DISTANCE,
    table: Table | None = None,
) -> HandContacts:
    """Find the contacts of poses of a hand with joints.

    The object's triangles count, not its convex hull: a finger inside a mug is outside the object.
    A link has at most one contact: the mean of its points near the surface and of the normals
    there. On both sides of a thin edge, where normals cancel, only the nearest side counts. An open
    surface has no inside; there a link is as deep as the surface is in its shapes.

    Args:
        mesh: The object; its unit must be known.
        hand: The hand.
        poses: From the hand's frame to the mesh's, translations in metres, shape (k, 4, 4).
        posture: Values of the hand's joints, shape (k, p).
        rule: How poses become contacts; see `ContactRule`.
        contact_distance: Gap up to which a link touches [m].
        table: The table below the object, in the mesh's frame.

    Raises:
        SettingError: The mesh has no unit, the number of joint values is wrong, one is not finite,
            or a setting is outside its range.
        ContactError: A pose is not a rigid motion.
    """
    mesh.needs_metres(IN_METRES)
    check_choice("rule", rule, ContactRule)
    check_range("contact_distance", contact_distance, 0.0, 0.1, ends="(]", unit="m")
    matrices, values = checked_poses(poses), hand.postures(posture)
    if len(matrices) != len(values):
        raise SettingError(f"{len(matrices)} poses have {len(values)} postures: give one for each")
    if not len(hand.bodies.kinds):
        raise SettingError(f"{hand.name} has no collision geometry: nothing of it can touch")
    scene = HandScene(mesh, hand, contact_distance)
    if rule == "closed":
        opened = np.where(hand.closing != 0.0, hand.preshapes["open"], values)
        values = close(scene, matrices, opened)
    frames = scene.frames(matrices, values)
    touches = scene.touch(frames)
    gaps = scene.link_gaps(touches)
    if rule != "given":
        touches.contacts[gaps > TOUCHED] = np.nan
    depth, pairs = scene.overlaps(frames, scene.may_overlap)
    contacts = touches.contacts
    return HandContacts(
        rule=rule,
        poses=matrices,
        posture=values,
        points=contacts[..., :3],
        normals=contacts[..., 3:6],
        gap=contacts[..., 6],
        gaps=gaps,
        self_collision=pairs,
        self_depth=depth,
        table_depth=scene.table_depth(frames, table),
    )


LEAST_LINKS, DEEPEST = 2, 0.015
"""Fewest links that touch at a pose that fits, and how deep a link may be in the object [m]."""


def links_fit(mesh: "ObjectMesh", hand: ArticulatedHand, poses: Floats, posture: Floats) -> Bools:
    """Whether enough links touch at poses, and none is too deep in the object, shape (k,).

    Args:
        mesh: The object; its unit must be known.
        hand: The hand.
        poses: From the hand's frame to the mesh's [m], shape (k, 4, 4).
        posture: Values of its joints, shape (k, p).
    """
    scene = HandScene(mesh, hand, CONTACT_DISTANCE)
    frames = scene.frames(poses, hand.postures(posture))
    gaps = scene.link_gaps(scene.touch(frames, contacts=False, search=CONTACT_DISTANCE))
    touching = (gaps <= CONTACT_DISTANCE).sum(axis=1) >= LEAST_LINKS
    return np.asarray(touching & (gaps.min(axis=1) >= -DEEPEST))
