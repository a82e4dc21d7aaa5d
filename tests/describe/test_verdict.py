"""Verdicts: every case has its sentence, none contradicts its figures; facts of one grasp."""

import math
import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import trimesh

from grasp3d import (
    GraspModel,
    Load,
    ObjectMesh,
    Sampling,
    SurfaceLabels,
    Table,
    best_grasps,
    evaluate_grasps,
    label_surface,
    load_mesh,
)
from grasp3d.describe import facts, verdict_of
from grasp3d.describe.explanations import Cause, cause_fractions, position_text
from grasp3d.describe.verdict import LoadVerdict, Remedy, Verdict
from grasp3d.grasps import EvaluatedPoses
from grasp3d.hand.parallel_gripper import ParallelGripper
from grasp3d.hand.table import Approach
from grasp3d.stability.label import Label
from grasp3d.surface.fields import NONE
from grasp3d.surface.load_case import HARD_FINGERS
from tests.helpers import shapes
from tests.helpers.grippers import HAND

FINER = Remedy("sensor_resolution", math.radians(12.4), math.radians(30.0))
MORE = Remedy("friction", 0.71, 0.5)
FORCE = Remedy("grip_force", 25.0, 10.0)
LESS = Remedy("mass", 0.19, 0.5)


def best(word: str, **fields: object) -> Verdict:
    values = {"by": "franka", "resolution": 0.4, "max_resolution": 0.5, **fields}
    return Verdict(word, **values)  # type: ignore[arg-type]


def loaded(**fields: object) -> LoadVerdict:
    """What a load takes; 0.5 kg with 10 N available, which are enough."""
    values = {
        "holds": True, "mass": 0.5, "available": 10.0, "needed": 8.0, "payload": 0.6,
        "what": "hold 0.5 kg in every orientation",
    }  # fmt: skip
    return LoadVerdict(**{**values, **fields})  # type: ignore[arg-type]


little = loaded(holds=False, needed=25.0, payload=0.19)
nothing = loaded(holds=False, needed=math.inf, payload=0.0)
pushed = loaded(mass=None, payload=math.nan, what="resist wrench 0,0,-5,0,0,0")
no_mass = loaded(holds=None, mass=None, what="hold each kilogram in every orientation")

A_SENSOR = "a sensor of 12.4° or finer instead of 30°"
TO_HOLD = "hold 0.5 kg in every orientation"
SPARE = "the best has 5.7° of resolution to spare."
NOTHING = "No change of sensor, friction, force or mass alone makes it sure."
MORE_FORCE = "25 N instead of 10 N, or with 0.19 kg instead of 0.5 kg."
CASES = [
    (best("surely", count=3, of=12), f"3 of 12 grasps; {SPARE}"),
    (
        best("surely", count=5, load_result=loaded(), grip_force=8.6),
        f"5 distinct grasps; the best needs 8.6 N of 10 N to {TO_HOLD}.",
    ),
    (
        best("surely", count=5, load_result=pushed, grip_force=7.0),
        "5 distinct grasps; the best needs 7 N of 10 N to resist wrench 0,0,-5,0,0,0.",
    ),
    (
        best("surely", count=5, load_result=no_mass),
        f"5 distinct grasps; {SPARE} 10 N hold 0.6 kg in every orientation.",
    ),
    (
        best("perhaps", remedies=(FINER, MORE)),
        (
            f"no grasp is surely stable at a sensor resolution of 22.9°. Surely with {A_SENSOR}, "
            "or with a friction of 0.71 or more instead of 0.5."
        ),
    ),
    (
        best("perhaps", load_result=little, remedies=(FINER, FORCE, LESS)),
        (
            f"the sensor cannot tell whether 10 N can {TO_HOLD}. Surely with {A_SENSOR}, with "
            f"{MORE_FORCE}"
        ),
    ),
    (
        best("perhaps", load_result=loaded(), wrong="contacts may leave the pads"),
        f"contacts may leave the pads. {NOTHING}",
    ),
    (
        best("not", load_result=little, remedies=(FORCE, LESS)),
        f"10 N is too little to {TO_HOLD}. Surely with {MORE_FORCE}",
    ),
    (
        best("not", load_result=replace(nothing, reason=HARD_FINGERS)),
        f"no force suffices to {TO_HOLD}: {HARD_FINGERS}.",
    ),
    (
        best("not", load_result=replace(no_mass, needed=math.inf)),
        "no force suffices to hold any mass in every orientation.",
    ),
    (  # the load is held, and something else is not sure
        best("perhaps", load_result=loaded()),
        f"no grasp is surely stable at a sensor resolution of 22.9°. {NOTHING}",
    ),
    (best("not", lost=True), "once the jaws close, no grasp was found that may be stable."),
    (
        Verdict("not", "franka", causes={Cause.TABLE: 0.9, Cause.BLOCKED: 0.1}),
        "the table is in the way on 90 % of the surface.",
    ),
]


@pytest.mark.parametrize(("verdict", "sentence"), CASES)
def test_each_case_has_its_sentence(verdict: Verdict, sentence: str) -> None:
    assert str(verdict) == f"{verdict.word.capitalize()} held by franka: {sentence}"


WORDS = ("not", "perhaps", "surely")
MODEL = GraspModel(friction=0.4, sensor_resolution=math.radians(15.0))


@cache
def block() -> ObjectMesh:
    return load_mesh(shapes.box((60.0, 40.0, 20.0)), unit="mm", max_edge="10mm")


def beside(mesh: ObjectMesh, model: GraspModel = MODEL, **options: object) -> SurfaceLabels:
    options = {"hand": HAND, **options}
    return label_surface(mesh, model, **options)


def changed(labels: SurfaceLabels, remedy: Remedy) -> SurfaceLabels:
    model, scene, load = labels.model, labels.scene, labels.load
    if remedy.setting in {"sensor_resolution", "friction"}:
        model = replace(model, **{remedy.setting: remedy.value})
    elif remedy.setting in {"grip_force", "mass"}:
        assert load is not None
        load = replace(load, **{remedy.setting: remedy.value})
    else:
        assert scene is not None
        scene = replace(scene, hand=scene.hand.opening_to(remedy.value))
    return label_surface(labels.mesh, model, sampling=labels.sampling, scene=scene, load=load)


def check(labels: SurfaceLabels) -> Verdict:
    """Check a verdict against the figures beside it, and that its remedies help."""
    verdict, load_result, best = verdict_of(labels), labels.load_result, best_grasps(labels, 10)
    decided = load_result is not None and load_result.label is not None
    codes = load_result.label if decided else labels.label
    ideal = WORDS[int(codes[labels.mesh.on_surface].max())]
    posed = isinstance(best, EvaluatedPoses)
    if posed:
        assert verdict.word == WORDS[max(best.letter, default=0)]
        assert verdict.count >= (best.letter == Label.S).sum()
        if load_result is None or decided:
            assert verdict.lost == (WORDS.index(verdict.word) < WORDS.index(ideal))
    elif load_result is None or decided or math.isfinite(verdict.load_result.needed):
        assert verdict.word == ideal
    assert (verdict.count > 0) == (verdict.word == "surely")
    causes = cause_fractions(labels)
    sums = sum(labels.mesh.vertex_areas[codes == 0]) / labels.mesh.vertex_areas.sum()
    assert sum(causes.values()) == pytest.approx(sums, abs=1e-9)
    if load_result is None:
        assert sum(causes.values()) == pytest.approx(labels.fractions()["U"], abs=1e-9)
        if verdict.word == "surely" and labels.model.method == "exact":
            assert verdict.spare_resolution > 0.0
    elif verdict.word == "surely" and decided:
        needed = best.grip_force if posed else best.load_result.grip_force_largest
        assert verdict.grip_force <= load_result.available
        assert verdict.grip_force == needed[0]
    text = str(verdict)
    assert not re.search(r"-\d|nan|\binf\b|None|±0°| 0\.0°", text)
    assert text.count(". ") <= 2
    for remedy in verdict.remedies:
        assert verdict_of(changed(labels, remedy)).word == "surely", remedy
    return verdict


def test_a_block_is_held() -> None:
    labels = beside(block(), table=Table.below(block()))
    verdict = check(labels)
    # Opposite sides: the critical angle is 0, and alpha* twice the friction angle.
    assert verdict.max_resolution == pytest.approx(2.0 * math.atan(0.4), abs=1e-6)
    assert verdict.spare_resolution == pytest.approx(verdict.max_resolution - math.radians(15.0))
    assert verdict.count >= (best_grasps(labels, 10).letter == Label.S).sum() == 10
    assert str(verdict).startswith(
        f"Surely held by {HAND.name}: {verdict.count} distinct grasps; the best has 28.6° of"
    )


@pytest.mark.slow
def test_a_coarse_sensor_needs_to_be_finer_or_friction_larger() -> None:
    coarse = replace(MODEL, sensor_resolution=math.radians(50.0))
    labels = beside(block(), coarse)
    verdict = check(labels)
    finer, more = verdict.remedies
    assert finer.value == pytest.approx(math.radians(43.6))
    assert more.value == pytest.approx(0.47)  # tan 25 degrees is 0.4663
    for remedy, step in ((finer, math.radians(0.1)), (more, -0.01)):
        short = replace(remedy, value=remedy.value + step)
        assert verdict_of(changed(labels, short)).word == "perhaps"


def test_what_is_not_reached_has_the_cause_of_most_of_the_surface() -> None:
    sideways = Approach((0.0, 0.0, 1.0), within=math.radians(1.0))
    plate = load_mesh(shapes.box((120.0, 80.0, 3.0)), unit="mm", max_edge="10mm")
    for labels, cause in (
        (beside(plate, table=Table.below(plate)), Cause.TABLE),
        (beside(plate, approach=sideways), Cause.DIRECTION),
    ):
        verdict = check(labels)
        assert f"Not held by {HAND.name}: {cause}" in str(verdict)
        assert (verdict.count, verdict.max_resolution, verdict.remedies) == (0, 0.0, ())
        assert math.isnan(verdict.spare_resolution)


def test_without_a_gripper_limits_of_openings_are_no_stroke() -> None:
    verdict = check(beside(block(), hand=None, sampling=Sampling(max_opening="5mm")))
    assert str(verdict).startswith(f"Not held by two fingers: {Cause.LIMITS}")
    check(beside(block(), hand=None))


@cache
def small_box() -> SurfaceLabels:
    mesh = load_mesh(shapes.box((0.08, 0.05, 0.03)), unit="m", max_edge=0.02)
    return label_surface(mesh, GraspModel(torsion_radius="3mm", sensor_resolution=0.2))


@pytest.mark.slow
@pytest.mark.parametrize("force", [None, 40.0, 9.0, 5.0])
@pytest.mark.parametrize("mass", [None, 0.5])
def test_a_load_of_the_box(mass: float | None, force: float | None) -> None:
    labels = small_box().using(load=Load(mass=mass, grip_force=force))
    verdict = check(labels)
    load_result = verdict.load_result
    assert load_result is not None
    assert load_result.needed == pytest.approx(np.nanmin(labels.load_result.grip_force_largest))
    if mass is None or force is None:
        assert (verdict.word, load_result.holds) == ("surely", None)
        number = load_result.payload if force else load_result.needed
        assert f"{number:.3g} " in str(verdict).rsplit(". ", maxsplit=1)[1]
    else:
        assert load_result.holds == (force >= load_result.needed) == (verdict.word == "surely")


@pytest.mark.slow
@pytest.mark.parametrize("angle", [70.0, 45.0])
def test_a_finer_sensor_or_more_force_holds_the_load(angle: float) -> None:
    """Between the forces at the sensed and at the worst normals the sensor decides."""
    model = replace(small_box().model, sensor_resolution=math.radians(angle))
    labels = small_box().using(model=model, load=Load(mass=0.5, grip_force=9.0))
    verdict = check(labels)
    assert verdict.word == "perhaps"
    assert {one.setting for one in verdict.remedies} >= {"sensor_resolution"}


@pytest.mark.slow
def test_reasons_why_no_force_holds() -> None:
    task = "wrench 0,0,-5,0,0,0"
    given = verdict_of(small_box().using(load=Load(task=task, grip_force=8)))
    assert f"to resist {task}" in str(given)
    off = load_mesh(shapes.box((0.08, 0.05, 0.03)), unit="m", max_edge=0.02,
                    center_of_mass="3mm,1mm,2mm")  # fmt: skip
    hard = replace(small_box().model, torsion_radius=0.0)
    for force in (None, 20.0):
        verdict = check(label_surface(off, hard, load=Load(mass=0.5, grip_force=force)))
        assert verdict.word == "not"
        assert HARD_FINGERS in str(verdict)


def test_given_grasps_are_judged_by_the_same_words() -> None:
    mesh, points = block(), 1e-3 * np.array([[[0, -20, 0], [0, 20, 0]], [[-30, 0, 5], [30, 0, -5]]])
    verdict = verdict_of(evaluate_grasps(mesh, points, MODEL))
    assert str(verdict).startswith("Surely held by two fingers: 2 of 2 grasps; the best has 28.6°")
    coarse = replace(MODEL, sensor_resolution=math.radians(50.0))
    text = str(verdict_of(evaluate_grasps(mesh, points, coarse)))
    assert text.startswith("Perhaps held by two fingers: no grasp is surely stable")
    ball = load_mesh(shapes.sphere(2), unit="cm", max_edge=9.0)
    six = 0.01 * np.concatenate([np.eye(3), -np.eye(3)])[None]
    text = str(verdict_of(evaluate_grasps(ball, six, MODEL)))
    assert text.startswith("Surely held by 6 fingers: 1 of 1 grasps")


def test_collisions_and_errors_of_poses_are_no_matter_of_force() -> None:
    """Jaws that close on the object in a table hold it firmly, and cannot be there."""
    mesh = load_mesh(shapes.box((60.0, 40.0, 20.0)), unit="mm", max_edge="10mm")
    poses = np.eye(4)
    poses[:3, :3] = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]).T
    poses[:3, 3] = [0.0, 0.0, -0.008]
    load, hand = Load(mass=0.05), ParallelGripper.preset("franka")
    below = evaluate_grasps(mesh, poses, MODEL, hand=hand, table=Table.below(mesh), load=load)
    assert below.jaws.closed.all()
    assert not below.reachable.any()
    assert str(verdict_of(below)) == (
        "Not held by franka: no pose holds the object without a collision."
    )
    above = np.diag([1.0, -1.0, -1.0, 1.0])
    found = [
        str(verdict_of(evaluate_grasps(mesh, above, MODEL, hand=hand, load=load, pose_error=error)))
        for error in (None, "12mm,1deg", "30mm,1deg")
    ]
    for text, start in zip(found, ("Surely held", "Perhaps held", "Not held"), strict=True):
        assert text.startswith(f"{start} by franka: ")
        assert "too little" not in text
    assert "contacts may leave the pads within the po" in found[1]
    assert "its jaws may close on nothing within the po" in found[2]


@pytest.mark.slow
def test_where_no_pose_is_left_the_verdict_blames_neither_the_surface_nor_the_force() -> None:
    """On a cone contacts are M, but no pose keeps them once the jaws close."""
    mesh = load_mesh(shapes.LIBRARY / "cone.off", unit="m")
    labels = label_surface(mesh, hand=ParallelGripper.preset("franka"), load=Load(mass=0.3))
    assert labels.fractions()["M"] > 0.9
    verdict = verdict_of(labels)
    assert (verdict.word, verdict.causes) == ("not", {})
    assert "once the jaws close, no grasp was found that may be stable" in str(verdict)


LOAD = Load(mass=0.5, grip_force=20.0)


def test_each_declared_number_that_is_known_is_listed_with_its_unit() -> None:
    mesh = load_mesh(trimesh.creation.box([0.08, 0.05, 0.03]), unit="m", max_edge=0.02)
    labels = label_surface(
        mesh, GraspModel(torsion_radius="3mm"), load=LOAD, hand=ParallelGripper.preset("franka")
    )
    grasps = labels.take(labels.distinct)
    assert grasps.reach is not None
    assert grasps.load_result is not None
    known = np.isfinite(grasps.reach.approach_margin + grasps.load_result.grip_force_largest)
    row = int(np.flatnonzero(known)[0])
    found = facts(grasps, row)
    assert found["opening"] == f"{1e3 * grasps.opening[row]:.3g} mm"
    assert (
        found["force at the worst normals"] == f"{grasps.load_result.grip_force_largest[row]:.3g} N"
    )
    assert found["payload"] == f"{grasps.load_result.payload[row]:.3g} kg"
    assert found["margin"] == f"{math.degrees(grasps.margin[row]):.1f}°"
    assert {"β*", "α*", "ε", "ε_min", "ε_max", "approach margin", "score"} <= found.keys()
    assert NONE not in found.values()


@pytest.mark.parametrize(
    ("unit", "text"), [("m", "(40, 0, -2.5) mm"), (None, "(0.04, 0, -0.0025)")]
)
def test_positions_have_four_digits_and_no_rounding_errors(unit: str | None, text: str) -> None:
    mesh = load_mesh(trimesh.creation.box([0.08, 0.05, 0.03]), unit=unit)  # type: ignore[arg-type]
    assert position_text(np.array([0.04, -1e-17, -0.0025]), mesh) == text
