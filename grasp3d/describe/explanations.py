"""A grasp in words: its numbers, why its vertex has its label, and why there is none.

Verdicts, reports, tables and the viewer use these texts.
"""

import math
from dataclasses import dataclass
from enum import StrEnum
from functools import partial

import numpy as np

from grasp3d.arrays import Bools, Floats
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.hand.reach import Reachability
from grasp3d.mesh import ObjectMesh
from grasp3d.quality.grip_forces import Resistance
from grasp3d.settings import GraspModel
from grasp3d.stability.label import Label, Mode
from grasp3d.surface.fields import CRITICAL_ANGLE_BEST, NONE, OF_ONE, REASON, STATED_LABEL
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.load_case import HARD_FINGERS, LoadResult
from grasp3d.surface.sweeps import vertex_weights
from grasp3d.surface.vertex_fields import Reason


class Cause(StrEnum):
    """Why a point of a surface has no grasp, or none that counts; the value is the text."""

    NO_PARTNER = "no opposing contacts within the search cone"
    LIMITS = "too wide or too narrow for the allowed openings"
    TOO_WIDE = "too wide for the stroke"
    STROKE = "too wide or too narrow for the stroke"
    TIP = "a fingertip would touch the object elsewhere"
    DIRECTION = "no approach is within the allowed directions"
    TABLE = "the table is in the way"
    BLOCKED = "fingers or palm would touch the object"
    NOT_REACHED = "the gripper reaches none of the grasps"
    SAME_POINT = "a fixed finger is at this point"
    OFF_SURFACE = "the vertex belongs to no face"
    EXCLUDED = "outside --region"
    UNSTABLE = "the best grasp needs more friction"
    FORCE = "the available force does not hold the load"
    COLLIDES = "no pose holds the object without a collision"


_STATES = {
    Reachability.TIP: Cause.TIP,
    Reachability.DIRECTION: Cause.DIRECTION,
    Reachability.TABLE: Cause.TABLE,
    Reachability.BLOCKED: Cause.BLOCKED,
}


def cause_masks(labels: SurfaceLabels) -> dict[Cause, Bools]:
    """Masks of the vertices without a grasp, by cause, shape (V,) each.

    If a gripper reaches none of a vertex's grasps, the cause is that of the best grasp.

    Args:
        labels: The labelled surface.
    """
    reason, reach, outside = labels.reason, labels.reach, _outside(labels)
    missed = reason == Reason.NOT_REACHED
    masks = {
        Cause.NO_PARTNER: reason == Reason.NO_PARTNER,
        outside: reason == Reason.OPENING,
        Cause.SAME_POINT: reason == Reason.SAME_POINT,
        Cause.OFF_SURFACE: reason == Reason.OFF_SURFACE,
        Cause.EXCLUDED: reason == Reason.EXCLUDED,
    }
    if reach is not None:
        masks[outside] = masks[outside] | (missed & (reach.state == Reachability.WIDTH))
        masks |= {cause: missed & (reach.state == state) for state, cause in _STATES.items()}
    others = missed & ~np.any(list(masks.values()), axis=0)
    return {**masks, Cause.NOT_REACHED: others}


def cause_at(labels: SurfaceLabels, vertex: int) -> Cause | None:
    """Why a vertex has no grasp; None if it has one.

    Args:
        labels: The labelled surface.
        vertex: Number of the vertex.
    """
    masks = cause_masks(labels).items()
    return next((cause for cause, mask in masks if mask[vertex]), None)


def cause_fractions(labels: SurfaceLabels) -> dict[Cause, float]:
    """Area fractions of what is U by cause, largest first; fractions of 0 are left out.

    They add up to the fraction labelled U. With a load whose mass and force are known, that is the
    fraction of the labels that include the force.

    Args:
        labels: The labelled surface.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> from grasp3d.describe import cause_fractions
        >>> box = trimesh.creation.box([0.09, 0.05, 0.03])
        >>> mesh = grasp3d.load_mesh(box, unit="m", max_edge=0.01)
        >>> labels = grasp3d.label_surface(mesh, hand=grasp3d.ParallelGripper.preset("franka"))
        >>> {str(cause): round(part, 2) for cause, part in cause_fractions(labels).items()}
        {'too wide for the stroke': 0.13, 'the best grasp needs more friction': 0.05}
    """
    masks, has_grasp = cause_masks(labels), labels.reason == Reason.FOUND
    unstable = has_grasp & (labels.label == Label.U)
    if labels.load_result is not None and (codes := labels.load_result.label) is not None:
        masks[Cause.FORCE] = has_grasp & (codes == Label.U) & ~unstable
        unstable &= codes == Label.U
    masks[Cause.UNSTABLE] = unstable
    areas = vertex_weights(labels.mesh, "area")
    fractions = {cause: float(areas[mask].sum()) for cause, mask in masks.items()}
    largest = sorted(fractions, key=lambda cause: -fractions[cause])
    return {cause: fractions[cause] for cause in largest if fractions[cause] > 0.0}


def causes_text(labels: SurfaceLabels) -> str:
    """Write the causes with their area fractions in one line; empty if nothing is U.

    Args:
        labels: The labelled surface.
    """
    found = cause_fractions(labels).items()
    return ", ".join(f"{one} ({100.0 * part:.1f} %)" for one, part in found if part >= 0.0005)


def _outside(labels: SurfaceLabels) -> Cause:
    """Cause that applies where all contacts are beyond the limits of the opening."""
    sampling, scene = labels.sampling, labels.scene
    lengths = () if sampling is None else sampling.lengths().values()
    if scene is None or any(0.0 < (length or 0.0) < math.inf for length in lengths):
        return Cause.LIMITS
    least, _ = scene.hand.distances()
    return Cause.STROKE if least > 0.0 else Cause.TOO_WIDE


ROUNDING = 1e-9
"""Size of coordinates, relative to the object, up to which they are rounding errors of 0."""


def facts(grasps: GraspTable | EvaluatedPoses, row: int) -> dict[str, str]:
    """Names and values, with units, of one grasp; unknown ones are left out.

    Args:
        grasps: Grasps, or poses.
        row: Number of the grasp.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> from grasp3d.describe import facts
        >>> box = grasp3d.load_mesh(trimesh.creation.box([0.08, 0.05, 0.03]), unit="m")
        >>> grasps = grasp3d.best_grasps(grasp3d.label_surface(box), 1)
        >>> facts(grasps, 0)["opening"]
        '80 mm'
    """
    metres, found = grasps.mesh.unit is not None, dict[str, str]()
    one = grasps.take(np.array([row]))
    for field in OF_ONE if isinstance(one, GraspTable) else one.fields:
        name = field.listed or field.heading
        if not name or field in {STATED_LABEL, REASON}:
            continue
        values = field.values_of(one)
        text = NONE if values is None else field.text(values[0], metres=metres)
        unit = field.title(metres=metres).partition("\n")[2]
        same = field.name == CRITICAL_ANGLE_BEST.name and text in found.values()
        if text not in {NONE, ""} and not same:
            found[name] = f"{text} {unit}".strip()
    return found


def position_text(point: Floats, mesh: ObjectMesh) -> str:
    """Write coordinates with four digits and their unit; rounding errors of 0 become 0."""
    rounded = np.where(np.abs(point) < ROUNDING * mesh.size, 0.0, point)
    factor, unit = (1000.0, " mm") if mesh.unit else (1.0, "")
    return f"({', '.join(f'{factor * value:.4g}' for value in rounded)}){unit}"


def load_sentence(load_result: LoadResult, row: int) -> str:
    """Say whether the available force holds the load, or why none does; empty if unknown.

    Args:
        load_result: Results of some grasps under the load.
        row: Number of the grasp.
    """
    case, of = load_result.case, "at all normals within the sensor resolution"
    force, least, largest = (
        float(one[row])
        for one in (
            load_result.grip_force, load_result.grip_force_least, load_result.grip_force_largest,
        )
    )  # fmt: skip
    if math.isinf(force):
        where = "" if math.isinf(least) else " at the nominal normals"
        return f"No force holds it{where}: {_why_none(load_result, row)}."
    if math.isnan(force) or case.available is None or not case.decided:
        return ""
    mass = f" of {case.to_hold}" if case.by_mass else ""
    if largest > case.available:
        of = "only at some of the normals within the sensor resolution"
        if least > case.available:
            of = "at none of the normals within the sensor resolution"
    return f"With {case.force_text} the load{mass} is held {of}."


def _why_none(load_result: LoadResult, row: int) -> str:
    codes = load_result.resistance
    if codes is not None and codes[row] == Resistance.NO_SUCH_WRENCH:
        return HARD_FINGERS if load_result.case.hard else "they resist no torque about one axis"
    return "the fingers can only push, and the contacts cannot push against all of the load"


UNSEARCHED = 3
"""Code of vertices whose label is unknown because the search did not go far enough."""

SAME = 1e-4
"""Angles [rad] closer than this count as equal, as files may store 32 bits."""

DIGITS = 4
"""Largest number of decimals used to distinguish an angle from a limit."""

REACHED = frozenset({Cause.TIP, Cause.DIRECTION, Cause.TABLE, Cause.BLOCKED, Cause.NOT_REACHED})
"""Causes that refer to the best of several grasps."""

WIDTHS = frozenset({Cause.LIMITS, Cause.TOO_WIDE, Cause.STROKE})
"""Causes that state the size of the object."""

PAIR = 2
FINGERS = ("first", "second", "third", "fourth", "fifth")
"""Words for the fingers; the first one is at the vertex."""


def finger_words(count: int) -> str:
    """Write a number of fingers in words."""
    names = ("one finger", "two fingers", "three fingers", "four fingers", "five fingers")
    return names[count - 1] if count <= len(names) else f"{count} fingers"


@dataclass(frozen=True)
class Case:
    """The values that decide the label of one vertex."""

    model: GraspModel
    mode: Mode
    code: int
    """Label, or `UNSEARCHED`."""
    worst: float
    """Critical friction angle over the worst normals and locations [rad]; inf if no grasp."""
    best: float
    """Critical friction angle over the best normals and locations [rad]."""
    cone: float
    """Largest critical friction angle that was searched for [rad]."""
    cause: Cause | None
    """Why there is no grasp; None if there is one."""
    off_line: tuple[float, float] | None
    """For two fingers, angles between their normals and the line through the contacts [rad]."""
    creases: tuple[int, ...] = ()
    """Indices, from 0, of the fingers that are known to be on sharp edges (creases)."""
    hand: str | None = None
    """Name of the gripper that must reach the grasp; None for ideal points."""

    @property
    def located(self) -> bool:
        """Whether contact points are uncertain."""
        return self.model.location_error != 0.0

    @property
    def smooth(self) -> bool:
        """Whether every finger has a single normal, judging by the angles."""
        return not self.creases and (self.located or self.worst - self.best < SAME)

    @property
    def margin(self) -> float:
        """Angle by which the grasp is S [rad] or, if negative, is not S; -inf if no grasp."""
        return self.model.sure_angle - self.worst

    @property
    def never_unstable(self) -> bool:
        """Whether no grasp of this number of fingers can be surely unstable."""
        return math.isinf(self.model.unstable_from)


def explain(case: Case) -> str:
    """Write one sentence with the letter of the label and the reason."""
    if case.code == UNSEARCHED:
        return _unsearched(case)
    if math.isinf(case.best):
        return f"U: {_no_grasp(case)}."
    by_label = {Label.S: _stable, Label.M: _ambiguous, Label.U: _unstable}
    label = Label(case.code)
    return f"{label.name}: {by_label[label](case)}."


def angle_text(angle: float, limit: float = math.nan) -> str:
    """Write an angle in degrees, with enough decimals to distinguish it from a limit."""
    one, other = math.degrees(angle), math.degrees(limit)
    for digits in range(1, DIGITS):
        if f"{one:.{digits}f}" != f"{other:.{digits}f}" or one == other:
            return f"{_signed(one, digits)}°"
    return f"{_signed(one, DIGITS)}°"


def _signed(value: float, digits: int) -> str:
    """Write a number with a typographic minus sign."""
    return f"{value:.{digits}f}".replace("-", "−")


def _stable_limit(case: Case) -> str:
    return _limit(case, case.model.sure_angle, "−")


def _unstable_limit(case: Case) -> str:
    return _limit(case, case.model.possible_angle, "+")


def _limit(case: Case, limit: float, sign: str) -> str:
    model, low = case.model, sign == "−"
    precise = partial(angle_text, limit=case.worst if low else case.best)
    beta = math.atan(model.friction_interval[0 if low else 1])
    if model.tilt == 0.0:
        return f"β = {precise(limit)}"
    return f"{angle_text(beta)} {sign} {angle_text(model.tilt)} = {precise(limit)}"


def _cause(case: Case, limit: float) -> str:
    """Write what decides if every finger has one normal: one finger's normal, or the grasp."""
    line, worst = case.off_line, case.worst
    angle = angle_text(worst, limit)
    if line is None or abs(max(line) - worst) >= SAME:
        return f"the grasp is force-closed for friction angles above β* = {angle}"
    if abs(line[0] - line[1]) < SAME:
        return f"both contact normals are {angle} off the line through the contacts"
    finger = FINGERS[line.index(max(line))]
    return f"the {finger} finger's normal is {angle} off the line through the contacts"


def _uncertain(case: Case, mark: str) -> tuple[str, str]:
    """Write which fingers are on sharp edges, and over what the worst and best angles are taken."""
    crease = "" if case.smooth else f"{_crease(case)}{mark} "
    what = ["these normals"] * (not case.smooth)
    what += ["the contact points within their location errors"] * case.located
    return crease, " and of ".join(what)


def _all_true(model: GraspModel) -> str:
    """Write all that may be true of a grasp within a model's errors."""
    normals = "all true normals within the sensor resolution"
    smallest, largest = model.friction_interval
    locations = ["all contact points within their errors"] * (model.location_error != 0.0)
    parts = [normals, *locations, *["any friction of its interval"] * (smallest < largest)]
    return ", ".join(parts[:-1]) + (" and " if len(parts) > 1 else "") + parts[-1]


def _crease(case: Case) -> str:
    """Write which fingers are on sharp edges, and which normals they may have."""
    names = [FINGERS[finger] for finger in case.creases]
    if not names:
        return "on a sharp edge a finger may have any normal between those of the adjacent faces"
    if len(names) == 1:
        return (
            f"the {names[0]} finger is on a sharp edge and may have any normal between those of "
            "the adjacent faces"
        )
    fingers = f"the {', '.join(names[:-1])} and {names[-1]} fingers"
    if len(names) == case.model.fingers == PAIR:
        fingers = "both fingers"
    return (
        f"{fingers} are on sharp edges and may have any normals between those of the adjacent faces"
    )


def _stable(case: Case) -> str:
    angle = angle_text(case.worst, case.model.sure_angle)
    cause = _cause(case, case.model.sure_angle)
    crease, several = _uncertain(case, ";")
    if several:
        cause = f"{crease}for the worst of {several} β* is {angle}"
    elif " off the line " in cause:
        cause = f"no contact normal is more than {angle} off the line through the contacts"
    return f"{cause}, below {_stable_limit(case)}: the grasp is stable for {_all_true(case.model)}"


def _unstable(case: Case) -> str:
    grasp = "the best grasp found" if case.mode == "label" else "the grasp"
    needs = (
        f"{grasp} needs a friction angle above {angle_text(case.best, case.model.possible_angle)}"
    )
    if not case.smooth:
        edge = "the first finger's sharp edge" if 0 in case.creases else "a sharp edge"
        needs += f" even with the best normals on {edge}"
    needs += " with the best true contact points" * case.located
    limit = _unstable_limit(case)
    if case.model.tilt == 0.0:
        return f"{needs}, and the friction allows no more than {limit}"
    return f"{needs}, and no normal within the resolution allows more than {limit}"


def _ambiguous(case: Case) -> str:
    sure = f"surely stable below {_stable_limit(case)}"
    if case.model.sure_angle <= 0.0:
        sure = (
            "no grasp is surely stable at this resolution, as "
            f"{_stable_limit(case)} is not above 0°"
        )
    limit = _unstable_limit(case)
    unstable = f"surely unstable from {limit} on"
    if case.never_unstable:
        unstable = (
            f"no grasp of this number of fingers is surely unstable, as {limit} is not below 90°"
        )
    crease, several = _uncertain(case, ":")
    if not several:
        nearer = min(
            (case.model.sure_angle, case.model.possible_angle),
            key=lambda limit: abs(limit - case.worst),
        )
        return f"{_cause(case, nearer)}: {sure}, {unstable}"
    worst = "unbounded" if math.isinf(case.worst) else angle_text(case.worst, case.model.sure_angle)
    return (
        f"{crease}β* is {worst} for the worst and "
        f"{angle_text(case.best, case.model.possible_angle)} for the best of {several}; "
        f"{sure}, {unstable}"
    )


def _unsearched(case: Case) -> str:
    best = ""
    if math.isfinite(case.worst):
        best = f", and the best of them has β* {angle_text(case.worst)}"
    return (
        f"Not searched: grasps were searched up to β* {angle_text(case.cone)}{best}; "
        f"{_unstable_limit(case)} exceeds this limit."
    )


def _no_grasp(case: Case) -> str:
    if case.cause in {None, Cause.NO_PARTNER}:
        return f"{Cause.NO_PARTNER} of {angle_text(case.cone)}"
    if case.cause in WIDTHS:
        return f"the object is {case.cause} here"
    if case.hand is None or case.cause not in REACHED:
        return str(case.cause)
    return f"there are grasps here, but {case.hand} reaches none of those tested: {case.cause}"
