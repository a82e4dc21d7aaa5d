"""One vertex, or a given grasp: contacts, numbers, and the label with its reason."""

import math
from dataclasses import dataclass, replace

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.grasps.causes import cause_at
from grasp3d.grasps.explanations import PAIR, Case, explain
from grasp3d.hand.gripper_pose import GripperPose
from grasp3d.mesh import ObjectMesh
from grasp3d.quality.grip_forces import Resistance
from grasp3d.settings import GraspModel
from grasp3d.settings.model_text import EPSILON_MIN
from grasp3d.stability.thresholds import label_angles
from grasp3d.surface.contacts import SurfaceContacts
from grasp3d.surface.grasp_numbers import surface_epsilons, surface_load_result
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.load_result import LoadResult
from grasp3d.surface.vertex_grasps import Reason
from grasp3d.system.counts import short_number
from grasp3d.viewer.session.painting import ROUNDING, label_codes, same_settings
from grasp3d.viewer.subjects.subject import Subject

ALIKE = 5e-3
"""Relative difference below which forces are not distinguished."""


def angle_numbers(case: Case) -> list[tuple[str, str]]:
    """Names and values of critical angles, the coarsest resolution and the margin."""
    angles = _critical_angles(case.worst, case.best, "points" if case.located else "normals")
    return [("β*", angles), ("α*", _max_resolution(case)), ("margin", _margin(case))]


def _critical_angles(worst: float, best: float, of: str) -> str:
    texts = [signed_angle(angle) for angle in (worst, best)]
    if texts[0] == texts[1]:
        return texts[0]
    return f"{texts[0] if math.isfinite(worst) else 'none'} (worst), {texts[1]} (best {of})"


def _max_resolution(case: Case) -> str:
    """Coarsest resolution of all fingers below which it is S: alpha + 2 margins."""
    coarsest = case.model.sensor_resolution + 2.0 * case.margin
    return signed_angle(coarsest) if coarsest > 0.0 else "no sensor is fine enough"


def _margin(case: Case) -> str:
    return "none" if math.isinf(case.margin) else signed_angle(case.margin, always=True)


def signed_angle(angle: float, *, always: bool = False) -> str:
    """An angle in degrees with a typographic minus sign, and on demand with a plus sign."""
    degrees = round(math.degrees(angle), 1) + 0.0  # never -0
    return f"{degrees:{'+' if always else ''}.1f}°".replace("-", "−")


@dataclass(frozen=True, eq=False)
class HeldGrasp:
    """Force and payload of one of several grasps under a load."""

    load_result: LoadResult
    row: int
    fingers: int

    def numbers(self) -> list[tuple[str, str]]:
        """Names and values that a load adds."""
        load_result = self.load_result
        force, largest = self._of(load_result.grip_force), self._of(load_result.grip_force_largest)
        if math.isnan(force):
            return []
        numbers = [("grip force", self._text(force))]
        if largest > force * (1.0 + ALIKE):
            numbers.append(("at worst normals", self._text(largest)))
        if math.isfinite(payload := self._of(load_result.payload)):
            numbers.append(
                ("payload", f"{short_number(payload)} kg with {load_result.case.at_hand}")
            )
        return numbers

    def _of(self, values: Floats) -> float:
        return float(values[self.row])

    def _text(self, force: float) -> str:
        if math.isinf(force):
            return "none suffices"
        return f"{short_number(force)} N{'' if self.load_result.case.decided else ' per kg'}"

    def sentence(self) -> str:
        """Whether the force at hand holds the load, or why none does; empty: that is unknown."""
        load, least = self.load_result.case, self._of(self.load_result.grip_force_least)
        if math.isnan(force := self._of(self.load_result.grip_force)):
            return ""
        if math.isinf(force):
            where = "" if math.isinf(least) else " at the nominal normals"
            return f"No force holds it{where}: {self._why()}."
        if load.available is None or not load.decided:
            return ""
        mass = f" of {load.to_hold}" if load.by_mass else ""
        start = f"With {load.at_hand} the load{mass} is"
        if self._of(self.load_result.grip_force_largest) <= load.available:
            return f"{start} held at all normals within the sensor resolution."
        if least > load.available:
            return f"{start} not held at any of these normals."
        return f"{start} held at some of the normals within the sensor resolution only."

    def _why(self) -> str:
        codes = self.load_result.resistance
        if codes is not None and codes[self.row] == Resistance.NO_SUCH_WRENCH:
            if self.fingers == PAIR and self.load_result.case.hard:
                return (
                    "two hard fingers cannot resist a torque about the line through them; give a "
                    "torsion radius, or a gripper, whose pads have one"
                )
            return "these contacts resist no torque about one axis"
        return "the fingers can only push, and the contacts cannot push against all of the load"


UNKNOWN = "–"
EPSILONS = ("ε", EPSILON_MIN, "ε_max")


@dataclass(frozen=True, eq=False)
class MarkedContacts:
    """Contacts with their normals, as they are drawn."""

    points: Floats
    """Shape (n, 3)."""
    normals: Floats
    """Inward unit normals, (n, 3)."""
    model: GraspModel | None = None
    """Friction and resolution of the cones."""
    held: GripperPose | None = None
    """Pose of the gripper; None: there is none, or it does not reach them: cones are drawn."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Inspection(MarkedContacts):
    """The grasp of one vertex, as it is listed and drawn.

    The vertex is the first contact, and the only one if it has no grasp.
    """

    vertex: int | None
    """None: a given grasp."""
    code: int
    """Label, or `UNSEARCHED`."""
    numbers: tuple[tuple[str, str], ...]
    """Names, and values with their units."""
    reason: str
    """One sentence: why it is S, M or U."""


def inspect(subject: Subject, vertex: int, model: GraspModel) -> Inspection:
    """Inspect the best grasp of a vertex, or say why there is none.

    Args:
        subject: The surface.
        vertex: Index of the vertex.
        model: Friction and resolution; fingers as the subject has them.
    """
    labels, openings = subject.labels, subject.labels.opening
    worst, best = labels.critical_angle[vertex], labels.critical_angle_best[vertex]
    points, normals = _contacts(subject, vertex)
    case = Case(
        model=model,
        mode=labels.mode,
        code=int(label_codes(subject, worst[None], best[None], model)[0]),
        worst=float(worst),
        best=float(best),
        cone=subject.cone,
        cause=cause_at(labels, vertex),
        off_line=_off_line(points, normals),
        hand=None if labels.scene is None else labels.scene.hand.name,
    )
    if case.located or not case.smooth:
        case = replace(case, creases=_creases(subject, vertex, several=len(points) > 1))
    return _inspection(
        subject, case, points, normals,
        vertex=vertex,
        epsilons=_epsilons(subject, vertex, model),
        opening=math.nan if openings is None else openings[vertex],
        force=_force_of(subject, vertex, model),
        pose=GripperPose.of(labels.reach, vertex),
    )  # fmt: skip


def inspect_given(subject: Subject, model: GraspModel) -> Inspection | None:
    """Inspect the given grasp, which is labelled as those of a scan are; None: there is none.

    Args:
        subject: The surface.
        model: Friction and resolution; fingers as the subject has them.
    """
    given = subject.given
    if given is None:
        return None
    over_worst, over_best = np.array([given.worst]), np.array([given.best])
    points, normals = given.contacts.points[0], given.contacts.normals[0]
    case = Case(
        model=model,
        mode="scan",
        code=int(label_angles(over_worst, over_best, model)[0]),
        worst=given.worst,
        best=given.best,
        cone=subject.cone,
        cause=None,
        off_line=_off_line(points, normals),
        creases=_fingers_on_creases(given.contacts),
    )
    gaps = np.linalg.norm(points[:, None] - points, axis=2)
    return _inspection(subject, case, points, normals, opening=gaps.max(), pose=given.held)


def _inspection(
    subject: Subject,
    case: Case,
    points: Floats,
    normals: Floats,
    *,
    vertex: int | None = None,
    epsilons: tuple[float, ...] = (),
    opening: float,
    force: HeldGrasp | None = None,
    pose: GripperPose | None,
) -> Inspection:
    """List the numbers of a grasp; those that are not known are left out."""
    numbers = [] if vertex is None else [("vertex", f"{vertex}")]
    numbers.append(("position", position_text(points[0], subject.mesh)))
    if vertex is not None and math.isinf(case.best):
        numbers.append(("β*", "no grasp"))
    else:
        numbers += angle_numbers(case)
        for name, epsilon in zip(EPSILONS, epsilons, strict=bool(epsilons)):
            numbers.append((name, f"{epsilon:.3g}" if math.isfinite(epsilon) else UNKNOWN))
        if math.isfinite(opening):
            numbers.append(("opening", subject.mesh.length_text(opening)))
        numbers += [] if force is None else force.numbers()
        numbers += _gripper_numbers(pose, subject.mesh)
        if case.off_line is not None:
            first, second = (math.degrees(angle) for angle in case.off_line)
            numbers.append(("normals off the line", f"{first:.1f}° and {second:.1f}°"))
    held = "" if force is None else force.sentence()
    return Inspection(
        points, normals, case.model, pose, vertex=vertex, code=case.code, numbers=tuple(numbers),
        reason=f"{explain(case)} {held}".rstrip(),
    )  # fmt: skip


def warm_up(subject: Subject) -> Subject:
    """Prepare the first picture and click: functions are compiled."""
    vertices = np.flatnonzero(subject.labels.reason == Reason.FOUND)
    if len(vertices):
        grasp = _grasp(subject.labels, int(vertices[0]))
        _epsilons_of(grasp, subject.labels.model)
        _held_by(subject, grasp, subject.labels.model)
    return subject


def _contacts(subject: Subject, vertex: int) -> tuple[Floats, Floats]:
    """Points and normals of a vertex's grasp, (n, 3) each; n = 1 without a grasp."""
    points, normals = subject.mesh.vertices[vertex][None], subject.mesh.normals[vertex][None]
    others, other_normals = subject.labels.partners[vertex], subject.labels.partner_normals[vertex]
    if subject.labels.reason[vertex] != Reason.FOUND or not np.isfinite(others).all():
        return points, normals
    return np.concatenate([points, others]), np.concatenate([normals, other_normals])


def _off_line(points: Floats, normals: Floats) -> tuple[float, float] | None:
    """Angles of two normals to the line through two contacts [rad], for the better grip."""
    if len(points) != PAIR:
        return None
    line = points[1] - points[0]
    length = np.linalg.norm(line)
    if not (length > 0.0 and (normals != 0.0).any(axis=1).all()):
        return None
    directions = np.stack([line, -line]) / length
    cosines = np.clip(np.einsum("ij,ij->i", normals, directions), -1.0, 1.0)
    first, second = (float(angle) for angle in np.arccos(cosines))
    if max(first, second) <= max(math.pi - first, math.pi - second):
        return first, second
    return math.pi - first, math.pi - second


def _force_of(subject: Subject, vertex: int, model: GraspModel) -> HeldGrasp | None:
    """Force and payload of a vertex's grasp; None: no load, or no grasp."""
    forces, labels = subject.forces, subject.labels
    if labels.load is None or labels.reason[vertex] != Reason.FOUND:
        return None
    if forces is not None and same_settings(forces.model, model):
        assert forces.load_result is not None
        return HeldGrasp(forces.load_result, vertex, labels.model.fingers)
    return _held_by(subject, _grasp(labels, vertex), model)


def _held_by(subject: Subject, grasp: SurfaceContacts, model: GraspModel) -> HeldGrasp | None:
    """Force and payload of one grasp; None: there is no load."""
    case = subject.labels.load_case
    if case is None:
        return None
    load_result = surface_load_result(grasp, replace(model, fingers=grasp.count), case)
    return HeldGrasp(load_result, 0, grasp.count)


def _gripper_numbers(pose: GripperPose | None, mesh: ObjectMesh) -> list[tuple[str, str]]:
    """Names and values that a gripper adds; those that are unknown are left out."""
    if pose is None:
        return []
    values = [
        ("pre-grasp opening", pose.pregrasp_opening, mesh.length_text(pose.pregrasp_opening)),
        ("approach margin", pose.approach_margin, f"±{math.degrees(pose.approach_margin):.1f}°"),
        ("inserted depth", pose.depth, mesh.length_text(round(pose.depth, 9), 3)),
    ]
    return [(name, text) for name, value, text in values if math.isfinite(value)]


def position_text(point: Floats, mesh: ObjectMesh) -> str:
    """Coordinates with four digits, and their unit; rounding errors of 0 are 0."""
    rounded = np.where(np.abs(point) < ROUNDING * mesh.size, 0.0, point)
    factor, unit = (1000.0, " mm") if mesh.unit else (1.0, "")
    return f"({', '.join(f'{factor * value:.4g}' for value in rounded)}){unit}"


def _epsilons(subject: Subject, vertex: int, model: GraspModel) -> tuple[float, float, float]:
    """Nominal, smallest and largest epsilon of a vertex's grasp; nan where unknown."""
    ranges = subject.epsilons
    if ranges is not None and same_settings(ranges.model, model):
        return ranges.epsilon[vertex], ranges.epsilon_min[vertex], ranges.epsilon_max[vertex]
    if subject.labels.reason[vertex] == Reason.FOUND:
        return _epsilons_of(_grasp(subject.labels, vertex), model)
    return math.nan, math.nan, math.nan


def _creases(subject: Subject, vertex: int, *, several: bool) -> tuple[int, ...]:
    """Fingers that are on sharp edges; without labels only the vertex itself is examined."""
    labels = subject.labels
    if several and labels.reason[vertex] == Reason.FOUND:
        return _fingers_on_creases(_grasp(labels, vertex))
    sides = np.count_nonzero(subject.mesh.corner_normals.vertices == vertex)
    return (0,) if sides > 1 else ()


def _grasp(labels: SurfaceLabels, vertex: int) -> SurfaceContacts:
    """A vertex that has a grasp, and the other contacts of it, (1, n)."""
    return labels.contacts.take(slice(vertex, vertex + 1))


def _fingers_on_creases(grasp: SurfaceContacts) -> tuple[int, ...]:
    """Indices of the fingers of a grasp (1, n) that are on sharp edges, from 0."""
    return tuple(int(finger) for finger in np.flatnonzero(grasp.on_crease[0]))


def _epsilons_of(grasp: SurfaceContacts, model: GraspModel) -> tuple[float, float, float]:
    """Nominal, smallest and largest epsilon of one grasp, shape (1, n).

    Sampling the tilts of three or more fingers takes too long for a click: nominal epsilon only.
    """
    nominal_only = model.tilts == "sampled_tilts" and grasp.count > PAIR
    if nominal_only:
        model = replace(model, sensor_resolution=0.0, method="exact")
    epsilons = surface_epsilons(grasp, model)
    values = (float(epsilons.nominal[0]), float(epsilons.minimum[0]), float(epsilons.maximum[0]))
    return (values[0], math.nan, math.nan) if nominal_only else values
