"""Grasps whose outcome contradicts their label, and what in their numbers may be the reason."""

import math
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from grasp3d.arrays import Bools, Bytes, Floats, Ints
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.hand.closed_jaws import MEANING as CLOSINGS
from grasp3d.hand.closed_jaws import Closing, Touch
from grasp3d.hand.hand import Hand
from grasp3d.stability.label import Label
from grasp3d.system.counts import short_number

Kind = Literal["failed", "held", "held_open"]

MEANING: dict[Kind, str] = {
    "failed": "failed, though S",
    "held": "held, though U",
    "held_open": "held, though the jaws do not close on the mesh",
}
"""Each kind in words, as shown to users."""

SMALL_AREA = 0.05
"""Fraction of a pad's area below which a contact is small: its patch resists no rolling."""

FAR_ARM = 0.25
"""Distance of the centre of mass from the line of the contacts, in object sizes, that is far."""

TIGHT = 0.003
"""Clearance of each finger below which small errors of the pose push the object [m]."""


@dataclass(frozen=True, eq=False)
class Numbers:
    """Numbers of k poses by which reasons are judged."""

    scores: Mapping[str, Floats]
    """By name, shape (k,) each; others are not known."""
    state: Bytes
    """`Closing` codes, shape (k,)."""
    touch: Bytes
    """`Touch` codes, shape (k, n)."""
    hand: Hand
    size: float
    """Size of the object [m]."""
    available: float | None
    """Force at hand of each finger [N]; None: not known."""
    friction: float
    """Coefficient of friction of the labels."""

    @classmethod
    def of(cls, poses: EvaluatedPoses, scores: Mapping[str, Floats]) -> "Numbers":
        """Those of evaluated poses and their scores."""
        return cls(
            scores=scores,
            state=poses.state,
            touch=poses.jaws.touch,
            hand=poses.hand,
            size=poses.mesh.size,
            available=None if poses.load_case is None else poses.load_case.available,
            friction=poses.model.nominal_friction,
        )

    def __getitem__(self, name: str) -> Floats:
        """A score, shape (k,); nan: not known."""
        return self.scores.get(name, np.full(len(self.state), math.nan))

    @property
    def small(self) -> Bools:
        """Where the smaller contact is small for the gripper, shape (k,)."""
        return self["contact_area"] < SMALL_AREA * self.hand.touch_area

    @property
    def clearance(self) -> Floats:
        """Room of each finger before the jaws close [m], shape (k,)."""
        return np.maximum(0.5 * (self.hand.max_opening - self["opening"]), 0.0)


@dataclass(frozen=True)
class Reason:
    """Why the outcome of a grasp may contradict its label, judged by its numbers."""

    name: str
    """In short, as in tables."""
    why: str
    """What it may have done."""
    kind: Kind
    found: Callable[[Numbers], Bools] = field(repr=False)
    """Of which poses it is a reason, shape (k,)."""
    value: Callable[[Numbers, int], str] | None = field(repr=False, default=None)
    """The number of a pose by which it is one, in words."""


def _length(name: str, digits: int = 3) -> Callable[[Numbers, int], str]:
    return lambda numbers, row: f"{1e3 * numbers[name][row]:.{digits}g} mm"


def _area(numbers: Numbers, row: int) -> str:
    return f"{1e6 * numbers['contact_area'][row]:.2g} mm²"


def _force(numbers: Numbers, row: int) -> str:
    needed, payload = numbers["grip_force"][row], numbers["payload"][row]
    force = "no force suffices" if math.isinf(needed) else f"{short_number(needed)} N"
    return f"{force}, {short_number(numbers.available or 0.0)} N at hand" + (
        "" if math.isnan(payload) else f", payload {short_number(payload)} kg"
    )


def _closing(state: Closing) -> Reason:
    return Reason(
        CLOSINGS[state],
        "pose, gripper or mesh differ from those of the attempt, or the object moved",
        "held_open", lambda numbers: np.asarray(numbers.state == state),
    )  # fmt: skip


REASONS = (
    Reason("contact on the pad's rim only", "it holds by a corner or an edge of the pad", "failed",
           lambda numbers: (numbers.touch == Touch.PAD_RIM).any(axis=1)),
    Reason("small contact", "the object can roll about it, which two points do not show", "failed",
           lambda numbers: numbers.small, _area),
    Reason("centre of mass far off the contacts", "the weight twists the object", "failed",
           lambda numbers: numbers["center_of_mass_distance"] > FAR_ARM * numbers.size,
           _length("center_of_mass_distance")),
    Reason("little room for the open gripper", "a small error of its pose pushes the object",
           "failed", lambda numbers: numbers.clearance < TIGHT,
           lambda numbers, row: f"{1e3 * numbers.clearance[row]:.2g} mm on each side"),
    Reason("not reachable", "the gripper of the attempt came otherwise, or is another one", "held",
           lambda numbers: numbers["reachable"] == 0.0),
    Reason("payload below the load", "the normals were better than the worst ones", "held",
           lambda numbers: numbers["grip_force"] > (numbers.available or math.inf), _force),
    Reason("small contact", "an edge or corner, whose mean normal says little", "held",
           lambda numbers: numbers.small, _area),
    Reason("friction", "the true one may be higher than that of the labels", "held",
           lambda numbers: (numbers["reachable"] != 0.0)
           & (numbers["critical_angle"] < math.pi / 2.0),
           lambda numbers, row: f"force-closed from {math.tan(numbers['critical_angle'][row]):.3g} "
           f"on, labels at {numbers.friction:.3g}"),
    *map(_closing, (state for state in Closing if state != Closing.CLOSED)),
    *(Reason("no visible cause", "dynamics, deformation, or a mesh that differs", kind,
             lambda numbers: np.zeros(len(numbers.state), bool)) for kind in ("failed", "held")),
)  # fmt: skip
"""All reasons; the last of a kind is that of grasps without another one."""


@dataclass(frozen=True)
class Cause:
    """A reason with the number of one grasp."""

    reason: Reason
    value: str

    def __str__(self) -> str:
        number = f" ({self.value})" if self.value else ""
        return f"{self.reason.name}{number}: {self.reason.why}"


@dataclass(frozen=True)
class ReasonCount:
    """Of how many grasps that contradict their label something may be the reason."""

    reason: Reason
    count: int
    of: int
    """All grasps of this kind; one may have several reasons."""


@dataclass(frozen=True, eq=False)
class Disagreement:
    """A grasp whose outcome contradicts its label."""

    kind: Kind
    row: int
    """Its row in the table of grasps, from 0."""
    margin: float
    """[rad]; nan: the jaws do not close."""
    causes: tuple[Cause, ...]
    """Likely reasons, judged by its numbers."""


@dataclass
class Disagreements:
    """How often there is each reason, and the greatest disagreements among the grasps so far."""

    most: int
    """Most disagreements of each kind that are kept, beside the greatest with each reason."""
    greatest: dict[Kind | Reason, list[Disagreement]] = field(
        default_factory=lambda: {key: [] for key in (*MEANING, *REASONS)}
    )
    counts: Counter[Reason] = field(default_factory=Counter)
    totals: Counter[Kind] = field(default_factory=Counter)

    def add(self, poses: EvaluatedPoses, scores: Mapping[str, Floats], rows: Ints) -> None:
        """Add the disagreements among some poses.

        Args:
            poses: Evaluated poses with outcomes.
            scores: Their scores.
            rows: Their rows in the table of grasps, shape (k,).
        """
        numbers = Numbers.of(poses, scores)
        for kind, mask in _contradicting(poses).items():
            reasons = reasons_of(numbers, kind)
            self.totals[kind] += int(mask.sum())
            self.counts.update({each: int((of & mask).sum()) for each, of in reasons.items()})
            # Jaws that do not close have no margin: the first ones are as good as any.
            keys = np.nan_to_num(poses.margin) * (-1.0 if kind == "failed" else 1.0)
            masks: list[tuple[Kind | Reason, Bools]] = [(kind, mask), *reasons.items()]
            for key, own in masks:
                most = self.most if key == kind else min(self.most, 1)
                found = np.flatnonzero(own & mask)
                new = [
                    Disagreement(
                        kind,
                        int(rows[row]),
                        float(numbers["margin"][row]),
                        causes_of(numbers, reasons, row),
                    )
                    for row in found[np.argsort(keys[found], kind="stable")][:most].tolist()
                ]
                self.greatest[key] = sorted([*self.greatest[key], *new], key=_order)[:most]

    def all(self) -> tuple[Disagreement, ...]:
        """All kept disagreements, the greatest of each kind first."""
        kept = {one.row: one for each in self.greatest.values() for one in each}
        of = [[one for one in kept.values() if one.kind == kind] for kind in MEANING]
        return tuple(one for each in of for one in sorted(each, key=_order))

    def reasons(self) -> tuple[ReasonCount, ...]:
        """How often there is each reason, of each kind the most frequent first."""
        return tuple(
            ReasonCount(reason, count, self.totals[kind])
            for kind in MEANING
            for reason, count in self.counts.most_common()
            if reason.kind == kind and count
        )


def _contradicting(poses: EvaluatedPoses) -> dict[Kind, Bools]:
    """Which poses are of each kind, shape (k,)."""
    held, closed = poses.outcome == 1.0, poses.jaws.closed
    return {
        "failed": ~held & (poses.label == Label.S),
        "held": held & closed & (poses.label == Label.U),
        "held_open": held & ~closed,
    }


def reasons_of(numbers: Numbers, kind: Kind) -> dict[Reason, Bools]:
    """Of which poses each reason of a kind is one, shape (k,).

    Args:
        numbers: Their numbers.
        kind: The kind.
    """
    found = {reason: reason.found(numbers) for reason in REASONS if reason.kind == kind}
    *_, last = found
    if kind != "held_open":
        found[last] = ~np.any(list(found.values()), axis=0)
    return found


def causes_of(numbers: Numbers, reasons: Mapping[Reason, Bools], row: int) -> tuple[Cause, ...]:
    """Likely reasons of one pose, with its numbers."""
    return tuple(
        Cause(reason, reason.value(numbers, row) if reason.value else "")
        for reason, mask in reasons.items()
        if mask[row]
    )


def _order(one: Disagreement) -> tuple[float, int]:
    if one.kind == "held_open":
        return 0.0, one.row
    return (-one.margin if one.kind == "failed" else one.margin), one.row
