"""`grasp3d design` with everything that is uncertain: budgets, limits, objects, other tips."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
import trimesh

import grasp3d
from grasp3d.contact import EllipsoidTip, FingerDesign, GraspSamples, JointEncoders
from grasp3d.contact.sensor import Sensor
from grasp3d.settings.uncertainty import Uncertainty
from tests.cli.test_design import design, facts, printed

FINGER = (
    "--friction", "0.4..0.6", "--receptive-field", "4mm",
    "--encoder-counts", 4096, "--joint-lengths", "60mm", "30mm",
)  # fmt: skip
SENSOR, JOINTS = Sensor(4.0, 10.0), JointEncoders(4096, (60.0, 30.0))


def degrees(angle: float) -> str:
    return f"{round(math.degrees(angle), 2) + 0.0:.2f}°"


def bars(text: str) -> dict[str, tuple[str, str]]:
    """Angle and bar of each line of a budget, by its name."""
    found = re.findall(r"^([a-z][a-z ]*?) +(-?\d+\.\d\d°) ?( *[█▏░]*)", text, re.MULTILINE)
    return {name: (angle, bar) for name, angle, bar in found}


def row_after(text: str, heading: str) -> list[str]:
    """Words of the first row of the table below a heading that starts with a number."""
    below = text[text.index(heading) :]
    return next(line.split() for line in below.splitlines() if re.match(r"\d", line))


def test_a_budget_has_a_bar_for_each_part() -> None:
    text = printed(*FINGER, "--object-size", "50mm")
    budget = FingerDesign((0.4, 0.6), SENSOR, JOINTS).budget(GraspSamples(0.0, 50.0)).mean()
    found = bars(text)
    expected = {"friction angle": budget.friction_angle} | {
        name: value
        for name, value in budget.stack.items()
        if float(value) != 0.0 or name == "critical angle"
    }
    assert {name: angle for name, (angle, _) in found.items()} == {
        name: degrees(float(value)) for name, value in expected.items()
    }
    assert "Budget at friction 0.4..0.6, two fingers 50 mm apart" in text
    assert f"surely stable: the margin is {degrees(float(budget.margin))}; sensor res" in text
    lengths = {name: len(bar.strip().replace("▏", "")) for name, (_, bar) in found.items()}
    assert sum(lengths.values()) == pytest.approx(2 * lengths["friction angle"], abs=1)
    ends = [len(found[name][1]) for name in ("friction", "sensor resolution", "location")]
    assert ends == sorted(ends)  # each bar begins where the one before ends
    values = facts(text[: text.index("Budget")])
    assert values["encoders"] == "± 0.0439°, ± 0.0439°"
    assert values["location uncertainty"] == "within 2 mm"
    assert values["contact location"].startswith("within 0.06903 mm")


def test_the_limits_are_those_of_the_design() -> None:
    given = FingerDesign((0.4, 0.6), SENSOR, JOINTS)
    grasp = GraspSamples(math.radians(3.0), 50.0)
    row = row_after(printed(*FINGER, "--object-size", 50, "--critical-angle", 3), "Limits")
    field = given.required_field(grasp, tip=10.0)
    assert row == [
        "0.4..0.6",
        f"{given.required_friction(grasp):.4g}",
        f"{field:#.4g}",
        degrees(field / 10.0),
        f"{given.required_counts(grasp)}",
        f"{given.required_location(grasp):#.4g}",
    ]


def test_the_printed_counts_are_just_fine_enough() -> None:
    coarse = [word if word != 4096 else 150 for word in FINGER]
    text = printed(*coarse, "--object-size", "50mm")
    assert "not surely stable: the margin is -" in text
    counts = int(row_after(text, "Limits")[4])
    for used, verdict in ((counts, "\nsurely stable"), (counts - 1, "\nnot surely stable")):
        again = [word if word != 4096 else used for word in FINGER]
        assert verdict in printed(*again, "--object-size", "50mm")


def test_without_counts_the_joints_are_exact_and_the_counts_are_a_limit() -> None:
    text = printed("--friction", 0.5, "--receptive-field", 4, "--joint-lengths", 60, 30)
    assert "of 2 joints, exact: give --encoder-counts" in text
    assert "encoders  " not in text[text.index("Budget") :]
    left = math.atan(0.5) - 0.2
    assert row_after(text, "Limits")[4] == str(math.floor(2.0 * math.pi / left) + 1)
    assert "give --object-size or --object to include it" in " ".join(text.split())


def test_parallel_jaws_only_move_along_the_closing_axis() -> None:
    text = printed(
        "--friction", 0.5, "--joint-lengths", "10mm", "--encoder-counts", 500, "--parallel-jaws",
        "--location-error", "1mm", "--object-size", "20mm",
    )  # fmt: skip
    assert "± 0.01 mm" in text
    found, turn = bars(text), math.asin(2.02 / 20.0)
    assert found["location"][0] == degrees(turn / 1.01)
    assert found["encoders"][0] == degrees(turn * 0.01 / 1.01)


def test_further_errors_and_the_critical_angle_take_their_parts() -> None:
    text = printed(
        "--normal-error", 2, "--location-error", "1mm", "--object-size", "40mm",
        "--critical-angle", 5,
    )  # fmt: skip
    found, values = bars(text), facts(text[: text.index("Budget")])
    assert values["other normal error"] == "within 2°"
    assert values["other location error"] == "within 1 mm"
    assert found["friction angle"][0] == "26.57°"  # a friction of 0.5, if none is given
    assert (found["critical angle"][0], found["normal error"][0]) == ("5.00°", "2.00°")
    assert found["location"][0] == degrees(math.asin(2.0 / 40.0))


def test_several_frictions_have_a_budget_each(tmp_path: Path) -> None:
    figure = tmp_path / "budgets.png"
    text = printed(*FINGER, "--object-size", 50, "--figure", figure)
    assert "written: " in text
    assert figure.read_bytes().startswith(b"\x89PNG")
    two = printed("--friction", 0.3, "0.4..0.6", "--object-size", 50, "--receptive-field", 4)
    assert two.count("Budget at friction") == 2
    limits = two[two.index("Limits") :]
    assert [line.split()[0] for line in limits.splitlines() if line[:1] == "0"] == [
        "0.3",
        "0.4..0.6",
    ]


def test_the_figure_does_not_change_what_is_printed(tmp_path: Path) -> None:
    words = ("--friction", 0.5, "--receptive-field", 4, "--object-size", 50)
    figure = tmp_path / "a.png"
    text, drawn = printed(*words), printed(*words, "--figure", figure)
    assert "Comparison of this sensor with each friction" in text
    assert drawn.splitlines()[:-1] == text.splitlines()
    assert drawn.splitlines()[-1].startswith("written: ")
    assert figure.read_bytes().startswith(b"\x89PNG")


def test_a_critical_angle_above_the_friction_angle_is_named_as_the_cause() -> None:
    cause = "the critical angle alone exceeds the friction angle"
    words = ("--friction", "0.2..0.3", "--receptive-field", 4)
    above = " ".join(printed(*words, "--critical-angle", 20).split())
    below = " ".join(printed(*words, "--critical-angle", 13).split())
    assert cause in above
    assert "takes the most" not in above
    assert cause not in below
    assert "sensor resolution takes the most" in below


def test_a_flat_tip_has_no_limit_of_its_resolution() -> None:
    text = printed("--flat", "--receptive-field", 4, "--joint-lengths", 60, "--object-size", 50)
    assert "0.00°" not in text[: text.index("Budget")]
    assert "of 1 joint, exact" in text
    assert "resolution" not in text[text.index("Limits") :]


def test_an_ellipsoid_is_as_coarse_as_where_its_normal_turns_most() -> None:
    text = printed("--fingertip-axes", 8, "1cm", 12, "--receptive-field", 4, "--friction", 0.5)
    tip = EllipsoidTip((8.0, 10.0, 12.0))
    values = facts(text)
    assert values["fingertip"] == "ellipsoid, semi-axes 8 x 10 x 12 mm"
    assert values["sensor resolution, at worst"] == degrees(tip.worst(4.0).resolution)
    for axis in range(3):
        expected = tip.resolution_at(4.0, np.eye(3)[axis]).resolution
        assert values[f"at the end of semi-axis {axis + 1}"] == degrees(expected)
    assert values["sensors on half of it"] == f"at least {tip.sensors_by_discs(4.0)}"
    assert bars(text)["sensor resolution"][0] == degrees(tip.worst(4.0).resolution / 2.0)


def test_a_cylinder_is_as_coarse_as_a_ball_around_its_axis() -> None:
    values = facts(printed("--cylinder", "--fingertip-radius", 8, "--receptive-field", 4))
    assert values["fingertip"] == "cylinder, radius 8 mm"
    assert values["sensor resolution, at worst"] == f"{degrees(0.5)}, around the axis"


def test_overlapping_fields_are_finer() -> None:
    given = facts(printed("--receptive-field", "6mm", "--pitch", "4mm"))
    assert given["receptive field"] == "2 mm"
    assert given == facts(printed("--receptive-field", "2mm"))


@pytest.fixture(scope="module")
def box(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("design") / "box.stl"
    trimesh.creation.box([80.0, 50.0, 30.0]).export(path)
    return path


@pytest.mark.slow
def test_an_object_has_its_own_angles_and_openings(box: Path, tmp_path: Path) -> None:
    figure = tmp_path / "budget.svg"
    text = printed(*FINGER, "--object", box, "--unit", "mm", "--figure", figure)
    mesh = grasp3d.load_mesh(box, unit="mm")
    given = FingerDesign((0.4, 0.6), SENSOR, JOINTS)
    exact = grasp3d.GraspModel(friction=(0.4, 0.6), sensor_resolution=0.4)
    located = exact.with_uncertainty(given.uncertainty)
    both = [grasp3d.label_surface(mesh, model) for model in (exact, located)]
    critical = np.stack([labels.critical_angle for labels in both], axis=1)
    opening = np.stack([labels.opening for labels in both], axis=1)
    opening[~np.isfinite(critical)] = np.inf
    grasps = GraspSamples(critical, opening, mesh.vertex_areas)
    assert f"Object: box.stl, {len(mesh.vertices):,} vertices" in text
    fraction = 100.0 * given.stable_fraction(grasps)
    assert 0.0 < fraction < 100.0
    table = text[text.index("Area fraction of S") :].replace(" %", "%")
    rows = dict(re.findall(r"^([a-z ]+?) {2,}(\d+\.\d)%", table, re.MULTILINE))
    names = ("friction", "sensor resolution", "location", "encoders", "any")
    assert list(rows) == ["as given", *(f"without {name}" for name in names)]
    assert rows["as given"] == f"{fraction:.1f}"
    without = given.without("sensor resolution").stable_fraction(grasps)
    assert rows["without sensor resolution"] == f"{100.0 * without:.1f}"
    limits = text[text.index("Limits") :]
    levels = [line.split()[1] for line in limits.splitlines() if line.startswith("0.4..0.6")]
    assert levels == ["50", "90"]
    assert figure.exists()


@pytest.mark.slow
def test_an_object_that_cannot_be_held_is_refused(tmp_path: Path) -> None:
    ball = tmp_path / "ball.stl"
    trimesh.creation.icosphere(1, radius=50.0).export(ball)
    words = ("--object", ball, "--unit", "mm", "--max-opening", "20mm", "--friction", 0.5)
    run = design(*words)
    assert run.returncode == 2
    assert run.stdout == ""
    assert "no grasp was found on ball.stl with these settings" in run.stderr


def test_lengths_that_cannot_be_meant_are_accepted_with_force() -> None:
    accepted = printed("--object-size", "50mm", "--location-error", "1m", "--force")
    assert bars(accepted)["location"][0] == "90.00°"


@pytest.mark.parametrize("columns", [80, 60])
def test_nothing_is_truncated_in_a_narrow_terminal(columns: int) -> None:
    words = (*FINGER, "--object-size", 50)
    narrow, wide = printed(*words, columns=columns), printed(*words, columns=200)
    assert max(map(len, narrow.splitlines())) <= columns
    assert "…" not in narrow
    without_bars = [re.sub(r"[█▏░\s]", "", text) for text in (narrow, wide)]
    assert sorted(without_bars[0]) == sorted(without_bars[1])


def test_the_uncertainty_of_the_options_is_that_of_a_model() -> None:
    total = SENSOR.uncertainty + JOINTS.uncertainty
    model = grasp3d.GraspModel(friction=(0.4, 0.6)).with_uncertainty(total)
    text = printed(*FINGER)
    margin = model.effective_friction_angle
    assert f"the margin is {degrees(margin)}" in text
    assert Uncertainty() + total == total
