"""One vertex and its grasp: the numbers, and why it is S, M or U."""

import math
from dataclasses import dataclass, replace

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.settings import GraspModel
from grasp3d.stability.thresholds import max_resolution
from grasp3d.surface.contacts import SurfaceContacts
from grasp3d.surface.epsilon import surface_epsilons
from grasp3d.surface.labels import Reason, SurfaceLabels
from grasp3d.viewer.session.explaining import PAIR, Case, explain
from grasp3d.viewer.session.painting import codes_of, is_of
from grasp3d.viewer.subjects.subject import Subject

UNKNOWN = "–"


@dataclass(frozen=True, eq=False)
class Inspected:
    """What is told and drawn of a vertex."""

    vertex: int
    code: int
    """Label, or `UNSEARCHED`."""
    points: Floats
    """Contacts of its grasp, the vertex first; that alone where it has none. (n, 3)"""
    normals: Floats
    """Inward unit normals there, (n, 3)."""
    model: GraspModel
    """Friction and resolution that it is told for."""
    numbers: tuple[tuple[str, str], ...]
    """What is measured: what it is called, and the value with its unit."""
    reason: str
    """One sentence: why it is S, M or U."""


def inspect(subject: Subject, vertex: int, model: GraspModel) -> Inspected:
    """Look at one vertex.

    Args:
        subject: The surface.
        vertex: Which.
        model: Friction and resolution; fingers as the subject has them.
    """
    worst, best = subject.critical_angle[vertex], subject.critical_angle_best[vertex]
    code = int(codes_of(subject, worst[None], best[None], model)[0])
    points, normals = _contacts(subject, vertex)
    off = _off_line(points, normals) if len(points) == PAIR else None
    case = Case(
        model=model,
        mode=subject.mode,
        code=code,
        worst=float(worst),
        best=float(best),
        cone=subject.cone,
        reason=_reason(subject, vertex),
        off_line=off,
    )
    if not case.smooth:
        case = replace(case, creases=_creases(subject, vertex, several=len(points) > 1))
    return Inspected(
        vertex, code, points, normals, model, _numbers(subject, vertex, case), explain(case)
    )


def warm_up(subject: Subject) -> Subject:
    """Look at one grasp, so that what this needs is compiled and at hand when a user does."""
    found = np.flatnonzero(subject.reason == Reason.FOUND)
    if subject.labels is not None and len(found):
        _measured(subject.labels, int(found[0]), subject.model)
    return subject


def _contacts(subject: Subject, vertex: int) -> tuple[Floats, Floats]:
    """Points and normals of a vertex's grasp, (n, 3) each; of the vertex alone without one."""
    points, normals = subject.vertices[vertex][None], subject.normals[vertex][None]
    if subject.partners is None or subject.partner_normals is None:
        return points, normals
    others, pushes = subject.partners[vertex], subject.partner_normals[vertex]
    if subject.reason[vertex] != Reason.FOUND or not np.isfinite(others).all():
        return points, normals
    return np.concatenate([points, others]), np.concatenate([normals, pushes])


def _off_line(points: Floats, normals: Floats) -> tuple[float, float] | None:
    """Angles of two normals to the line of the fingers [rad], the way that they hold better."""
    line = points[1] - points[0]
    length = np.linalg.norm(line)
    if not (length > 0.0 and (normals != 0.0).any(axis=1).all()):
        return None
    ways = np.stack([line, -line]) / length
    cosines = np.clip(np.einsum("ij,ij->i", normals, ways), -1.0, 1.0)
    first, second = (float(angle) for angle in np.arccos(cosines))
    if max(first, second) <= max(math.pi - first, math.pi - second):
        return first, second
    return math.pi - first, math.pi - second


def _reason(subject: Subject, vertex: int) -> Reason | None:
    """Why there is no grasp; None: nothing tells, as a limited search of a lone file."""
    reason, sampling = Reason(int(subject.reason[vertex])), subject.sampling
    limited = sampling is not None and (
        sampling.min_opening > 0.0
        or math.isfinite(min(sampling.max_opening, sampling.max_spread))
        or sampling.min_separation is not None
    )
    unnamed = subject.partners is None and reason == Reason.NO_PARTNER
    return None if unnamed and limited else reason


def _numbers(subject: Subject, vertex: int, case: Case) -> tuple[tuple[str, str], ...]:
    unit = f" {subject.unit}" if subject.unit else ""
    place = ", ".join(f"{value:.4g}" for value in subject.vertices[vertex])
    told = [("vertex", f"{vertex}"), ("place", f"({place}){unit}")]
    if math.isinf(case.best):
        return (*told, ("β*", "no grasp"))
    told += [("β*", _both(case)), ("α*", _coarsest(case))]
    names = ("ε", "smallest ε", "largest ε")
    told += zip(names, _epsilons(subject, vertex, case.model), strict=True)
    opening = subject.opening[vertex]
    if math.isfinite(opening):
        told.append(("opening", f"{opening:.4g}{unit}"))
    if case.off_line is not None:
        one, two = (math.degrees(angle) for angle in case.off_line)
        told.append(("normals off the line", f"{one:.1f}° and {two:.1f}°"))
    return tuple(told)


def _both(case: Case) -> str:
    worst, best = (f"{math.degrees(angle):.1f}°" for angle in (case.worst, case.best))
    if worst == best:
        return worst
    return f"{worst if math.isfinite(case.worst) else 'none'} (worst), {best} (best normals)"


def _coarsest(case: Case) -> str:
    coarsest = float(max_resolution(np.array(case.worst), case.model))
    return f"{math.degrees(coarsest):.1f}°" if coarsest > 0.0 else "no sensor is fine enough"


def _epsilons(subject: Subject, vertex: int, model: GraspModel) -> list[str]:
    """Nominal, smallest and largest epsilon of a vertex's grasp, as far as they are at hand."""
    known, values = subject.epsilons, (math.nan,) * 3
    if known is not None and is_of(known.model, model):
        most = known.maximum
        values = (known.nominal[vertex], known.minimum[vertex],
                  math.nan if most is None else most[vertex])  # fmt: skip
    elif subject.labels is not None and subject.reason[vertex] == Reason.FOUND:
        values = _measured(subject.labels, vertex, model)
    return [f"{value:.3g}" if math.isfinite(value) else UNKNOWN for value in values]


def _creases(subject: Subject, vertex: int, *, several: bool) -> tuple[int, ...]:
    """Fingers of a vertex's grasp that are on creases; of a file that of the vertex alone."""
    labels = subject.labels
    if several and labels is not None and (labels.partner_points.faces[vertex, 0] >= 0).all():
        return tuple(int(finger) for finger in np.flatnonzero(_grasp(labels, vertex).on_crease[0]))
    sides = np.count_nonzero(subject.corner_normals.vertices == vertex)
    return (0,) if sides > 1 else ()


def _grasp(labels: SurfaceLabels, vertex: int) -> SurfaceContacts:
    """A vertex and the other contacts of its grasp."""
    mesh, places = labels.mesh, labels.partner_points
    own = int(mesh.canonical[vertex])
    face, corner = divmod(int(np.argmax(mesh.faces.ravel() == own)), 3)
    first = SurfacePoints(np.array([[face]]), np.eye(3)[corner][None, None])
    return SurfaceContacts(
        mesh,
        SurfacePoints(
            np.concatenate([first.faces, places.faces[vertex, 0][None]], axis=1),
            np.concatenate([first.weights, places.weights[vertex, 0][None]], axis=1),
        ),
    )


def _measured(labels: SurfaceLabels, vertex: int, model: GraspModel) -> tuple[float, float, float]:
    """Epsilons of one vertex's grasp.

    Where tilts of three fingers and more are sampled there are too many: the middle alone is told.
    """
    grasp = _grasp(labels, vertex)
    plain = model.tilts == "sampled_tilts" and grasp.count > PAIR
    asked = model
    if plain:
        asked = replace(model, sensor_resolution=0.0, method="exact")
    found = surface_epsilons(grasp, asked, threads=1)
    values = (float(found.nominal[0]), float(found.minimum[0]), float(found.maximum[0]))
    return (values[0], math.nan, math.nan) if plain else values
