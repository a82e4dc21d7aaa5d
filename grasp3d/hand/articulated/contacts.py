"""Contacts of a hand with joints: which of its links touch an object, where, and how far off."""

from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from grasp3d.arrays import ArrayLike, Bools, Floats, Ints, locked, short_repr
from grasp3d.errors import SettingError
from grasp3d.hand.articulated.articulated_hand import ArticulatedHand
from grasp3d.hand.articulated.closing import close
from grasp3d.hand.articulated.hand_scene import HandScene
from grasp3d.hand.choices import ContactRule
from grasp3d.hand.jaws import IN_METRES
from grasp3d.hand.pose_checks import checked_poses
from grasp3d.hand.table import Table
from grasp3d.settings.checks import check_choice, check_range

if TYPE_CHECKING:
    from grasp3d.mesh import ObjectMesh

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
        names = {field.name for field in fields(self)} - {"rule"}
        changed: dict[str, Any] = {name: locked(getattr(self, name)[rows]) for name in names}
        return replace(self, **changed)


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
    depth, pairs = scene.self_collisions(frames)
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
