"""A hand with joints and an object in one frame: where its links are, and what they touch."""

from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from grasp3d._kernels.hands.overlaps import OVERLAPS, self_overlaps
from grasp3d._kernels.hands.touching import Touches, make_touch_scratch, touch
from grasp3d.arrays import Floats, Ints
from grasp3d.hand.articulated.articulated_hand import ArticulatedHand
from grasp3d.hand.articulated.link_bodies import reach_along
from grasp3d.hand.table import Table
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
        for body, link in enumerate(self.bodies.links):
            pose = frames[:, link, :, :3] @ self.bodies.poses[body]
            pose[..., 3] += frames[:, link, :, 3]
            up = table.normal @ pose  # (k, 4), in the body's frame
            lowest = np.minimum(lowest, up[:, 3] - reach_along(self.bodies, body, -up[:, :3]))
        return np.asarray(table.offset - lowest)

    def self_collisions(self, frames: Floats) -> tuple[Floats, Ints]:
        """How deep the two links that overlap most do [m], (k,), and which they are (k, 2)."""
        return self.overlaps(frames, self.may_overlap)

    def overlaps(self, frames: Floats, allowed: Ints) -> tuple[Floats, Ints]:
        """As `self_collisions`, with 1 for links that may overlap (L, L)."""
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
