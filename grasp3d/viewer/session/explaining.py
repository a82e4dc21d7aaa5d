"""Why a vertex is S, M, U or not searched: one sentence, with the numbers that decide."""

import math
from dataclasses import dataclass
from functools import partial

from grasp3d.settings import GraspModel
from grasp3d.stability.label import Label, Mode
from grasp3d.stability.thresholds import unstable_from
from grasp3d.surface.labels import Reason
from grasp3d.viewer.session.painting import UNSEARCHED

SAME = 1e-4
"""Angles that are one, as a file may have 32 bits only [rad]."""

DIGITS = 4
"""Most digits that are told of an angle to keep it apart from a limit."""

PAIR = 2
FINGERS = ("first", "second", "third", "fourth", "fifth")
"""What fingers are called; the first is the vertex."""


@dataclass(frozen=True)
class Case:
    """What decides on one vertex."""

    model: GraspModel
    mode: Mode
    code: int
    """Label, or `UNSEARCHED`."""
    worst: float
    """Critical friction angle over the worst normals [rad]; inf: no grasp."""
    best: float
    """Over the best."""
    cone: float
    """How far grasps were searched [rad]."""
    reason: Reason | None
    """Why there is no grasp; None: nothing tells."""
    off_line: tuple[float, float] | None
    """Two fingers: angles of their normals to the line between them [rad]."""
    creases: tuple[int, ...] = ()
    """Fingers of the grasp that are known to be on creases, from 0."""

    @property
    def smooth(self) -> bool:
        """Whether every finger has one normal, as far as the angles tell."""
        return self.worst - self.best < SAME

    @property
    def stable(self) -> float:
        """Angle below which a grasp is S [rad]."""
        return self.model.friction_angle - self.model.tilt

    @property
    def reach(self) -> float:
        """Angle from which a grasp is U, unless it has three fingers and more [rad]."""
        return self.model.friction_angle + self.model.tilt

    @property
    def never_unstable(self) -> bool:
        """Whether no grasp of so many fingers is surely unstable at this reach."""
        angles = self.model.friction_angle, self.model.tilt
        return math.isinf(float(unstable_from(*angles, self.model.fingers)))


def explain(case: Case) -> str:
    """Say why, in one sentence that begins with the letter."""
    if case.code == UNSEARCHED:
        return _unsearched(case)
    if math.isinf(case.best):
        return f"U: {_no_grasp(case)}."
    by_label = {Label.S: _stable, Label.M: _ambiguous, Label.U: _unstable}
    label = Label(case.code)
    return f"{label.name}: {by_label[label](case)}."


def told(angle: float, limit: float = math.nan) -> str:
    """An angle in degrees, with as many digits as keep it apart from a limit."""
    one, other = math.degrees(angle), math.degrees(limit)
    for digits in range(1, DIGITS):
        if f"{one:.{digits}f}" != f"{other:.{digits}f}" or one == other:
            return f"{_signed(one, digits)}°"
    return f"{_signed(one, DIGITS)}°"


def _signed(value: float, digits: int) -> str:
    """A number with a minus sign as long as a plus."""
    return f"{value:.{digits}f}".replace("-", "−")


def _sure(case: Case) -> str:
    return _limit(case, case.stable, "−")


def _possible(case: Case) -> str:
    return _limit(case, case.reach, "+")


def _limit(case: Case, limit: float, sign: str) -> str:
    beta, tilt = case.model.friction_angle, case.model.tilt
    show = partial(told, limit=case.worst if sign == "−" else case.best)
    if tilt == 0.0:
        return f"β = {show(limit)}"
    return f"{told(beta)} {sign} {told(tilt)} = {show(limit)}"


def _what(case: Case, limit: float) -> str:
    """What decides where every finger has one normal: that of a finger, or all of the grasp."""
    line, angle = case.off_line, told(case.worst, limit)
    if line is None or abs(max(line) - case.worst) >= SAME:
        return f"the grasp closes from a friction angle β* of {angle} on"
    if abs(line[0] - line[1]) < SAME:
        return f"both fingers' normals are {angle} off the line of the fingers"
    finger = FINGERS[line.index(max(line))]
    return f"the {finger} finger's normal is {angle} off the line of the fingers"


def _crease(case: Case) -> str:
    """Which fingers may have which normals."""
    names = [FINGERS[finger] for finger in case.creases]
    if not names:
        return "at a crease a finger may have any normal between those of its faces"
    if len(names) == 1:
        return (
            f"the {names[0]} finger is on a crease and may have any normal between those of its "
            "faces"
        )
    who = f"the {', '.join(names[:-1])} and {names[-1]} fingers"
    if len(names) == case.model.fingers == PAIR:
        who = "both fingers"
    return f"{who} are on creases and may have any normals between those of their faces"


def _stable(case: Case) -> str:
    angle = told(case.worst, case.stable)
    what = _what(case, case.stable)
    if not case.smooth:
        what = f"{_crease(case)}; with the worst of them β* is {angle}"
    elif " off the line " in what:
        what = f"no finger's normal is more than {angle} off the line of the fingers"
    return (
        f"{what}, below {_sure(case)}: it holds whatever the true "
        "normals within the sensor's resolution"
    )


def _unstable(case: Case) -> str:
    who = "the best grasp found" if case.mode == "label" else "the grasp"
    needs = f"{who} needs a friction angle above {told(case.best, case.reach)}"
    if not case.smooth:
        where = "the first finger's crease" if 0 in case.creases else "a crease"
        needs += f" even with the best normals of {where}"
    if case.model.tilt == 0.0:
        return f"{needs}, and the friction allows no more than {_possible(case)}"
    return f"{needs}, and no normal within the resolution allows more than {_possible(case)}"


def _ambiguous(case: Case) -> str:
    sure = f"surely stable below {_sure(case)}"
    if case.stable <= 0.0:
        sure = f"no grasp is surely stable at this resolution, as {_sure(case)} is not above 0°"
    unstable = f"surely unstable from {_possible(case)} on"
    if case.never_unstable:
        unstable = (
            f"no grasp of so many fingers is surely unstable, as {_possible(case)} is not below 90°"
        )
    if case.smooth:
        nearer = min((case.stable, case.reach), key=lambda limit: abs(limit - case.worst))
        return f"{_what(case, nearer)}: {sure}, {unstable}"
    worst = "not bounded" if math.isinf(case.worst) else told(case.worst, case.stable)
    best = told(case.best, case.reach)
    return (
        f"{_crease(case)}: β* is {worst} with the worst and {best} with the best of them; "
        f"{sure}, {unstable}"
    )


def _unsearched(case: Case) -> str:
    found = ""
    if math.isfinite(case.worst):
        found = f", and the best of them has β* {told(case.worst)}"
    return (
        f"Not searched: grasps were searched up to β* {told(case.cone)}{found}; "
        f"{_possible(case)} goes beyond."
    )


def _no_grasp(case: Case) -> str:
    other = "the second finger" if case.model.fingers == PAIR else "the other fingers"
    limits = "openings" if case.model.fingers == PAIR else "distances"
    cone = f"within the {told(case.cone)} that were searched"
    reasons = {
        Reason.OPENING: f"every place for {other} is outside the limits of {limits}",
        Reason.OFF_SURFACE: "no grasp, as the vertex belongs to no face",
        Reason.SAME_PLACE: "no grasp, as a fixed finger stands here",
        Reason.NO_PARTNER: f"no place for {other} was found {cone}",
    }
    return reasons.get(
        case.reason or Reason.FOUND,
        f"no place for {other} was found {cone} and the limits of {limits}",
    )
