"""The fields of grasps: those that vertices have too, and those of tables of grasps and poses."""

import math
from collections.abc import Callable
from dataclasses import replace
from operator import attrgetter
from typing import Any

import numpy as np

from grasp3d.export.fields import AREA, KILOGRAMS, LENGTH, LETTERS, NEWTONS, RADIANS, Array, Field
from grasp3d.hand.closed_jaws import Closing, Touch

FLOAT = "f4"
"""Type of most numbers in a PLY."""


def of_part(part: str, name: str) -> Callable[[Any], Array | None]:
    """The values of an attribute that labels or grasps may lack; None where they do."""

    def values(holder: Any) -> Array | None:
        found = getattr(holder, part)
        return None if found is None else getattr(found, name)

    return values


def _payload(holder: Any) -> Array | None:
    held = holder.holding
    return held.payload if held is not None and held.has_payload else None


LABEL = Field(name="label", meaning="the label S, M or U", kind="u1", ply="u1", texts=LETTERS)
CRITICAL_ANGLE = Field(
    name="critical_angle",
    meaning="critical friction angle of the grasp, over the worst normals of its contacts; decides "
    "S; `inf`: no grasp",
    unit=RADIANS,
    ply=FLOAT,
    low=0.0,
    high=math.pi,
    infinite=math.inf,
)
CRITICAL_ANGLE_BEST = replace(
    CRITICAL_ANGLE,
    name="critical_angle_best",
    meaning="the same over the best normals; decides U; different on creases, and where contact "
    "locations are uncertain: there that of the best aligned grasp",
)
MAX_RESOLUTION = Field(
    name="max_resolution",
    meaning="sensor resolution below which the grasp is S, at the friction and the other errors of "
    "the settings; `0`: none",
    unit=RADIANS,
    ply=FLOAT,
    low=0.0,
    high=math.pi,
)
MARGIN = Field(
    name="margin",
    meaning=r"angle by which the grasp is S: $\beta - \alpha/2 - \beta^*$, less what all other "
    "uncertainties take; S where it is above 0; `-inf`: no grasp",
    unit=RADIANS,
    ply=FLOAT,
    infinite=-math.inf,
)
EPSILON = Field(
    name="epsilon",
    meaning=r"$\varepsilon$ at the nominal normals, a lower bound; `nan`: no grasp",
    ply=FLOAT,
    low=0.0,
    unknown=True,
)
EPSILON_MIN = replace(
    EPSILON,
    name="epsilon_min",
    meaning=r"smallest $\varepsilon$ over all tilts of the normals; how it is computed is a "
    "[setting](#settings)",
)
EPSILON_MAX = replace(EPSILON, name="epsilon_max", meaning="bound on the largest")
DECIDED = (LABEL, CRITICAL_ANGLE, CRITICAL_ANGLE_BEST, MAX_RESOLUTION, MARGIN)
EPSILONS = (EPSILON, EPSILON_MIN, EPSILON_MAX)
OPENING = Field(
    name="opening",
    meaning="largest distance between any two contacts of the grasp",
    unit=LENGTH,
    low=0.0,
    unknown=True,
)
APPROACH_MARGIN = Field(
    name="approach_margin",
    meaning="by how much the approach may turn about the closing axis either way",
    of=of_part("reach", "approach_margin"),
    unit=RADIANS,
    when="gripper",
    ply=FLOAT,
    low=0.0,
    high=math.pi,
    unknown=True,
)
DEPTH = Field(
    name="depth",
    meaning="how far the fingertips reach beyond the contacts along the approach",
    of=of_part("reach", "depth"),
    unit=LENGTH,
    when="gripper",
    unknown=True,
)
GRIP_FORCE = Field(
    name="grip_force",
    meaning="force of each finger, along its contact's normal, that holds the load at the nominal "
    "normals; for 1 kg where no mass is given; `inf`: no force does, `nan`: no grasp",
    of=of_part("holding", "grip_force"),
    unit=NEWTONS,
    when="load",
    ply=FLOAT,
    low=0.0,
    infinite=math.inf,
    unknown=True,
)
FORCES = (
    GRIP_FORCE,
    replace(
        GRIP_FORCE,
        name="grip_force_least",
        meaning="the same at the best normals that the sensor cannot distinguish; how it is known "
        "is a [setting](#settings)",
        of=of_part("holding", "grip_force_least"),
    ),
    replace(
        GRIP_FORCE,
        name="grip_force_largest",
        meaning="the same at the worst of these normals",
        of=of_part("holding", "grip_force_largest"),
    ),
    replace(
        GRIP_FORCE,
        name="payload",
        meaning="mass that the force at hand holds at the worst normals; `nan`: no grasp. Absent "
        "where no force is at hand, or the task does not depend on the mass",
        of=_payload,
        unit=KILOGRAMS,
    ),
    replace(
        LABEL,
        name="label_with_force",
        meaning="the label with the force at hand: S: the load is held at all these normals, U: at "
        "none, or there is no grasp, M: the sensor cannot decide. Absent where the mass or the "
        "force is not known",
        of=of_part("holding", "label"),
        when="load",
    ),
)
"""What a load adds to grasps."""

CLOSED = (
    Field(
        name="closed_label",
        meaning="`label` at what the jaws touch when they close on the object, which is free: that "
        "of `grasp3d evaluate`. Empty: not known, as for internal grasps",
        of=of_part("closed", "label"),
        kind="i8",
        when="gripper",
        texts=(*LETTERS, ""),
    ),
    replace(
        MARGIN,
        name="closed_margin",
        meaning="`margin` there; empty also where the jaws do not close",
        of=of_part("closed", "margin"),
        when="gripper",
        unknown=True,
    ),
)
"""What the closed jaws of a gripper make of grasps that were found."""

GRASPS = (
    Field(name="grasp", meaning="number, from 1", of=lambda one: range(1, one.size + 1), kind="i8"),
    *DECIDED,
    *EPSILONS,
    Field(name="rank", meaning="dimension of the span of the wrenches", kind="i8"),
    OPENING,
    replace(OPENING, name="separation", meaning="smallest distance between any two contacts"),
    *CLOSED,
    *FORCES,
)
"""Grasps in tables."""

CONTACTS = (
    Field(
        name="point",
        meaning="contact point on the surface",
        of=attrgetter("contacts.points"),
        shape=("n", 3),
        unit=LENGTH,
        columns=("x", "y", "z"),
    ),
    Field(
        name="normal",
        meaning="outward normal there",
        of=attrgetter("contacts.normals"),
        shape=("n", 3),
        columns=("nx", "ny", "nz"),
        outward=True,
    ),
    Field(
        name="distance",
        meaning="distance from the surface before the contact was moved there",
        shape=("n",),
        unit=LENGTH,
    ),
    Field(
        name="on_crease",
        meaning="whether the contact is on a crease or at a corner",
        of=attrgetter("contacts.on_crease"),
        kind="?",
        shape=("n",),
    ),
)
"""The contacts of grasps in tables."""

FOUND_POSES = (
    *DECIDED,
    *EPSILONS,
    APPROACH_MARGIN,
    DEPTH,
    replace(CONTACTS[0], name="contacts"),
    replace(CONTACTS[1], name="normals", meaning="normal into the object there", outward=False),
    *CLOSED,
    *FORCES,
)
"""Poses of grasps that were found."""


def _jaw(name: str, number: int) -> Callable[[Any], Array]:
    """What is at one of the jaws."""
    return lambda poses: np.asarray(getattr(poses.jaws, name)[:, number])


_TOUCHES = tuple(touch.name.lower() for touch in sorted(Touch))


def given_poses(fingers: int = 2) -> tuple[Field, ...]:
    """Given poses that were evaluated, of a hand with so many fingers."""
    return (
        Field(
            name="closing",
            meaning="`closed`; `nothing`: the jaws close on nothing; `one_side`: only one jaw "
            "touches; `starts_inside`: a finger starts in the object; `slips_out`: the object "
            "slides out of the closing jaws",
            of=attrgetter("state"),
            kind="u1",
            texts=tuple(state.name.lower() for state in sorted(Closing)),
        ),
        *(field for field in DECIDED if field is not CRITICAL_ANGLE_BEST),
        *EPSILONS,
        Field(
            name="collides",
            meaning="whether the gripper collides with object or table, at the grasp, before "
            "closing, or on its approach",
            kind="?",
        ),
        Field(
            name="reachable",
            meaning="closed, without collision, within the stroke and the allowed directions",
            kind="?",
        ),
        *(
            Field(
                name=f"area{number + 1}",
                meaning=f"area of the patch that jaw {number + 1} touches",
                of=_jaw("area", number),
                unit=AREA,
            )
            for number in range(fingers)
        ),
        *(
            Field(
                name=f"touch{number + 1}",
                meaning=f"what jaw {number + 1} touches: `face`, `edge` (a strip), `point`, "
                "`pad_rim` (a small patch or a strip at the rim of the pad), `nothing`",
                of=_jaw("touch", number),
                kind="u1",
                texts=_TOUCHES,
            )
            for number in range(fingers)
        ),
        Field(
            name="apart",
            meaning="whether the patches do not overlap, seen along the closing axis, as where the "
            "jaws touch at different heights",
            of=attrgetter("jaws.apart"),
            kind="?",
        ),
        Field(
            name="turn",
            meaning="angle by which a free object has turned between the jaws",
            of=attrgetter("jaws.turn"),
            unit=RADIANS,
        ),
        *FORCES,
    )
