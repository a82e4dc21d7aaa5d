"""The verdict on an object: whether it is surely held, by what, and what would have to change."""

import math
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from grasp3d.arrays import Bools, Floats, Ints
from grasp3d.describe.explanations import Cause, cause_fractions, finger_words
from grasp3d.grasps.best import best_grasps, count_sure, distinct_grasps, has_poses, pool_of
from grasp3d.grasps.evaluated_poses import MOST_DISTINCT, EvaluatedPoses, ranked_rows
from grasp3d.grasps.reasons import MISSED, OFF_PADS, UNSURE
from grasp3d.grasps.robustness import PAYLOAD_RTOL
from grasp3d.quality.grip_forces import Resistance
from grasp3d.quality.loads import Load
from grasp3d.stability.label import Label
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.load_case import HARD_FINGERS, LoadResult
from grasp3d.system.context import unreported
from grasp3d.system.names import short_number

Word = Literal["surely", "perhaps", "not"]

MOST_FRICTION = 2.0
"""Largest friction that is suggested as a remedy: that of rubber."""

ALPHA, MU = 0.1, 0.01
"""Steps of a sensor's resolution [degrees] and of friction in suggested remedies."""

SMALL, WHOLE = math.radians(0.1), 0.995
"""Angle of resolution [rad] from which it is not rounded to 0, and fraction of the surface above
which it counts as all."""

FEW = 4
"""Number of grasps that need least in one respect, with which remedies are tested."""

NAMED = 10
"""Length of the list whose first grasp is described."""

_WORDS: dict[int, Word] = {Label.S: "surely", Label.M: "perhaps", Label.U: "not"}
_CHANGES = {
    "sensor_resolution": "with a sensor of {:.1f}° or finer instead of {:.4g}°",
    "grip_force": "with {} N instead of {} N",
    "mass": "with {} kg instead of {} kg",
    "friction": "with a friction of {:.2f} or more instead of {:.4g}",
}


_WRONG = {
    MISSED: "its jaws may close on nothing within the pose error",
    OFF_PADS: "contacts may leave the pads within the pose error",
    UNSURE: "no grasp is sure within the pose error",
}


_NONE = "no grasp was found that may be stable"
_NOWHERE = "no grasp holds at every pose within the pose error"


@dataclass(frozen=True)
class Remedy:
    """A change of a single setting that makes a grasp surely hold."""

    setting: Literal["sensor_resolution", "grip_force", "mass", "friction"]
    """Setting of the model, the load or the gripper."""
    value: float
    """Value that it must have [rad, N, kg or 1]; it suffices both exactly and as printed."""
    now: float
    """Its present value."""

    def __str__(self) -> str:
        factor = 180.0 / math.pi if self.setting == "sensor_resolution" else 1.0
        text = _CHANGES[self.setting]
        numbers = factor * self.value, factor * self.now
        return text.format(*(map(short_number, numbers) if "{}" in text else numbers))


@dataclass(frozen=True)
class LoadVerdict:
    """What a load requires of grasps at the worst normals that may be true."""

    holds: bool | None
    """Whether some grasp holds it; None if the mass or the available force is unknown."""
    mass: float | None
    """Mass of the object [kg]; None if unknown or irrelevant."""
    available: float | None
    """Available force of each finger [N]; None if unknown."""
    needed: float
    """Least grip force of all grasps [N], for the mass or, if unknown, for 1 kg; inf if no grasp
    holds the load, nan if the motors of a hand with joints must hold it."""
    payload: float
    """Largest mass [kg] that a grasp holds with the available force, or the motors; nan if no force
    is known or the task does not depend on the mass."""
    what: str = ""
    """The task in words, with a verb: 'hold 0.5 kg in every orientation'."""
    reason: str = ""
    """Why no force surely holds the load, as far as known; empty if one does."""

    @classmethod
    def of(cls, grasps: GraspTable | EvaluatedPoses, rows: Bools) -> "LoadVerdict | None":
        """Find what a load takes; return None if there is no load.

        Args:
            grasps: All grasps of an object, or poses.
            rows: Mask of the reachable grasps, which count, shape (b,).
        """
        case, forces = grasps.load_case, needed_force(grasps)
        if case is None:
            return None
        held = np.zeros(0) if grasps.payload is None else grasps.payload[rows]
        available, most = case.available, float(np.nanmax(held, initial=0.0))
        if forces is None:  # the motors must hold it
            needed, enough = math.nan, most >= (case.mass or 1.0)
            decided = case.decided
        else:
            needed = float(np.nanmin(forces[rows], initial=math.inf)) + 0.0  # 0, not -0
            enough = available is not None and needed <= available
            decided = case.complete
        known = case.by_mass and (forces is None or available is not None)
        task, pure = case.load.task, not case.by_mass
        mass = None if pure else case.mass
        around = "in every orientation" if task == Load().task else f"against {task}"
        kilograms = "each kilogram" if mass is None else f"{short_number(mass)} kg"
        return cls(
            holds=enough if decided else None,
            mass=mass,
            available=available,
            needed=needed,
            payload=most if known else math.nan,
            what=f"resist {task}" if pure else f"hold {kilograms} {around}",
            reason="" if math.isfinite(needed) else _why_none(grasps.load_result),
        )

    @property
    def numbers(self) -> str:
        """Sentence on what the load takes if the mass or the available force is unknown."""
        if self.holds is not None or math.isinf(self.needed):
            return ""
        most = self.what.replace("each kilogram", f"{short_number(self.payload)} kg")
        if math.isnan(self.needed):
            return f"Its motors {most}."
        if self.available is not None:
            return f"{short_number(self.available)} N {most}."
        verb, rest = self.what.split(maxsplit=1)
        return f"{verb.capitalize()}ing {rest} takes {short_number(self.needed)} N."


@dataclass(frozen=True)
class Verdict:
    """Whether an object is surely held: by a gripper, or by ideal fingers without one.

    Its text is the verdict in one to three sentences.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> from grasp3d.describe import verdict_of
        >>> box = trimesh.creation.box([0.08, 0.05, 0.03])
        >>> mesh = grasp3d.load_mesh(box, unit="m", max_edge=0.02)
        >>> print(verdict_of(grasp3d.label_surface(mesh)))
        Surely held by two fingers: 23 distinct grasps; the best has 30.5° of resolution to spare.
        >>> model = grasp3d.GraspModel(torsion_radius="3mm", sensor_resolution=0.2)
        >>> load = grasp3d.Load(mass=0.5, grip_force=3.0)
        >>> print(verdict_of(grasp3d.label_surface(mesh, model, load=load)))
        Not held by two fingers: 3 N is too little to hold 0.5 kg in every orientation. Surely ...
    """

    word: Word
    """Verdict from the best label that takes everything stated into account, as in `ranked_rows`:
    surely for S; perhaps for M; not for U, or if there is no grasp."""
    by: str
    """What holds it: the name of the gripper, or the fingers."""
    count: int = 0
    """Number of distinct S grasps that the gripper reaches, at most 1,000; for a table of grasps,
    number of all that are S."""
    of: int | None = None
    """Number of grasps in a table; None for those of a surface."""
    resolution: float = 0.0
    """The sensor's resolution alpha [rad]."""
    max_resolution: float = 0.0
    """Coarsest sensor resolution below which the best grasp is S [rad]; 0 if none."""
    grip_force: float = math.nan
    """Force that the best grasp needs at the worst normals [N]; nan if no grasp or load."""
    causes: dict[Cause, float] = field(default_factory=dict)
    """Why there is no grasp, with fractions of the area; empty if there is one."""
    remedies: tuple[Remedy, ...] = ()
    """Changes each of which alone would make it sure."""
    load_result: LoadVerdict | None = None
    """What the load takes; None if there is no load."""
    wrong: str = ""
    """What goes wrong with most of the best poses within their errors; empty if poses are exact or
    something else decides."""
    lost: bool = False
    """Whether ideal points have grasps with a better label that is lost when the jaws close."""

    @property
    def spare_resolution(self) -> float:
        """Amount alpha* - alpha by which the sensor may be coarser for the best grasp [rad].

        If not positive, the sensor must be finer; nan if none is fine enough or there is no grasp.
        """
        return self.max_resolution - self.resolution if self.max_resolution > 0.0 else math.nan

    def __str__(self) -> str:
        parts = [f"{self.word.capitalize()} held by {self.by}: {self._why()}."]
        if self.remedies:
            *first, last = map(str, self.remedies)
            parts.append(f"Surely {', '.join(first)}{', or ' if first else ''}{last}.")
        elif self.word == "perhaps" and self.of is None:
            load = "" if self.load_result is None else self.load_result.reason
            none = "no change of sensor, friction, force or mass alone makes it sure"
            text = load or none
            parts.append(f"{text[0].upper()}{text[1:]}.")
        if self.load_result is not None:
            parts.append(self.load_result.numbers)
        return " ".join(filter(None, parts))

    def _why(self) -> str:
        """Write the reason for the verdict."""
        load, lost = self.load_result, "once the jaws close, " if self.lost else ""
        if self.word == "surely":
            return self._sure()
        if self.causes:
            cause, part = next(iter(self.causes.items()))
            return f"{cause}{'' if part > WHOLE else f' on {100.0 * part:.0f} % of the surface'}"
        if self.wrong:
            return f"{lost}{self.wrong}"
        if load is not None and (load.holds is False or math.isinf(load.needed)):
            return lost + self._load_unheld(load)
        if self.word == "not":
            return f"{lost}{_NONE}"
        resolution = f"{_degrees(self.resolution):.4g}°"
        return f"{lost}no grasp is surely stable at a sensor resolution of {resolution}"

    def _load_unheld(self, load: LoadVerdict) -> str:
        """Write that the available force does not surely hold the load."""
        known = None if load.holds is None else load.available
        motors = math.isnan(load.needed)
        force = "any force" if known is None else f"{short_number(known)} N"
        force = "its motors" if motors else force
        if self.word == "perhaps":
            return f"the sensor cannot tell whether {force} can {load.what}"
        if motors:
            return f"its motors are too weak to {load.what}"
        if load.reason or load.holds is None:
            what = load.what.replace("each kilogram", "any mass")
            return f"no force suffices to {what}" + (f": {load.reason}" if load.reason else "")
        return f"{force} is too little to {load.what}"

    def _sure(self) -> str:
        """Write the sure grasps, and what the best has to spare or needs of the available force."""
        grasps, parts = f"{self.count:,} distinct grasps", []
        if self.of is not None:
            grasps = f"{self.count:,} of {self.of:,} grasps"
        elif self.count == 1:
            grasps = "1 distinct grasp"
        elif self.count == MOST_DISTINCT:
            grasps += " or more"
        load = self.load_result
        if load is not None and load.holds is not None and load.available is not None:
            force = f"{short_number(self.grip_force)} N of {short_number(load.available)} N"
            parts.append(f"needs {force} to {load.what}")
        elif (spare := self.spare_resolution) >= SMALL:
            parts.append(f"has {_degrees(spare):.1f}° of resolution to spare")
        subject = "it" if self.count == 1 else "the best"
        return f"{grasps}; {subject} {' and '.join(parts)}" if parts else grasps


def verdict_of(grasps: SurfaceLabels | GraspTable | EvaluatedPoses) -> Verdict:
    """Judge whether an object is surely held; this computes the scores that rank grasps.

    With a gripper, the grasps of a surface are the poses that `best_grasps` returns.

    Args:
        grasps: A labelled surface, or a table of grasps or poses.

    Returns:
        The verdict; its best grasp is the first of `ranked_rows`.
    """
    labels = grasps if isinstance(grasps, SurfaceLabels) else None
    tried, named, count = _judged(grasps)
    # If none is named, all poses that were tried fail within their errors.
    code = max([*tried.letter, *named.letter] if named.size else [], default=Label.U)
    reachable = getattr(tried, "reachable", np.ones(tried.size, dtype=np.bool_))
    load = LoadVerdict.of(tried, reachable)
    verdict = Verdict(
        _WORDS[code],
        by=finger_words(grasps.model.fingers) if grasps.scene is None else grasps.scene.hand.name,
        of=None if isinstance(grasps, SurfaceLabels) else grasps.size,
        resolution=grasps.model.sensor_resolution,
        load_result=load,
        wrong=_wrong(tried),
        lost=labels is not None and bool((labels.letter > code).any()),
    )
    if tried.letter.any() and not named.size:
        return replace(verdict, wrong=_NOWHERE, lost=False)
    if labels is None and not reachable.any():
        return replace(verdict, causes={Cause.COLLIDES: 1.0})
    if labels is not None and code == Label.U and not labels.label.any():
        return replace(verdict, causes=cause_fractions(labels))
    if code == Label.U:
        found = {"remedies": _remedies(tried, load)} if tried.size else {"wrong": _NONE}
        return replace(verdict, **found)
    first = int(ranked_rows(named)[0])
    needed = needed_force(named)
    verdict = replace(
        verdict,
        max_resolution=float(named.max_resolution[first]),
        grip_force=math.nan if needed is None else float(needed[first]) + 0.0,
    )
    if code == Label.S:
        return replace(verdict, count=count)
    return replace(verdict, remedies=_remedies(tried, load))


def _wrong(tried: GraspTable | EvaluatedPoses) -> str:
    """Say what goes wrong with most of the best poses within their errors, if that decides."""
    exact = tried.scene is None or not tried.scene.pose_error
    if isinstance(tried, GraspTable) or exact or not tried.size:
        return ""
    best = tried.take(np.flatnonzero(tried.letter == tried.letter.max()))
    (kind, _), *_ = Counter(best.reasons.kinds).most_common(1)
    return _WRONG.get(kind, "")


def _judged(
    grasps: SurfaceLabels | GraspTable | EvaluatedPoses,
) -> tuple[GraspTable | EvaluatedPoses, GraspTable | EvaluatedPoses, int]:
    """The grasps that a verdict rests on, those that are named, and the number of S grasps."""
    if not isinstance(grasps, SurfaceLabels):
        return grasps, grasps, int(np.sum(grasps.letter == Label.S))
    if not has_poses(grasps):
        distinct = distinct_grasps(grasps)
        return grasps.take(grasps.distinct), distinct, int(np.sum(distinct.letter == Label.S))
    pool, named = pool_of(grasps), best_grasps(grasps, NAMED)
    count = int(np.sum(named.letter == Label.S))
    if grasps.scene is not None and grasps.scene.pose_error:  # poses of the pool are exact
        return named if named.size else pool, named, count
    return pool, named, max(count, count_sure(grasps))


def _why_none(load_result: LoadResult | None) -> str:
    """Say why no force surely holds a load, as far as known."""
    if load_result is None:
        return ""
    turned = load_result.resistance == Resistance.NO_SUCH_WRENCH  # False if resistance is None
    if load_result.case.hard and bool((np.isinf(load_result.grip_force) & turned).any()):
        return HARD_FINGERS
    if not np.isfinite(load_result.grip_force_least).any():
        return "no contact forces add up to the load"
    return ""


def needed_force(grasps: GraspTable | EvaluatedPoses) -> Floats | None:
    """Force that each grasp needs at the worst normals [N], shape (b,); None if there is no load.

    Args:
        grasps: Grasps, or poses.
    """
    if grasps.load is None:
        return None
    load_result = grasps.load_result
    return grasps.grip_force if load_result is None else load_result.grip_force_largest


def _remedies(grasps: GraspTable | EvaluatedPoses, load: LoadVerdict | None) -> tuple[Remedy, ...]:
    """Find changes that would make one of the grasps S, none of which is; each is tested."""
    model, few = grasps.model, grasps.take(_candidates(grasps))
    remedies: list[Remedy] = []
    alpha = math.floor(round(math.degrees(model.sensor_resolution) / ALPHA, 6))
    finer = _edge(lambda step: _sure(few, sensor_resolution=_alpha(step)), 1, alpha)
    if finer:
        remedies.append(Remedy("sensor_resolution", _alpha(finer), model.sensor_resolution))
    if load is None or not (finer or math.isfinite(load.needed)):
        remedies += _friction(few)
    return (*remedies, *_load_remedies(few, load))


def _load_remedies(few: GraspTable | EvaluatedPoses, load: LoadVerdict | None) -> Iterator[Remedy]:
    """Yield the least force and the largest mass at which one of the grasps is S, if any."""
    stated, needed, held = few.load, needed_force(few), few.payload
    if load is None or stated is None or load.holds is not False:
        return
    if needed is not None and load.available is not None:
        for row in np.argsort(needed):
            if math.isfinite(needed[row]) and few.margin[row] > 0.0:
                force = _rounded(float(needed[row]) * (1.0 + PAYLOAD_RTOL), 3, math.ceil)
                if _sure(few, load=replace(stated, grip_force=force)):
                    yield Remedy("grip_force", force, load.available)
                    break
    if held is not None and load.mass is not None:
        for row in np.argsort(-held):
            if held[row] > 0.0 and few.margin[row] > 0.0:
                mass = _rounded(float(held[row]) / (1.0 + PAYLOAD_RTOL), 2, math.floor)
                if _sure(few, load=replace(stated, mass=mass, density=None)):
                    yield Remedy("mass", mass, load.mass)
                    break


def _candidates(grasps: GraspTable | EvaluatedPoses) -> Ints:
    """Choose a few grasps that need least; one of them is the first to become S."""
    rows = np.flatnonzero(grasps.letter == grasps.letter.max())
    values = [-grasps.score, -grasps.max_resolution, grasps.critical_angle]
    needed = needed_force(grasps)
    if needed is not None:
        values += [needed, np.where(grasps.margin > 0.0, needed, math.inf)]
    best = [np.argsort(np.nan_to_num(one[rows], nan=math.inf))[:FEW] for one in values]
    return np.unique(rows[np.concatenate(best)])


def _sure(grasps: GraspTable | EvaluatedPoses, *, load: Load | None = None, **changed: Any) -> bool:
    """Whether some of the grasps are S with another load or another model."""
    after = grasps.using(model=replace(grasps.model, **changed), load=load or grasps.load)
    return bool((after.letter == Label.S).any())


def _friction(grasps: GraspTable | EvaluatedPoses) -> list[Remedy]:
    """Find the least friction at which some of the grasps are S, as a remedy if there is one."""
    model = grasps.model
    least = math.floor(model.nominal_friction / MU) + 1
    step = _edge(lambda step: _sure(grasps, friction=MU * step), round(MOST_FRICTION / MU), least)
    return [Remedy("friction", round(MU * step, 2), model.nominal_friction)] if step else []


def _edge(holds: Callable[[int], bool], good: int, bad: int) -> int:
    """Find the last whole number from `good` toward `bad` that holds; 0 if `good` does not.

    Numbers nearer to `good` hold, too.
    """
    with unreported():
        if not (min(good, bad) > 0 and holds(good)):
            return 0
        if holds(bad):
            return bad
        while abs(good - bad) > 1:
            middle = (good + bad) // 2
            good, bad = (middle, bad) if holds(middle) else (good, middle)
    return good


def _alpha(step: int) -> float:
    return math.radians(ALPHA * step)


def _rounded(value: float, digits: int, rounding: Callable[[float], int]) -> float:
    """Round a positive number to some digits, up or down."""
    step = 10.0 ** (math.floor(math.log10(value)) - digits + 1) if value > 0.0 else 1.0
    return float(f"{rounding(value / step) * step:.{digits}g}")


def _degrees(angle: float) -> float:
    """Write an angle in degrees, rounded down to tenths so as not to overstate the margin."""
    return math.floor(round(10.0 * math.degrees(angle), 6)) / 10.0
