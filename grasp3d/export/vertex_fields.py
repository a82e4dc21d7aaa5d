"""The fields of the vertices of a labelled surface, and the arrays of the surface itself."""

import math
from collections.abc import Callable
from dataclasses import replace
from operator import attrgetter

import numpy as np

from grasp3d.arrays import Bools, Bytes
from grasp3d.export.fields import AREA, LENGTH, XYZ, Array, Field
from grasp3d.export.grasp_fields import (
    APPROACH_MARGIN,
    CRITICAL_ANGLE,
    DECIDED,
    DEPTH,
    EPSILONS,
    FLOAT,
    FORCES,
    OPENING,
    of_part,
)
from grasp3d.hand.reach import Reachability
from grasp3d.quality.grip_forces import Resistance
from grasp3d.stability.label import COLORS
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.vertex_grasps import Reason

_COLORS = np.array([COLORS[label] for label in sorted(COLORS)], dtype=np.uint8)


def label_colors(labels: SurfaceLabels) -> Bytes:
    """Colour of each vertex by its label, red, green, blue, shape (V, 3)."""
    return _COLORS[labels.label]


def packed_bits(bits: Bools) -> Array:
    """Rows of at most 64 bits as numbers, shape (b,), the first bit being the lowest."""
    values = np.uint64(1) << np.arange(bits.shape[1], dtype=np.uint64)
    return np.asarray((bits * values).sum(axis=1, dtype=np.uint64))


def unpacked_bits(numbers: Array, count: int) -> Bools:
    """The lowest bits of numbers as rows, shape (b, count); see `packed_bits`."""
    bits = numbers.astype(np.uint64)[:, None] >> np.arange(count, dtype=np.uint64)
    return (bits & np.uint64(1)).astype(np.bool_)


def _located(number: int) -> Callable[[SurfaceLabels], Array | None]:
    """Located angles; None where the labels follow from the critical angles."""
    return lambda labels: None if labels.model.is_uniform else labels.located_angles[number]


def _pose(column: int) -> Callable[[SurfaceLabels], Array | None]:
    """An axis of the gripper's poses, or their origin."""
    return lambda labels: None if labels.reach is None else labels.reach.poses[:, :3, column]


def _free_angles(labels: SurfaceLabels) -> Array | None:
    """Free approach angles as bits; None: none are tested, as for three round tips and more."""
    free = None if labels.reach is None else labels.reach.free
    return None if free is None or not free.shape[1] else packed_bits(free)


def _posture(labels: SurfaceLabels) -> Array | None:
    posture = None if labels.reach is None else labels.reach.posture
    return None if posture is None or not posture.shape[1] else posture


def _partner(name: str, number: int) -> Callable[[SurfaceLabels], Array | None]:
    """Opposing contacts as surface points, of the best grasps over the worst or best normals."""

    def values(labels: SurfaceLabels) -> Array | None:
        points = labels.partner_points
        return None if points is None else np.asarray(getattr(points, name)[:, number])

    return values


def _names(codes: type[Reason | Reachability | Resistance]) -> tuple[str, ...]:
    return tuple(code.name.lower() for code in sorted(codes))


LOCATED = (
    replace(
        CRITICAL_ANGLE,
        name="located_angle",
        meaning="the smallest `critical_angle` that is sure, wherever the true contact points are; "
        "decides S. Where fingers differ it is relative to the worst finger",
        of=_located(0),
        when="errors",
        low=-math.pi,
        high=2.0 * math.pi,
    ),
    replace(
        CRITICAL_ANGLE,
        name="located_angle_best",
        meaning="the same for the best contact points and normals; decides U",
        of=_located(1),
        when="errors",
        low=-math.inf,
        high=math.inf,
    ),
)
PARTNERS = (
    Field(
        name="partners",
        meaning="the other contacts of the grasp",
        shape=("n-1", 3),
        unit=LENGTH,
        columns=tuple(f"partner_{{}}_{axis}" for axis in XYZ),
        each="partner_{}",
        unknown=True,
    ),
    Field(
        name="partner_normals",
        meaning="outward normals there",
        shape=("n-1", 3),
        columns=tuple(f"partner_{{}}_n{axis}" for axis in XYZ),
        each="partner_{}_normal",
        outward=True,
        unknown=True,
        low=-1.0,
        high=1.0,
    ),
)
POSES = (
    Field(
        name="approach",
        meaning="approach direction of the pose that the gripper reaches, the axis z of its "
        "[frame](guide/grippers.md#frame-and-shape)",
        shape=(3,),
        when="gripper",
        columns=tuple(f"approach_{axis}" for axis in XYZ),
        ply=FLOAT,
        unknown=True,
    ),
    Field(
        name="tcp",
        meaning="tool centre point, the origin of the pose",
        of=_pose(3),
        shape=(3,),
        unit=LENGTH,
        when="gripper",
        columns=tuple(f"tcp_{axis}" for axis in XYZ),
        unknown=True,
    ),
    Field(
        name="closing",
        meaning="closing axis, the axis x of the pose, from finger 1 to finger 2",
        of=_pose(0),
        shape=(3,),
        when="gripper",
        columns=tuple(f"closing_{axis}" for axis in XYZ),
        unknown=True,
    ),
    replace(APPROACH_MARGIN, of=None),
    DEPTH,
    replace(
        DEPTH,
        name="pregrasp_opening",
        meaning="opening before the fingers close",
        of=of_part("reach", "pregrasp_opening"),
    ),
)
RESTORING = (
    Field(
        name="canonical",
        meaning="the vertex that is used for its position, of those at the same position",
        of=attrgetter("mesh.canonical"),
        kind="i8",
        low=0,
    ),
    *(
        one
        for number, head, whose in (
            (0, "", "the grasp"),
            (1, "best_", "the grasp that is best over the best normals"),
        )
        for one in (
            Field(
                name=f"{head}partner_faces",
                meaning=f"faces of the other contacts of {whose}; `-1`: none",
                of=_partner("faces", number),
                kind="i8",
                shape=("n-1",),
                columns=(f"{head}partner_{{}}_face",),
                each=f"{head}partner_{{}}_face",
                low=-1,
            ),
            Field(
                name=f"{head}partner_weights",
                meaning="barycentric coordinates there",
                of=_partner("weights", number),
                shape=("n-1", 3),
                columns=tuple(f"{head}partner_{{}}_weight_{corner}" for corner in (1, 2, 3)),
                each=f"{head}partner_{{}}_weight",
                unknown=True,
            ),
        )
    ),
    Field(
        name="lateral",
        meaning="the axis y of the pose, the product of z and x",
        of=_pose(1),
        shape=(3,),
        when="gripper",
        columns=tuple(f"lateral_{axis}" for axis in XYZ),
        unknown=True,
    ),
    replace(
        DEPTH,
        name="held_opening",
        meaning="opening when the object is held",
        of=of_part("reach", "opening"),
    ),
    Field(
        name="reach_state",
        meaning="`reached`, or why the gripper does not reach the grasp",
        of=of_part("reach", "state"),
        kind="u1",
        when="gripper",
        texts=_names(Reachability),
    ),
    Field(
        name="free_angles",
        meaning="the approach angles that are free, as bits of a number; absent for three fingers "
        "and more whose tips alone are tested",
        of=_free_angles,
        kind="u8",
        when="gripper",
    ),
    Field(
        name="posture",
        meaning="values of the hand's further joints; in the metadata of Parquet",
        of=_posture,
        shape=("p",),
        when="joints",
        table=False,
        unknown=True,
    ),
    Field(
        name="resistance",
        meaning="whether forces can hold the load: why `grip_force` is infinite",
        of=of_part("holding", "resistance"),
        kind="u1",
        when="load",
        texts=_names(Resistance),
    ),
)
"""What makes labels that are read again complete."""

VERTICES = (
    Field(
        name="vertices",
        meaning="position",
        of=attrgetter("mesh.vertices"),
        shape=(3,),
        unit=LENGTH,
        columns=XYZ,
        ply="f8",
    ),
    Field(
        name="normal",
        meaning="outward normal; on creases and at corners the middle of the normals there; 0 "
        "where these cancel out",
        of=attrgetter("mesh.normals"),
        shape=(3,),
        columns=("nx", "ny", "nz"),
        ply=FLOAT,
        outward=True,
    ),
    Field(
        name="color",
        meaning="colour of the label: S `#009E73`, M `#F0E442`, U `#D55E00`",
        of=label_colors,
        kind="u1",
        shape=(3,),
        columns=("red", "green", "blue"),
        ply="u1",
        table=False,
    ),
    Field(
        name="area",
        meaning="area around the vertex, a third of its faces'",
        of=attrgetter("mesh.vertex_areas"),
        unit=AREA,
        array=False,
    ),
    *DECIDED,
    *EPSILONS,
    OPENING,
    Field(
        name="grip",
        meaning="two fingers: 1 for an external grasp, −1 for an internal one; 0: no grasp, and "
        "three fingers and more",
        kind="i1",
        low=-1,
        high=1,
    ),
    Field(
        name="reason",
        meaning="why there is no grasp, see [reasons](#reasons)",
        kind="u1",
        texts=_names(Reason),
    ),
    *LOCATED,
    *PARTNERS,
    *POSES,
    *FORCES,
    *RESTORING,
)
"""Every field of a vertex, in the order of files."""

FACES = Field(
    name="faces",
    meaning="vertices of the faces, counter-clockwise from outside",
    kind="i8",
    shape=("F", 3),
    low=0,
)
CORNERS = Field(
    name="corners",
    meaning="row of `corner_normals` of each corner of each face",
    of=attrgetter("corner_normals.corners"),
    kind="i8",
    shape=("F", 3),
    low=0,
)
CORNER_NORMALS = Field(
    name="corner_normals",
    meaning="outward normals of the faces at their corners, which differ across creases",
    of=attrgetter("corner_normals.normals"),
    shape=("C", 3),
    low=-1.0,
    high=1.0,
    outward=True,
)
SURFACE = (FACES, CORNERS, CORNER_NORMALS)
"""The arrays of a surface that are not of its vertices."""
