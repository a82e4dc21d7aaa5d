"""Contacts of a hand with joints: which of its links touch an object, where, and how far off."""

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
"""Poses that a thread takes at once."""


class HandScene:
    """A hand and an object for the kernels, in the frame of the mesh."""

    def __init__(self, mesh: "ObjectMesh", hand: ArticulatedHand, distance: float) -> None:
        """Prepare the surface, once for a mesh, and the hand, once for a hand.

        Args:
            mesh: The object.
            hand: The hand.
            distance: Contact distance [m].
        """
        self.hand, self.distance = hand, distance
        self.bodies, self.surface = hand.bodies, mesh.touched_surface

    def frames(self, poses: Floats, postures: Floats) -> Floats:
        """Frames of the links in that of the mesh [m], shape (k, L, 3, 4).

        Args:
            poses: Hand's frame to that of the mesh, translations in metres, shape (k, 4, 4).
            postures: Values of the joints, shape (k, p).
        """
        return np.ascontiguousarray(poses[:, None, :3] @ self.hand.link_poses(postures))

    def touch(
        self, frames: Floats, *, contacts: bool = True, search: float | None = None
    ) -> Touches:
        """Gaps up to a distance, and contacts unless they are not wanted."""
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
        """How deep the hand is in a table [m], shape (k,); nan without one."""
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
        """How deep the two links that overlap most do [m], (k,), and which they are (k, 2).

        Args:
            frames: As `frames` returns them.
            allowed: 1 for links that may overlap (L, L).
        """
        depths, pairs = np.zeros(len(frames)), np.full((len(frames), 2), -1)

        def run(rows: slice, _: object) -> None:
            self_overlaps(frames, rows.start, rows.stop, allowed, self.bodies, depths, pairs)

        in_threads(run, len(frames), CHUNK)
        return depths, pairs

    @cached_property
    def may_overlap(self) -> Ints:
        """1: two links are one, or next to each other, or overlap at the open preshape (L, L)."""
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

    All joints move at their speeds, together. A link that touches stops all joints that move it;
    others go on. Joints stop at their limits, and where two links of the hand meet those that move
    one of both alone.

    Args:
        scene: Hand and object.
        poses: Hand's frame to that of the mesh [m], shape (k, 4, 4).
        postures: From which they close, shape (k, p).

    Returns:
        Postures, shape (k, p).
    """
    hand, bodies, values = scene.hand, scene.bodies, postures.copy()
    speeds, limits, reach = hand.closing, hand.limits_of_joints, reaches(scene)
    moves = (reach > 0.0) & (speeds != 0.0)
    apart = scene.may_overlap[np.ix_(bodies.links, bodies.links)] == 0
    pairs = np.argwhere(np.triu(apart & (moves[:, None] != moves).any(axis=2))).copy(order="C")
    closing = Closing(speeds.copy(), limits.copy(), reach, _largest_steps(scene), pairs)
    matrices = np.array(poses, order="C")  # kernels are compiled for arrays that can be written to

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
    """Steps of shapes with which no links pass through each other unseen [m], shape (m,).

    Of two alike `overlaps` sees the way from touching to filling the same place, except its
    ends: both together move by three quarters of that. What is thinner than 3 mm, or than the
    thickest shape of its link, may pass.
    """
    steps = np.zeros(len(scene.hand.link_names))
    np.maximum.at(steps, scene.bodies.links, 0.75 * scene.hand.half_widths)
    return np.clip(steps[scene.bodies.links], SMALLEST_STEP, LARGEST_STEP)


def reaches(scene: HandScene) -> Floats:
    """Largest distance of a shape's points from each joint's axis, shape (m, p); 0: not moved."""
    hand, bodies, chain = scene.hand, scene.bodies, scene.hand.chain
    reach = np.zeros((len(bodies.links), len(hand.joint_names)))
    for body, link in enumerate(bodies.links):
        middle = bodies.poses[body, :, :3] @ bodies.boxes[body, :3] + bodies.poses[body, :, 3]
        length, at = float(np.linalg.norm(middle)) + bodies.boxes[body, 6], int(link)
        while chain.parents[at] >= 0:
            column = chain.columns[at]
            arm = length + float(np.linalg.norm(chain.positions[at]))
            if column >= 0:
                sliding = hand.chain.kinds[at] == 1
                reach[body, column] += abs(chain.factors[at]) * (1.0 if sliding else arm)
            length += float(np.linalg.norm(chain.origins[at][:3, 3]))
            at = int(chain.parents[at])
    return reach


CONTACT_DISTANCE = 0.005
"""Gap up to which a link counts as touching [m]: published postures are off by millimetres."""

TOUCHED = 3e-4
"""Gap up to which a link touches after the hand closed [m]."""


@dataclass(frozen=True, eq=False, kw_only=True)
class HandContacts:
    """What the links of a hand touch at k poses: one contact of each of its L links, or none."""

    rule: ContactRule
    """How they were found."""
    poses: Floats
    """Hand's frame to that of the mesh, (k, 4, 4) [m]."""
    posture: Floats
    """Values of the joints [rad or m], shape (k, p)."""
    points: Floats
    """Where each link touches the object's surface [m], shape (k, L, 3); nan: it does not."""
    normals: Floats
    """Mean unit normals into the object there, shape (k, L, 3)."""
    gap: Floats
    """Signed distance of the link's shapes from that point [m], shape (k, L)."""
    gaps: Floats
    """Signed distance of each link from the object [m], shape (k, L); inf: beyond twice the
    contact distance; negative: a depth, the larger of how far points of the link inside the object
    are from its surface, and how far points of the surface in the link are from the link's. Found
    by climbs: of 2,464 poses all but 5 within 0.1 mm or 2 %, these too shallow by 0.4 mm at most.
    """
    self_collision: Ints
    """The two links that overlap most, shape (k, 2); -1: none."""
    self_depth: Floats
    """How deep they overlap [m], shape (k,); 0: not at all."""
    table_depth: Floats
    """How deep the hand is in the table [m], shape (k,); <= 0: above; nan: no table."""

    __repr__ = short_repr

    @property
    def touching(self) -> Bools:
        """Whether each link touches, shape (k, L)."""
        return ~np.isnan(self.gap)

    def take(self, rows: Ints) -> "HandContacts":
        """Those of the chosen poses, in that order."""
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

    The object's triangles count, not its convex hull: a finger in a mug is outside. A link has one
    contact, the mean of its points near the surface and of the normals there, or, on both sides of
    a thin edge, where normals cancel, of those of the nearest side. An open surface has no inside:
    there a link penetrates as far as the surface is in its shapes.

    Args:
        mesh: The object; its unit must be known.
        hand: The hand.
        poses: Hand's frame to that of the mesh, translations in metres, shape (k, 4, 4).
        posture: Values of the hand's joints, shape (k, p).
        rule: Which contacts count; see `ContactRule`.
        contact_distance: Gap up to which a link touches [m].
        table: The table below the object, in the mesh's frame.

    Raises:
        SettingError: The mesh has no unit, poses are no rigid motions, values of joints are of
            another number or not finite, or a setting is outside its range.
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
"""Links that touch at a pose that fits, and how deep they may be in the object [m]."""


def links_fit(mesh: "ObjectMesh", hand: ArticulatedHand, poses: Floats, posture: Floats) -> Bools:
    """Whether some links touch at poses (k, 4, 4) [m], and none is too deep, shape (k,).

    Args:
        mesh: The object; its unit must be known.
        hand: The hand.
        poses: Hand's frame to that of the mesh.
        posture: Values of its joints, shape (k, p).
    """
    scene = HandScene(mesh, hand, CONTACT_DISTANCE)
    frames = scene.frames(poses, hand.postures(posture))
    gaps = scene.link_gaps(scene.touch(frames, contacts=False, search=CONTACT_DISTANCE))
    touching = (gaps <= CONTACT_DISTANCE).sum(axis=1) >= LEAST_LINKS
    return np.asarray(touching & (gaps.min(axis=1) >= -DEEPEST))
