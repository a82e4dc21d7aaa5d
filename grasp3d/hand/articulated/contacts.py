"""Contacts of a hand with joints: which of its links touch an object, where, and how far off."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from grasp3d._kernels.hands.touching import MOST, Touches, make_touch_scratch, touch
from grasp3d.arrays import ArrayLike, Floats, Ints, short_repr
from grasp3d.errors import SettingError
from grasp3d.hand.articulated.articulated_hand import ArticulatedHand
from grasp3d.hand.articulated.link_bodies import reach_along
from grasp3d.hand.choices import ObjectMotion
from grasp3d.hand.jaws import metres_per_unit
from grasp3d.hand.pose_checks import checked_poses
from grasp3d.hand.table import Table
from grasp3d.settings.checks import check_choice, check_range
from grasp3d.system.context import thread_count

if TYPE_CHECKING:
    from grasp3d.mesh import ObjectMesh

Rule = Literal["given", "settled", "closed"]
"""Which contacts count: those of the poses as given; after the smallest change with which near
links touch and none penetrates; or after closing from a preshape."""

CONTACT_DISTANCE = 0.005
"""Gap up to which a link counts as touching [m]: published postures are off by millimetres."""

SEARCH = 2.0
"""Largest gap that is measured, in contact distances."""

CHUNK = 16
"""Poses that a thread takes at once."""


@dataclass(frozen=True, eq=False, kw_only=True)
class HandContacts:
    """Contacts of k poses of a hand of L links, by ascending pose, c in all."""

    rule: Rule
    """How they were found."""
    poses: Floats
    """Hand's frame to that of the mesh, (k, 4, 4) [mesh unit]; of settled ones where the object
    moved relative to it."""
    posture: Floats
    """Values of the joints [rad or m], shape (k, p)."""
    row: Ints
    """Pose of each contact, shape (c,)."""
    link: Ints
    """Its link, shape (c,)."""
    points: Floats
    """Where it is on the object's surface [mesh unit], shape (c, 3)."""
    normals: Floats
    """Unit normals into the object, shape (c, 3)."""
    gap: Floats
    """Signed distance of the link's shapes from that point [mesh unit], shape (c,)."""
    gaps: Floats
    """Signed distance of each link from the object [mesh unit], shape (k, L); inf: beyond twice the
    contact distance; negative: how deep the link is in the object, or the object in the link."""
    self_collision: Ints
    """The two links that overlap most, shape (k, 2); -1: none."""
    self_depth: Floats
    """How deep they overlap [mesh unit], shape (k,); 0: not at all."""
    table_depth: Floats
    """How deep the hand is in the table [mesh unit], shape (k,); <= 0: above; nan: no table."""
    change: Floats
    """Largest change of a joint by the rule [rad or m], shape (k,)."""
    shift: Floats
    """How far the object moved [mesh unit], shape (k,)."""
    turn: Floats
    """How far it turned [rad], shape (k,)."""

    __repr__ = short_repr


def hand_contacts(
    mesh: "ObjectMesh",
    hand: ArticulatedHand,
    poses: ArrayLike,
    posture: ArrayLike,
    *,
    rule: Rule = "given",
    contact_distance: float = CONTACT_DISTANCE,
    table: Table | None = None,
    object_motion: ObjectMotion = "free",
    preshape: str = "open",
) -> HandContacts:
    """Find the contacts of poses of a hand with joints.

    The object's triangles count, not its convex hull: a finger in a mug is outside. A link touches
    each side of an edge with a contact of its own: its points near the surface are divided by the
    normal of the surface, and averaged per side. An open surface has no inside: there a link
    penetrates as far as the surface is in its shapes.

    Args:
        mesh: The object; its unit must be known.
        hand: The hand.
        poses: Hand's frame to that of the mesh, translations in its unit, shape (k, 4, 4).
        posture: Values of the hand's joints, shape (k, p).
        rule: Which contacts count; see `Rule`.
        contact_distance: Gap up to which a link touches [m].
        table: The table below the object, in the mesh's frame.
        object_motion: Whether the object gives way when contacts settle.
        preshape: Posture from which the hand closes, of `hand.preshapes`.

    Raises:
        SettingError: The mesh has no unit, poses are no rigid motions, values of joints are of
            another number or not finite, or a setting is outside its range.
    """
    metres = metres_per_unit(mesh)
    check_choice("rule", rule, Rule)
    check_range("contact_distance", contact_distance, 0.0, 0.1, ends="(]", unit="m")
    matrices, values = checked_poses(poses), hand.postures(posture)
    check_choice("object motion", object_motion, ObjectMotion)
    if preshape not in hand.preshapes:
        raise SettingError(
            f"{hand.name} has no preshape {preshape!r}; known: {', '.join(hand.preshapes)}"
        )
    if rule != "given":
        raise SettingError(f"contacts of rule {rule} are not found yet; take 'given'")
    if len(matrices) != len(values):
        raise SettingError(f"{len(matrices)} poses have {len(values)} postures: give one for each")
    return Scene(mesh, hand, metres, contact_distance, table).contacts(rule, matrices, values)


class Scene:
    """A hand and an object for the kernels, in metres in the frame of the mesh."""

    def __init__(
        self,
        mesh: "ObjectMesh",
        hand: ArticulatedHand,
        metres: float,
        distance: float,
        table: Table | None,
    ) -> None:
        self.hand, self.metres, self.distance, self.table = hand, metres, distance, table
        self.bodies, self.surface = hand.bodies, mesh.touched_surface

    def frames(self, poses: Floats, postures: Floats) -> Floats:
        """Frames of the links in that of the mesh [m], shape (k, L, 3, 4)."""
        base = poses[:, None, :3].copy()
        base[..., 3] *= self.metres
        return np.ascontiguousarray(base @ self.hand.link_poses(postures))

    def touch(self, frames: Floats, *, contacts: bool = True) -> Touches:
        """Gaps, and contacts unless they are not wanted."""
        count, links, shapes = len(frames), frames.shape[1], len(self.bodies.kinds)
        listed = links if contacts else 0
        touches = Touches(
            gaps=np.full((count, shapes), np.inf),
            points=np.zeros((count, shapes, 3)),
            directions=np.zeros((count, shapes, 3)),
            counts=np.zeros((count, listed), dtype=np.int64),
            contacts=np.zeros((count, listed, MOST, 7)),
        )
        starts = range(0, count, CHUNK)
        threads = max(1, min(thread_count(), len(starts)))

        def run(number: int) -> None:
            scratch = make_touch_scratch(self.bodies)
            for start in starts[number::threads]:
                touch(
                    frames, self.distance, SEARCH * self.distance, start,
                    min(start + CHUNK, count), self.bodies, self.surface, touches, scratch,
                )  # fmt: skip

        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(run, range(threads)))
        return touches

    def link_gaps(self, touches: Touches) -> Floats:
        """Signed distance of each link [m], shape (k, L)."""
        gaps = np.full((len(touches.gaps), len(self.hand.link_names)), np.inf)
        np.minimum.at(gaps.T, self.bodies.links, touches.gaps.T)
        return gaps

    def table_depth(self, frames: Floats) -> Floats:
        """How deep the hand is in the table [m], shape (k,); nan without one."""
        if self.table is None:
            return np.full(len(frames), np.nan)
        lowest = np.full(len(frames), np.inf)
        for body, link in enumerate(self.bodies.links):
            placed = frames[:, link, :, :3] @ self.bodies.poses[body]
            placed[..., 3] += frames[:, link, :, 3]
            up = self.table.normal @ placed  # (k, 4), in the body's frame
            lowest = np.minimum(lowest, up[:, 3] - reach_along(self.bodies, body, -up[:, :3]))
        return self.table.offset * self.metres - lowest

    def contacts(self, rule: Rule, poses: Floats, postures: Floats) -> HandContacts:
        """The result of a rule in the unit of the mesh."""
        frames = self.frames(poses, postures)
        touches = self.touch(frames)
        listed = np.arange(MOST) < touches.counts[:, :, None]
        row, link, _ = np.nonzero(listed)
        contacts = touches.contacts[listed]
        count = len(poses)
        return HandContacts(
            rule=rule,
            poses=poses,
            posture=postures,
            row=row,
            link=link,
            points=contacts[:, :3] / self.metres,
            normals=contacts[:, 3:6],
            gap=contacts[:, 6] / self.metres,
            gaps=self.link_gaps(touches) / self.metres,
            self_collision=np.full((count, 2), -1),
            self_depth=np.zeros(count),
            table_depth=self.table_depth(frames) / self.metres,
            change=np.zeros(count),
            shift=np.zeros(count),
            turn=np.zeros(count),
        )
