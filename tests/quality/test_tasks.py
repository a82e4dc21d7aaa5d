import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import grasp3d
from grasp3d._kernels.hull.support_functions import reach
from grasp3d.errors import SettingError
from grasp3d.quality import Acceleration, Task, Weight, Wrenches, parse_task
from grasp3d.quality.loads import (
    LARGEST_FILE,
    MAX_WRENCHES,
    Load,
    TaskText,
    load_from,
    load_settings,
)
from grasp3d.quality.tasks import STANDARD_GRAVITY
from grasp3d.surface.load_case import LoadCase
from tests.helpers import shapes

DOWN = (0.0, 0.0, -1.0)
TASKS: dict[str, Task] = {
    "weight": Weight(0.5),
    "weight downward": Weight(2.0, direction=DOWN),
    "weight within a cone": Weight(1.0, direction=(1.0, 0.0, -1.0), within=math.radians(30.0)),
    "acceleration": Acceleration(0.5, acceleration=5.0),
    "pushes": Wrenches([[1, 0, 0, 0, 0, 0], [0, -2, 0, 0.1, 0, 0], [0, 0, 0, 0, 0, 0.5]]),
    "sum": Weight(0.5) + Acceleration(0.5, acceleration=2.0) + Wrenches([1, 0, 0, 0, 0, 0.0]),
}

names = st.sampled_from(list(TASKS))
vectors = st.lists(st.floats(-2.0, 2.0), min_size=6, max_size=6).map(np.array)
few = settings(max_examples=40, deadline=None)


@given(names, vectors, vectors, st.floats(0.0, 5.0))
@few
def test_supports_are_convex_and_homogeneous(name: str, u: Any, v: Any, factor: float) -> None:
    task = TASKS[name]
    total = task.support(u) + task.support(v)
    assert task.support(u + v) <= total + 1e-9 * (1.0 + abs(total))
    assert task.support(factor * u) == pytest.approx(factor * task.support(u), abs=1e-9)


@given(names, vectors)
@few
def test_the_farthest_wrench_reaches_as_far_as_the_support(name: str, u: Any) -> None:
    task = TASKS[name]
    assert task.farthest(u) @ u == pytest.approx(task.support(u), abs=1e-7)  # torques of 1e-9
    # It belongs to the task: no direction is exceeded.
    others = np.random.default_rng(0).normal(size=(50, 6))
    assert (others @ task.farthest(u) <= task.support(others) + 1e-9).all()


@given(names, vectors)
@few
def test_the_kernels_reach_as_far(name: str, u: Any) -> None:
    rows, points = TASKS[name].arrays()
    assert reach(rows, points, *u) == pytest.approx(TASKS[name].support(u), abs=1e-9)


def test_weight_within_a_cone_reaches_as_far_as_its_samples() -> None:
    within = math.radians(30.0)
    task = Weight(direction=DOWN, within=within)
    rng = np.random.default_rng(2)
    force = rng.normal(size=(400_000, 3))
    force /= np.linalg.norm(force, axis=1, keepdims=True)
    force = STANDARD_GRAVITY * force[-force[:, 2] >= math.cos(within)]
    for u in rng.normal(size=(10, 6)):
        reached = (force @ u[:3]).max()
        assert reached == pytest.approx(task.support(u), rel=0.01, abs=0.02)
        assert reached <= task.support(u) + 1e-9


def test_sums_add_up_and_masses_scale_what_has_one() -> None:
    total, u = TASKS["sum"], np.array([0.3, -1.0, 0.2, 0.1, 0.5, -0.4])
    parts = [part.support(u) for part in total.terms()]
    assert total.support(u) == pytest.approx(sum(parts))
    doubled = total.scaled_to(1.0)
    assert doubled.support(u) == pytest.approx(2.0 * (parts[0] + parts[1]) + parts[2])
    assert total.mass == 0.5
    assert TASKS["pushes"].mass is None


def test_corners_are_all_sums_of_corners() -> None:
    task = Weight(1.0, direction=DOWN) + Wrenches([[1, 0, 0, 0, 0, 0], [0, 1, 0, 0, 0, 0]])
    corners = task.corners_for(None, 2)
    assert corners is not None
    assert corners.shape == (2, 2, 6)
    assert corners[0, 1].tolist() == [0.0, 1.0, -STANDARD_GRAVITY, 0.0, 0.0, 0.0]
    heavier = task.corners_for(np.array([1.0, 3.0]), 2)
    assert heavier is not None
    assert heavier[1, 0, 2] == pytest.approx(-3.0 * STANDARD_GRAVITY)
    assert Weight().corners_for(None, 1) is None


@pytest.mark.parametrize("make", [
    lambda: Weight(-0.5), lambda: Weight(math.nan),
    lambda: Weight(1.0, direction=(0.0, 0.0, 0.0)), lambda: Weight(1.0, within=0.5),
    lambda: Weight(1.0, direction=DOWN, within=2.0), lambda: Acceleration(1.0, acceleration=-1.0),
    lambda: Wrenches([[1.0, 2.0, 3.0]]), lambda: Wrenches([[math.inf] * 6]),
    lambda: Wrenches("no numbers"), lambda: Weight().support([1.0, 2.0]),
])  # fmt: skip
def test_tasks_that_are_none(make: Any) -> None:
    with pytest.raises(SettingError):
        make()


NUMBERS = st.floats(-1e6, 1e6)
ROWS = st.lists(st.tuples(*[NUMBERS] * 6), min_size=1, max_size=5).filter(
    lambda rows: any(map(any, rows))
)


@pytest.mark.parametrize(
    ("text", "task"),
    [
        (" weight ", Weight(0.5)),
        ("weight within 30 of -z", Weight(0.5, DOWN, math.radians(30))),
        ("weight within 30deg of 0,0,-2", Weight(0.5, DOWN, math.radians(30))),
        ("weight within 30° of -z", Weight(0.5, DOWN, math.radians(30))),
        ("weight within 0.5 rad of -z", Weight(0.5, DOWN, 0.5)),
        ("weight within 0 of x", Weight(0.5, (1.0, 0.0, 0.0))),
        ("weight within 0 of -y", Weight(0.5, (0.0, -1.0, 0.0))),
        ("weight within 90 of y", Weight(0.5, (0.0, 1.0, 0.0), math.pi / 2)),
        ("acceleration 5 m/s^2", Acceleration(0.5, 5.0)),
        ("acceleration 5e-1", Acceleration(0.5, 0.5)),
        ("weight + acceleration 0", Weight(0.5) + Acceleration(0.5, 0.0)),
        ("wrench 0,0,-5,0,0,0.1", Wrenches([[0, 0, -5, 0, 0, 0.1]])),
        ("wrench 1,0,0,0,0,0; 0,1,0,0,0,0", Wrenches(np.eye(6)[:2])),
    ],
)
def test_texts_are_tasks(text: str, task: Task) -> None:
    assert str(TaskText.of(text)) == text.strip()
    assert parse_task(text, mass=0.5) == task


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "no task is called ''"),
        ("wieght", "no task is called 'wieght'; known: weight, weight within"),
        ("weight +", r"no task is called 'weight \+'"),
        ("weight 5", "no task is called 'weight 5'; known: weight, weight within DEGREES of AXIS"),
        ("weight within 91 of z", "the angle must be from 0 to 90 degrees"),
        ("weight within nan of z", "the angle must be from 0 to 90 degrees"),
        ("weight within half of z", "must be an angle .a number of degrees.*; got 'half'"),
        ("weight within 30 of up", "the axis x, y, z, -x, -y or -z, or 3 finite numbers; got 'up'"),
        ("weight within 30 of 0,0,0", "the axis has no direction"),
        ("acceleration fast", "the acceleration in m/s.2 as 1 finite number; got 'fast'"),
        ("acceleration -5", "the acceleration must be at least 0"),
        ("wrench 0,0,-5", r"force \[N\] and torque \[N m\] as 6 finite numbers; got '0,0,-5'"),
        ("acceleration 0", "task 'acceleration 0': a task needs a force or a torque"),
        ("wrench 0,0,0,0,0,0; 0,0,0,0,0,0 + acceleration 0", "a task needs a force or a torque"),
        ("none.csv", r"none\.csv': there is no such file"),
    ],
)
def test_each_mistake_is_one_sentence(text: str, words: str) -> None:
    with pytest.raises(SettingError, match=words) as error:
        parse_task(text)
    assert "\n" not in str(error.value)


def test_too_many_wrenches_are_refused(tmp_path: Path) -> None:
    row = "1,0,0,0,0,0"
    text = "wrench " + ";".join([row] * (MAX_WRENCHES + 1))
    with pytest.raises(SettingError, match="at most 200 wrenches; got 201"):
        TaskText.of(text)
    path = tmp_path / "many.csv"
    path.write_text("\n".join([row] * (MAX_WRENCHES + 1)))
    with pytest.raises(SettingError, match="at most 200 wrenches; got 201"):
        TaskText.of(str(path))
    with pytest.raises(SettingError, match="at most 200 wrenches; got 201"):
        parse_task(f"wrench {row} + wrench {';'.join([row] * MAX_WRENCHES)}")
    path.write_text("#" * (LARGEST_FILE + 1))
    with pytest.raises(SettingError, match=r"many\.csv': is too large"):
        TaskText.of(str(path))


@given(rows=ROWS)
def test_wrenches_are_as_they_are_written(rows: list[tuple[float, ...]]) -> None:
    text = "wrench " + "; ".join(",".join(map(repr, row)) for row in rows)
    task = parse_task(text)
    assert isinstance(task, Wrenches)
    np.testing.assert_array_equal(task.wrenches, rows)
    assert TaskText.of(text).has_torques == any(any(row[3:]) for row in rows)


@given(rows=ROWS)
def test_files_and_texts_are_the_same(
    tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[float, ...]]
) -> None:
    path = tmp_path_factory.mktemp("tasks") / "pushes.csv"
    path.write_text("\n".join(",".join(map(repr, row)) for row in rows))
    for text in (str(path), f"weight + {path}"):
        read = TaskText.of(text)
        assert read.files == (path,)
        again = TaskText.of(str(read))
        assert (again, again.files) == (read, ())
        assert again.task() == parse_task(text)


@pytest.mark.parametrize("start", ["", "fx,fy,fz,tx,ty,tz\n", "# pushes\n\nFX, FY,fz,tx,ty,tz\n"])
def test_a_first_line_of_names_is_optional(tmp_path: Path, start: str) -> None:
    path = tmp_path / "pushes.csv"
    path.write_text(f"{start}5,0,0,0,0,0\n\n# a comment\n0, 5, 0, 0, 0, 0.1\r\n", "utf-8-sig")
    assert str(TaskText.of(str(path))) == "wrench 5,0,0,0,0,0; 0,5,0,0,0,0.1"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"1,2,3,4,5\n", r"give force \[N\] and torque \[N m\] as 6 finite numbers"),
        (b"1,2,3,4,5,6\n1,2,3,4,5,6,7\n", " 6 finite numbers; got '1,2,3,4,5,6,7'"),
        pytest.param(b"1" * 200_000 + b",0,0,0,0,0\n", "; got '1{100}'$", id="long"),
        (b"0,0,0,0,0,0\n-0,0,0,0,0,0\n", "a task needs a force or a torque"),
        (b"", "has no wrench"),
        (b"\xff\xfe\x00", "'utf-8' codec can't decode byte 0xff"),
    ],
)
def test_damaged_files_are_refused(tmp_path: Path, content: bytes, words: str) -> None:
    path = tmp_path / "pushes.csv"
    path.write_bytes(content)
    with pytest.raises(SettingError, match=f"pushes.csv': .*{words}") as error:
        parse_task(str(path))
    assert "\n" not in str(error.value)


POSITIVE = st.floats(1e-6, 1e6)


@pytest.mark.parametrize(
    ("field", "text", "number"),
    [
        ("mass", "0.5kg", 0.5), ("mass", "500 g", 0.5), ("mass", "300G", 0.3), ("mass", "2", 2.0),
        ("task", " weight + acceleration 5 ", Load(task="weight + acceleration 5").task),
        ("mass", "1lb", 0.45359237), ("mass", "16 oz", 0.45359237), ("mass", np.float32(0.5), 0.5),
        ("grip_force", "40N", 40.0), ("grip_force", "0.04 kN", 40.0), ("grip_force", 40, 40.0),
        ("grip_force", "10lbf", 44.482216152605), ("density", "7.85 g/cm^3", 7850.0),
        ("density", "7.85g/cm3", 7850.0), ("density", "1e3", 1000.0),
        ("density", "0.1 lb/in^3", 2767.99047102),
    ],
)  # fmt: skip
def test_quantities_are_numbers_in_si_units_or_have_a_unit(
    field: str, text: Any, number: Any
) -> None:
    stored = getattr(Load(**{field: text}), field)
    assert type(stored) is type(number)
    assert stored == (number if field == "task" else pytest.approx(number, rel=1e-11))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"mass": "-0.5kg"}, r"mass must be finite and above 0 \[kg\]; got -0.5kg"),
        ({"mass": "1e300"}, r"mass must be at most 1e\+09 \[kg\]; got 1e300"),
        ({"mass": "5N"}, r"mass must be a number \[kg\], or .* \(kg, g, lb, oz\); got '5N'"),
        ({"density": "1000,700"}, "density must be a number .*; got '1000,700'"),
        ({"grip_force": "40kg"}, "grip_force must be a number .* \\(N, kN, lbf\\); got '40kg'"),
        ({"mass": 1.0, "density": 1.0}, "mass and density exclude each other"),
        ({"task": "wieght"}, "no task is called 'wieght'; known: weight, "),
        ({"task": Weight()}, r"no task is called 'Weight\("),
    ],
)
def test_bad_loads_are_refused_in_one_sentence(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(SettingError, match=message) as error:
        Load(**settings)
    assert "\n" not in str(error.value)


def test_the_task_is_for_the_mass() -> None:
    load = Load(task="weight + wrench 0,0,0,0,0,0.1")
    weight, wrench = load.task_for(0.5).terms()
    assert weight == Weight(0.5)
    assert wrench.support([0, 0, 0, 0, 0, 1]) == 0.1
    assert load.task_for(None).mass == 1.0


def test_what_needs_the_unit_says_so() -> None:
    mesh, model = grasp3d.load_mesh(shapes.box(), max_edge=9.0), grasp3d.GraspModel()
    assert LoadCase.of(Load(mass=1.0), mesh, model).task == Weight(1.0)  # a weight needs none
    with pytest.raises(SettingError, match="torques of the task are in N m") as error:
        LoadCase.of(Load(task="wrench 0,0,0,0,0,1"), mesh, model)
    assert "the unit of arrays is not known" in str(error.value)
    assert "--unit" in str(error.value)


def test_files_are_read_into_the_text(tmp_path: Path) -> None:
    path = tmp_path / "pushes.csv"
    path.write_text("5,0,0,0,0,0\n")
    load = Load(task=f"weight + {path}")
    assert load.task.files == (path,)
    path.unlink()
    assert str(load.task) == "weight + wrench 5,0,0,0,0,0"
    assert load.chosen == load
    assert load.task_for(1.0).support([1, 0, 0, 0, 0, 0]) == pytest.approx(14.80665)
    with pytest.raises(SettingError, match=r"pushes\.csv': there is no such file"):
        Load(task=str(path))
    assert Load().task.files == ()
    assert Load().chosen is None


@given(
    density=st.one_of(st.none(), POSITIVE),
    force=st.one_of(st.none(), POSITIVE),
    task=st.sampled_from(["weight", "weight within 30 of -z", "wrench 1,2,3,0,0,0.5 + weight"]),
)
def test_stored_loads_are_read_back(density: Any, force: Any, task: str) -> None:
    load = Load(density=density, grip_force=force, task=task)
    stored = {name: str(value) for name, value in load_settings(load).items()}
    assert load_from(stored) == load
    assert not any("\n" in value for value in stored.values())


def test_files_without_a_load_have_none() -> None:
    assert set(load_settings(None).values()) == {None}
    assert list(load_settings(None)) == list(asdict(Load()))
    assert load_from({name: str(value) for name, value in load_settings(None).items()}) is None
    assert load_from({"friction": "0.5"}) is None
    with pytest.raises(SettingError, match="mass must be"):
        load_from({"task": "weight", "mass": "-1"})
