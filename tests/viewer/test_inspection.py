import math
import re
from copy import copy
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from grasp3d import GraspModel, Label, SurfaceLabels, evaluate_grasps, scan_surface
from grasp3d.describe.explanations import Case, Cause, angle_text, explain
from grasp3d.pictures.colors import UNSEARCHED, labels_at
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
    numbers = dict(seen.numbers)
    assert numbers["β*"] == f"{max(first, second):.1f}°"
    assert numbers["normals off the line"] == f"{first:.1f}° and {second:.1f}°"
    assert (
        numbers["opening"] == f"{1000.0 * np.linalg.norm(seen.points[1] - seen.points[0]):.3g} mm"
    )
    alpha = 2.0 * (math.degrees(math.atan(0.75)) - max(first, second))
    assert numbers["α*"] == f"{alpha:.1f}°"
    assert numbers["vertex"] == str(vertex)
    assert numbers["position"].endswith(") mm")
    assert f"{max(first, second):.1f}° off the line through the contacts" in seen.reason
    beta, tilt = math.degrees(math.atan(0.75)), 11.3
    assert f"{beta:.1f}° − {tilt}° = {beta - tilt:.1f}°" in seen.reason
    if code == Label.M:
        finger = ("first", "second")[int(second > first)]
        subject = f"the {finger} finger's normal is"
        if abs(first - second) < 0.005:
            subject = "both contact normals are"
        assert seen.reason.startswith(f"M: {subject}")
        assert f"surely unstable from {beta:.1f}° + {tilt}° = {beta + tilt:.1f}° on" in seen.reason
    else:
        assert seen.reason.startswith("S: no contact normal is more than")


@pytest.mark.parametrize("fingers", [2, 3])
def test_epsilon_of_one_grasp_agrees_with_evaluate_grasps(fingers: int) -> None:
    labels = viewing.labels() if fingers == 2 else viewing.three_fingers()
    vertex = int(np.flatnonzero(np.isfinite(labels.critical_angle))[7])
    model = replace(labels.model, friction=0.8, sensor_resolution=0.1)
    seen = inspect(subject_of(labels).at(model), vertex)
    grasp = evaluate_grasps(labels.mesh, seen.points, model)
    numbers = dict(seen.numbers)
    for name in ("epsilon", "epsilon_min", "epsilon_max"):
        key = {"epsilon": "ε", "epsilon_min": "ε_min", "epsilon_max": "ε_max"}[name]
        assert float(numbers[key]) == pytest.approx(getattr(grasp, name)[0], abs=1e-3), name


def test_a_vertex_without_a_grasp_has_one_contact() -> None:
    labels = viewing.labels()
    vertex = int(np.flatnonzero(labels.reason == Reason.OPENING)[0])
    seen = inspect(subject_of(labels), vertex)
    assert seen.points.shape == seen.normals.shape == (1, 3)
    assert np.array_equal(seen.points[0], labels.mesh.vertices[vertex])
    assert seen.code == Label.U
    assert ("β*", "no grasp") in seen.numbers
    assert seen.reason == (
        "U: the object is too wide or too narrow for the limits of the search here."
    )


def test_angles_of_an_internal_grasp_are_to_the_outward_directions() -> None:
    subject = subject_of(viewing.box())
    vertex = int(np.flatnonzero(viewing.box().critical_angle < 1e-6)[0])
    assert subject.labels.partner_normals is not None
    mesh = copy(subject.mesh)
    vars(mesh)["normals"] = -mesh.normals
    turned = viewing.with_values(
        subject_of(with_arrays(viewing.box(), mesh=mesh)),
        partner_normals=-subject.labels.partner_normals,
    )
    assert (
        dict(inspect(turned.at(subject.labels.model), vertex).numbers)["normals off the line"]
        == (dict(inspect(subject, vertex).numbers)["normals off the line"])
    )


MODEL = GraspModel()  # β 26.565°, α/2 11.3°: S below 15.265°, U from 37.865°
SMOOTH = Case(MODEL, "label", Label.M, 0.54, 0.54, 0.66, None, (0.1, 0.54))


def _case(**changes: object) -> str:
    return explain(replace(SMOOTH, **changes))  # type: ignore[arg-type]


def test_explanation_of_m_has_the_finger_and_both_limits() -> None:
    assert explain(SMOOTH) == (
        "M: the second finger's normal is 30.9° off the line through the contacts: surely stable "
        "below 26.6° − 11.3° = 15.3°, surely unstable from 26.6° + 11.3° = 37.9° on."
    )
    assert "the first finger's" in _case(off_line=(0.54, 0.1))
    assert "M: both contact normals are 30.9° off the line" in _case(off_line=(0.54, 0.54))


def test_explanation_of_m_for_three_fingers_has_the_critical_angle() -> None:
    model = GraspModel(fingers=3)
    assert _case(model=model, off_line=None).startswith(
        "M: the grasp is force-closed for friction angles above β* = 30.9°: surely stable below"
    )
    wide = GraspModel(friction=2.0, sensor_resolution=1.2, fingers=3)
    assert (
        "no grasp of this number of fingers is surely unstable, as 63.4° + 34.4° = 97.8° is not"
        in _case(model=wide, worst=0.6, best=0.6, off_line=None)
    )


@pytest.mark.parametrize(
    ("creases", "fingers", "start"),
    [
        ((0,), 2, "the first finger is on a sharp edge and may have any normal between those of"),
        ((2,), 3, "the third finger is on a sharp edge"),
        ((0, 1), 2, "both fingers are on sharp edges and may have any normals between those of"),
        ((0, 1), 3, "the first and second fingers are on sharp edges"),
        ((0, 2, 3), 4, "the first, third and fourth fingers are on sharp edges"),
        ((), 2, "on a sharp edge a finger may have any normal between those of"),
    ],
)
def test_explanation_on_a_sharp_edge_has_the_finger_and_both_angles(
    creases: tuple[int, ...], fingers: int, start: str
) -> None:
    model = GraspModel(fingers=fingers)
    reason = _case(worst=0.7, best=0.2, creases=creases, model=model, off_line=None)
    assert reason.startswith(f"M: {start}")
    assert (
        "faces: β* is 40.1° for the worst and 11.5° for the best of these normals; surely stable"
    ) in reason
    assert "unbounded for the worst" in _case(worst=math.inf, best=0.2, creases=creases)


def _bend(labels: SurfaceLabels, point: NDArray[np.float64]) -> float:
    """Largest angle between the normals of the faces at a point [degrees]."""
    corners = labels.mesh.vertices[labels.mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    flat = np.abs(np.einsum("ij,ij->i", normals, point - corners[:, 0])) < 1e-9
    for at in range(3):
        side = corners[:, (at + 1) % 3] - corners[:, at]
        within = np.cross(normals, side)
        flat &= np.einsum("ij,ij->i", within, point - corners[:, at]) > -1e-9
    cosines = np.clip(normals[flat] @ normals[flat].T, -1.0, 1.0)
    return math.degrees(math.acos(float(cosines.min())))


def test_the_fingers_in_the_explanation_are_on_sharp_edges() -> None:
    """On the cone and the box every bend is a sharp edge, and a scan has contacts on them."""
    mesh = viewing.box().mesh
    corner = mesh.vertices[np.abs(mesh.vertices).sum(axis=1).argmax()]
    scan = scan_surface(mesh, fixed=corner[None])
    named = set()
    for labels in (viewing.labels(), viewing.box(), scan):
        subject = subject_of(labels)
        bent = labels.critical_angle > labels.critical_angle_best + 1e-3
        for vertex in np.flatnonzero(bent & (labels.label == Label.M)):
            seen = inspect(subject.at(labels.model), int(vertex))
            bends = [_bend(labels, point) > 1.0 for point in seen.points]
            start = "both fingers are" if all(bends) else "on a sharp edge a finger"
            if bends in ([True], [True, False], [False, True]):
                start = f"the {'first' if bends[0] else 'second'} finger is"
            assert seen.reason.startswith(f"M: {start}"), vertex
            named.add(start)
    assert named >= {"both fingers are", "the first finger is"}


def test_explanation_of_s_on_smooth_parts_sharp_edges_and_for_a_perfect_sensor() -> None:
    assert _case(code=Label.S, worst=0.1, best=0.1, off_line=(0.1, 0.02)) == (
        "S: no contact normal is more than 5.7° off the line through the contacts, below 26.6° − "
        "11.3° = 15.3°: the grasp is stable for all true normals within the sensor resolution."
    )
    assert "of the adjacent faces; for the worst of these normals β* is 5.7°, below" in _case(
        code=Label.S, worst=0.1, best=0.05, creases=(1,)
    )
    perfect = GraspModel(sensor_resolution=0.0)
    assert "below β = 26.6°:" in _case(
        model=perfect, code=Label.S, worst=0.1, best=0.1, off_line=(0.1, 0.02)
    )


def test_explanation_of_u_for_a_search_and_a_scan() -> None:
    bad = {"code": Label.U, "worst": 0.8, "best": 0.8, "off_line": (0.8, 0.3)}
    ends = (
        "needs a friction angle above 45.8°, and no normal within the resolution allows more than "
        "26.6° + 11.3° = 37.9°."
    )
    assert _case(**bad) == f"U: the best grasp found {ends}"
    assert _case(**bad, mode="scan") == f"U: the grasp {ends}"
    crease = {"code": Label.U, "worst": 1.2, "best": 0.8}
    above = "above 45.8° even with the best normals on "
    assert f"{above}the first finger's sharp edge, and no normal" in _case(**crease, creases=(0, 1))
    assert f"{above}a sharp edge, and no normal" in _case(**crease, creases=(1,))
    perfect = GraspModel(sensor_resolution=0.0)
    assert "the friction allows no more than β = 26.6°." in _case(**bad, model=perfect)


@pytest.mark.parametrize(
    ("cause", "text"),
    [
        (Cause.NO_PARTNER, "U: no opposing contacts within the search cone of 37.8°."),
        (Cause.LIMITS, "U: the object is too wide or too narrow for the limits of the search"),
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


def test_explanation_of_unsearched_vertices() -> None:
    wide = GraspModel(friction=2.0)
    assert _case(model=wide, code=UNSEARCHED, worst=math.inf, best=math.inf) == (
        "Not searched: grasps were searched up to β* 37.8°; 63.4° + 11.3° = 74.7° exceeds this "
        "limit."
    )
    assert "and the best of them has β* 30.9°;" in _case(model=wide, code=UNSEARCHED)


@pytest.mark.parametrize("fingers", [2, 3])
def test_in_a_scan_the_partners_are_the_fixed_fingers(fingers: int) -> None:
    labels = viewing.scan(fingers)
    subject = subject_of(labels)
    fixed = labels.mesh.vertices[[30, 60][: fingers - 1]]
    seen = inspect(subject.at(labels.model), 200)
    assert seen.points[1:] == pytest.approx(fixed)
    at_finger = inspect(subject.at(labels.model), 30)
    if fingers == 2:
        assert at_finger.reason == "U: a fixed finger is at this point."
    codes = labels_at(subject.at(labels.model))
    unstable = np.flatnonzero((codes == Label.U) & np.isfinite(labels.critical_angle_best))
    if len(unstable):
        reason = inspect(subject.at(labels.model), int(unstable[0])).reason
        assert reason.startswith("U: the grasp needs a friction angle above")


def test_an_angle_has_enough_decimals_to_differ_from_its_limit() -> None:
    assert angle_text(0.5, 0.9) == "28.6°"
    assert angle_text(0.5, 0.5) == "28.6°"
    assert angle_text(0.5, 0.49995) == "28.648°"
    assert re.fullmatch(r"28\.\d{4}°", angle_text(0.5, 0.5 + 1e-9))


@pytest.mark.slow
def test_every_explanation_is_one_complete_line() -> None:
    subject = subject_of(viewing.labels())
    for vertex in range(0, len(subject.mesh.vertices), 5):
        for friction in (0.2, 0.75, 1.5):
            model = replace(subject.model, friction=friction)
            reason = inspect(subject.at(model), vertex).reason
            assert reason.endswith(".")
            assert "\n" not in reason
            assert "nan" not in reason
            assert "inf" not in reason
