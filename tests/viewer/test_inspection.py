import math
import re
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from grasp3d import GraspModel, Label, SurfaceLabels, evaluate_grasps, scan_surface
from grasp3d.describe.explanations import Case, Cause, angle_text, explain
from grasp3d.pictures.colors import UNSEARCHED
from grasp3d.pictures.subject import subject_of
from grasp3d.surface import Reason
from grasp3d.viewer.inspection import inspect
from tests.helpers import viewing
from tests.helpers.vertex_labels import with_arrays


def _angles(points: NDArray[np.float64], normals: NDArray[np.float64]) -> list[float]:
    """Angles of both normals to the line through the contacts of an external grasp [degrees]."""
    line = points[1] - points[0]
    line /= np.linalg.norm(line)
    return [
        math.degrees(math.acos(float(np.clip(normal @ direction, -1.0, 1.0))))
        for normal, direction in zip(normals, (line, -line), strict=True)
    ]


def _smooth(labels: SurfaceLabels, code: int) -> int:
    """A vertex with a given label whose contacts have one normal each."""
    angles = labels.critical_angle
    known = np.flatnonzero((labels.label == code) & np.isfinite(angles))
    return int(next(v for v in known if _is_smooth(labels, v)))


def _is_smooth(labels: SurfaceLabels, vertex: int) -> bool:
    seen = inspect(subject_of(labels), vertex)
    worst = math.degrees(labels.critical_angle[vertex])
    same = labels.critical_angle[vertex] == labels.critical_angle_best[vertex]
    return same and abs(max(_angles(seen.points, seen.normals)) - worst) < 0.01


@pytest.mark.parametrize("code", [Label.S, Label.M])
def test_numbers_of_two_fingers_follow_from_the_contacts(code: Label) -> None:
    labels = viewing.labels()
    vertex = _smooth(labels, code)
    seen = inspect(subject_of(labels), vertex)
    first, second = _angles(seen.points, seen.normals)
    most, beta, tilt = max(first, second), math.degrees(math.atan(0.75)), 11.3
    numbers, opening = dict(seen.numbers), np.linalg.norm(seen.points[1] - seen.points[0])
    assert numbers["β*"] == f"{most:.1f}°"
    assert numbers["normals off the line"] == f"{first:.1f}° and {second:.1f}°"
    assert numbers["opening"] == f"{1000.0 * opening:.3g} mm"
    assert numbers["α*"] == f"{2.0 * (beta - most):.1f}°"
    assert numbers["vertex"] == str(vertex)
    assert numbers["position"].endswith(") mm")
    assert f"{most:.1f}° off the line through the contacts" in seen.reason
    assert f"{beta:.1f}° − {tilt}° = {beta - tilt:.1f}°" in seen.reason


@pytest.mark.parametrize("fingers", [2, 3])
def test_epsilon_of_one_grasp_agrees_with_evaluate_grasps(fingers: int) -> None:
    labels = viewing.labels() if fingers == 2 else viewing.three_fingers()
    vertex = int(np.flatnonzero(np.isfinite(labels.critical_angle))[7])
    model = replace(labels.model, friction=0.8, sensor_resolution=0.1)
    seen = inspect(subject_of(labels).at(model), vertex)
    grasp = evaluate_grasps(labels.mesh, seen.points, model)
    numbers = dict(seen.numbers)
    for name, key in (("epsilon", "ε"), ("epsilon_min", "ε_min"), ("epsilon_max", "ε_max")):
        assert float(numbers[key]) == pytest.approx(getattr(grasp, name)[0], abs=1e-3)


def test_a_vertex_without_a_grasp_has_one_contact() -> None:
    labels = viewing.labels()
    vertex = int(np.flatnonzero(labels.reason == Reason.OPENING)[0])
    seen = inspect(subject_of(labels), vertex)
    assert seen.points.shape == seen.normals.shape == (1, 3)
    assert np.array_equal(seen.points[0], labels.mesh.vertices[vertex])
    assert seen.code == Label.U
    assert ("β*", "no grasp") in seen.numbers
    assert seen.reason == ("U: the object is too wide or too narrow for the allowed openings here.")


def test_angles_of_an_internal_grasp_are_to_the_outward_directions() -> None:
    subject = subject_of(viewing.box())
    vertex = int(np.flatnonzero(viewing.box().critical_angle < 1e-6)[0])
    mesh = copy(subject.mesh)
    vars(mesh)["normals"] = -mesh.normals
    turned = viewing.with_values(
        subject_of(with_arrays(viewing.box(), mesh=mesh)),
        partner_normals=-subject.labels.partner_normals,
    )
    found, expected = (dict(inspect(one, vertex).numbers) for one in (turned, subject))
    assert found["normals off the line"] == expected["normals off the line"]


MODEL = GraspModel()  # β 26.565°, α/2 11.3°: S below 15.265°, U from 37.865°
SMOOTH = Case(MODEL, "label", Label.M, 0.54, 0.54, 0.66, None, (0.1, 0.54))


def _case(**changes: object) -> str:
    return explain(replace(SMOOTH, **changes))  # type: ignore[arg-type]


THREE, WIDE = GraspModel(fingers=3), GraspModel(friction=2.0)
S_CASE = {"code": Label.S, "worst": 0.1, "best": 0.1, "off_line": (0.1, 0.02)}
U_CASE = {"code": Label.U, "worst": 0.8, "best": 0.8, "off_line": (0.8, 0.3)}
U_ENDS = (
    "needs a friction angle above 45.8°, and no normal within the resolution allows more than "
    "26.6° + 11.3° = 37.9°."
)
ON_CREASE = {"code": Label.U, "worst": 1.2, "best": 0.8}
EVEN_BEST = "above 45.8° even with the best normals on"
HIDDEN = {"code": UNSEARCHED, "model": WIDE}


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({}, "stable below 26.6° − 11.3° = 15.3°, surely unstable from 26.6° + 11.3° = 37.9° on."),
        ({}, "M: the second finger's normal is 30.9° off the line through the contacts: surely"),
        ({"off_line": (0.54, 0.1)}, "the first finger's"),
        ({"off_line": (0.54, 0.54)}, "M: both contact normals are 30.9° off the line"),
        (
            {"model": THREE, "off_line": None},
            "M: the grasp is force-closed for friction angles above β* = 30.9°: surely stable",
        ),
        (
            {"model": replace(WIDE, sensor_resolution=1.2, fingers=3), "off_line": None},
            "no grasp of this number of fingers is surely unstable, as 63.4° + 34.4° = 97.8° is",
        ),
        (
            S_CASE,
            "S: no contact normal is more than 5.7° off the line through the contacts, below 26.6°",
        ),
        (
            {**S_CASE, "best": 0.05, "creases": (1,)},
            "of the adjacent faces; for the worst of these normals β* is 5.7°, below",
        ),
        ({**S_CASE, "model": GraspModel(sensor_resolution=0.0)}, "below β = 26.6°:"),
        (U_CASE, f"U: the best grasp found {U_ENDS}"),
        ({**U_CASE, "mode": "scan"}, f"U: the grasp {U_ENDS}"),
        (
            {**U_CASE, "model": GraspModel(sensor_resolution=0.0)},
            "the friction allows no more than β = 26.6°.",
        ),
        ({**ON_CREASE, "creases": (0, 1)}, f"{EVEN_BEST} the first finger's sharp edge, and no"),
        ({**ON_CREASE, "creases": (1,)}, f"{EVEN_BEST} a sharp edge, and no normal"),
        (
            {**HIDDEN, "worst": math.inf, "best": math.inf},
            "Not searched: grasps were searched up to β* 37.8°; 63.4° + 11.3° = 74.7° exceeds",
        ),
        (HIDDEN, "and the best of them has β* 30.9°;"),
    ],
)
def test_an_explanation_has_the_numbers_and_the_finger(changes: Any, text: str) -> None:
    assert text in _case(**changes)


@pytest.mark.parametrize(
    ("creases", "start"),
    [
        ((0,), "the first finger is on a sharp edge and may have any normal between those of"),
        ((0, 1), "both fingers are on sharp edges and may have any normals between those of"),
        ((0, 2, 3), "the first, third and fourth fingers are on sharp edges"),
        ((), "on a sharp edge a finger may have any normal between those of"),
    ],
)
def test_explanation_on_a_sharp_edge_has_the_finger_and_both_angles(
    creases: tuple[int, ...], start: str
) -> None:
    model = GraspModel(fingers=4 if 3 in creases else 2)
    reason = _case(worst=0.7, best=0.2, creases=creases, model=model, off_line=None)
    assert reason.startswith(f"M: {start}")
    assert "β* is 40.1° for the worst and 11.5° for the best of these normals; surely" in reason
    assert "unbounded for the worst" in _case(worst=math.inf, best=0.2, creases=creases)


def test_the_fingers_in_the_explanation_are_on_sharp_edges() -> None:
    """Of the box all bends are, and a scan with a finger at a corner has all kinds of contacts."""
    mesh = viewing.box().mesh
    corner = mesh.vertices[np.abs(mesh.vertices).sum(axis=1).argmax()]
    sides, named = np.abs(mesh.vertices).max(axis=0), set[str]()
    for labels in (viewing.box(), scan_surface(mesh, fixed=corner[None])):
        bent = labels.critical_angle > labels.critical_angle_best + 1e-3
        for vertex in np.flatnonzero(bent & (labels.label == Label.M)):
            seen = inspect(subject_of(labels), int(vertex))
            bends = ((np.abs(seen.points) > sides - 1e-9).sum(axis=1) > 1).tolist()
            start = "both fingers are" if all(bends) else "on a sharp edge a finger"
            if bends in ([True], [True, False], [False, True]):
                start = f"the {'first' if bends[0] else 'second'} finger is"
            assert seen.reason.startswith(f"M: {start}")
            named.add(start)
    assert named >= {"both fingers are", "the second finger is"}


@pytest.mark.parametrize(
    ("cause", "text"),
    [
        (Cause.NO_PARTNER, "U: no opposing contacts within the search cone of 37.8°."),
        (Cause.LIMITS, "U: the object is too wide or too narrow for the allowed openings"),
        (Cause.OFF_SURFACE, "U: the vertex belongs to no face."),
        (Cause.SAME_POINT, "U: a fixed finger is at this point."),
    ],
)
def test_explanation_without_a_grasp_has_the_cause(cause: Cause, text: str) -> None:
    none = {"code": Label.U, "worst": math.inf, "best": math.inf, "off_line": None}
    assert text in _case(**none, cause=cause)
    assert "franka" not in _case(**none, cause=cause, hand="franka")
    missed = _case(**none, cause=Cause.TABLE, hand="franka")
    assert missed.endswith("franka reaches none of those tested: the table is in the way.")


def test_an_angle_has_enough_decimals_to_differ_from_its_limit() -> None:
    assert angle_text(0.5, 0.9) == "28.6°"
    assert angle_text(0.5, 0.5) == "28.6°"
    assert angle_text(0.5, 0.49995) == "28.648°"
    assert re.fullmatch(r"28\.\d{4}°", angle_text(0.5, 0.5 + 1e-9))
