"""Which grasp is to be taken first: the one order of grasps, for lists, tables and pictures."""

import math

import numpy as np

from grasp3d.arrays import Bools, Floats, Ints
from grasp3d.grasps.evaluated_poses import EvaluatedPoses, GivenGrasps
from grasp3d.grasps.hand_grasps import EvaluatedHandGrasps
from grasp3d.hand.jaws import Jaws
from grasp3d.settings import GraspModel
from grasp3d.settings.lengths import METRES
from grasp3d.stability.label import Label
from grasp3d.surface.closed_grasps import UNKNOWN, ClosedGrasps
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.surface.rows import NO_ROW

RESOLUTION = GraspModel().sensor_resolution
"""Unit of the resolution to spare, where the sensor's own resolution is 0 [rad]."""

APPROACH = math.radians(15.0)
"""Unit of the approach margin [rad]: an error of the approach that a robot must be allowed."""

PLACE = 0.005
"""Unit of the distance of contacts from the border of the pads [m]: an error of the place that a
robot must be allowed."""

FORCE = 10.0
"""Force of each finger [N] that stands for the one at hand where none is stated."""

STEP = 0.1
"""Margins are compared in steps of this size, in their units; within one step epsilon decides."""

SCORE = 0.05
"""Step in which robust scores are compared."""

LEAST = 1e-6
"""Fraction of a step by which rounding errors do not make a margin belong to the step below."""


def ranked_rows(grasps: GraspTable | GivenGrasps, closed: ClosedGrasps | None = None) -> Ints:
    """Rows of grasps, the one to be taken first at the front; computes epsilon and grip forces.

    Grasps are compared by, one after the other:

    1. The label that takes everything stated into account, `stated_label`. Of those that are U,
       what the gripper does not reach, or collides at, comes last.
    2. Where jaws have been closed: whether the approach may be wrong by 15 degrees, or how much
       less, in steps of a tenth; then `Robustness.robust_score`, in steps of a twentieth: how much
       what they touch holds in the worst case, on average over the poses tried.
    3. How robustly they can be executed: their margins in `margins_in_units`, in steps of a tenth.
       The smallest margins of two grasps are compared first, whichever they are, and where they
       are equal the second smallest ones, and so on.
    4. Epsilon, and then the score and the margins within a step.

    So no grasp comes after one that is no better in any of these, and worse in one.

    Args:
        grasps: Grasps, or poses of a gripper.
        closed: What its jaws touch at the grasps; None: ideal points, or poses, which have `jaws`.

    Returns:
        Rows of those that have a critical angle, shape (r,).
    """
    angles, _ = grasps.located_angles
    in_units = margins_in_units(grasps, closed)
    margins = np.sort(np.stack(list(in_units.values()), axis=1), axis=1)
    allowed = np.ones(grasps.size)
    if closed is not None and "approach" in in_units:
        allowed = np.minimum(in_units["approach"], 1.0)
    steps = np.floor(margins / STEP + LEAST)
    score = np.nan_to_num(robust_number(grasps, closed, "robust_score"), nan=-1.0)
    keys = [
        -stated_label(grasps, closed),
        ~_executable(grasps),
        -np.floor(allowed / STEP + LEAST),
        -np.floor(score / SCORE + LEAST),
        *-steps.T,
        -np.nan_to_num(grasps.epsilon),
        -score,
        *-margins.T,
    ]
    order = np.lexsort([np.arange(len(angles)), *reversed(keys)])
    return np.asarray(order[np.isfinite(angles[order])])


def listed_rows(grasps: GraspTable | GivenGrasps, count: int) -> Ints:
    """So many rows for a list: of `ranked_rows`, then of those without a critical angle."""
    ranked = ranked_rows(grasps)
    return np.concatenate([ranked, np.setdiff1d(np.arange(grasps.size), ranked)])[:count]


def stated_label(grasps: GraspTable | GivenGrasps, closed: ClosedGrasps | None = None) -> Ints:
    """`Label` codes that take everything stated into account, shape (b,).

    With a load whose mass and force are known that is the label with force; else where jaws have
    been closed that at what they touch; else that of the grasp. Where jaws have been closed it is
    no better than the worst of the poses tried, `Robustness.label_tried`, and M at most where what
    they touch is not known, as for fingers that push outward; so it is where mass or force are not
    known and not every force that may be needed exists, and U where none does. What the gripper
    does not reach is U. Arguments as in `ranked_rows`.
    """
    holding = grasps.holding
    held = None if holding is None else holding.label
    if isinstance(grasps, EvaluatedHandGrasps):
        held = grasps.label_with_force
    codes = (grasps.label if held is None else held).astype(np.int64)
    if closed is not None:
        unknown = closed.label == UNKNOWN
        codes = np.where(
            unknown, np.minimum(codes, Label.M), closed.label if held is None else codes
        )
    if holding is not None and held is None:
        most = np.where(np.isfinite(holding.grip_force_largest), Label.S, Label.M)
        most[~np.isfinite(holding.grip_force_least)] = Label.U
        codes = np.minimum(codes, most)
    tried = np.nan_to_num(robust_number(grasps, closed, "label_tried"), nan=Label.S)
    return np.where(_executable(grasps), np.minimum(codes, tried.astype(np.int64)), Label.U)


def written_scores(grasps: GraspTable, closed: ClosedGrasps | None = None) -> Floats:
    """One number per grasp, by which files are sorted: it follows `ranked_rows`, shape (b,).

    (l + (1 + s) / 2) / 3, where l is the `stated_label`, U 0, M 1 and S 2, and s is
    `Robustness.robust_score` where jaws have been closed, else 1 - beta*/beta, at least -1; but
    never more than that of a grasp ranked before. 0 without a critical angle. Arguments as in
    `ranked_rows`.
    """
    angles, _ = grasps.located_angles
    robust = robust_number(grasps, closed, "robust_score")
    score = np.where(np.isnan(robust), 1.0 - angles / grasps.model.friction_angle, robust)
    in_letter = 0.5 * (1.0 + np.clip(score, -1.0, 1.0))
    rows, scores = ranked_rows(grasps, closed), np.zeros(grasps.size)
    ranked = (stated_label(grasps, closed) + in_letter)[rows] / 3.0
    scores[rows] = np.minimum.accumulate(ranked)
    return scores


def robust_number(
    grasps: GraspTable | GivenGrasps, closed: ClosedGrasps | None, name: str
) -> Floats:
    """A number of `Robustness` of each grasp, shape (b,); nan: not known."""
    if isinstance(grasps, EvaluatedPoses):
        values = getattr(grasps.robustness, name)
        return np.full(grasps.size, math.nan) if values is None else np.asarray(values, float)
    return np.full(grasps.size, math.nan) if closed is None else closed.number(name)


def margins_in_units(
    grasps: GraspTable | GivenGrasps, closed: ClosedGrasps | None = None
) -> dict[str, Floats]:
    """How far grasps are from failing, in units of what is stated or of documented errors.

    resolution: What the sensor's resolution may still grow by, in units of it; where jaws have been
    closed that at what they touch. approach: How far the approach may turn, in units of 15 degrees.
    place: Distance of the contacts from the border of flat pads, in units of 5 mm. load: Payload
    beyond the mass, in units of it, or of 1 kg where the task does not state one; of a task without
    a mass the force at hand beyond that which is needed, in units of it. Arguments as in
    `ranked_rows`.

    Returns:
        Shape (b,) each, -inf where a grasp cannot be executed; without those that do not apply.
    """
    spare = 2.0 * grasps.margin
    if closed is not None:
        spare = np.where(closed.label == UNKNOWN, spare, 2.0 * closed.margin)
    margins = {"resolution": spare / (grasps.model.sensor_resolution or RESOLUTION)}
    if isinstance(grasps, GraspTable) and grasps.has_poses and grasps.reach is not None:
        margins["approach"] = grasps.reach.approach_margin / APPROACH
    if grasps.scene is not None and (jaws := grasps.scene.jaws) and not jaws.round_tips:
        margins["place"] = _place(grasps, closed, jaws) / PLACE
    if (holding := grasps.holding) is not None:
        if holding.has_payload:
            margins["load"] = holding.payload / (holding.mass or 1.0) - 1.0
        else:
            needed = np.maximum(holding.grip_force_largest, np.finfo(float).tiny)
            margins["load"] = (holding.available or FORCE) / needed - 1.0
    if isinstance(grasps, EvaluatedHandGrasps) and grasps.label_with_force is not None:
        assert grasps.motor_holding is not None
        margins["load"] = grasps.motor_holding.spare
    return {name: np.where(np.isnan(values), -math.inf, values) for name, values in margins.items()}


def _executable(grasps: GraspTable | GivenGrasps) -> Bools:
    """Whether the gripper reaches the grasps without collision, shape (b,)."""
    if isinstance(grasps, GivenGrasps):
        return grasps.reachable
    reach = grasps.reach
    return np.ones(grasps.size, dtype=bool) if reach is None else reach.reached


def _place(grasps: GraspTable | GivenGrasps, closed: ClosedGrasps | None, jaws: Jaws) -> Floats:
    """Distance of the contacts from the border of flat pads [m], below 0 beside them, shape (b,).

    The smallest of both jaws, along the axis y and z of the gripper. Where the jaws have not been
    closed, ideal contacts are on the line between the fingers.
    """
    place = robust_number(grasps, closed, "pad_margin")
    if isinstance(grasps, GraspTable) and grasps.reach is not None:
        half = 0.5 * np.array([jaws.pad_width, jaws.pad_height])
        along = half[1] - METRES[grasps.mesh.unit or "m"] * grasps.reach.depth
        ideal = np.minimum(half[0], half[1] - np.abs(along))
        unknown = np.ones(len(place), bool) if closed is None else closed.row == NO_ROW
        place = np.where(unknown, ideal, place)
    return place
