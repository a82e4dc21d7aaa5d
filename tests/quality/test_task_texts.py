"""Tasks as texts and files."""

import math
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp3d.errors import SettingError
from grasp3d.quality import Acceleration, Task, Weight, Wrenches, parse_task
from grasp3d.quality.loads import LARGEST_FILE, MAX_WRENCHES, TaskText

DOWN = (0.0, 0.0, -1.0)
NUMBERS = st.floats(-1e6, 1e6)
ROWS = st.lists(st.tuples(*[NUMBERS] * 6), min_size=1, max_size=5).filter(
    lambda rows: any(map(any, rows))
)


@pytest.mark.parametrize(
    ("text", "task"),
    [
        ("weight", Weight(0.5)),
        (" weight ", Weight(0.5)),
        ("weight within 30 of -z", Weight(0.5, DOWN, math.radians(30))),
        ("weight within 30 degrees of -z", Weight(0.5, DOWN, math.radians(30))),
        ("weight within 30deg of 0,0,-2", Weight(0.5, DOWN, math.radians(30))),
        ("weight within 30° of -z", Weight(0.5, DOWN, math.radians(30))),
        ("weight within 0.5 rad of -z", Weight(0.5, DOWN, 0.5)),
        ("weight within 0 of x", Weight(0.5, (1.0, 0.0, 0.0))),
        ("weight within 90 of y", Weight(0.5, (0.0, 1.0, 0.0), math.pi / 2)),
        ("acceleration 5", Acceleration(0.5, 5.0)),
        ("acceleration 5 m/s^2", Acceleration(0.5, 5.0)),
        ("acceleration 5e-1", Acceleration(0.5, 0.5)),
        ("weight + acceleration 0", Weight(0.5) + Acceleration(0.5, 0.0)),
        ("weight + acceleration 5", Weight(0.5) + Acceleration(0.5, 5.0)),
        ("wrench 0,0,-5,0,0,0.1", Wrenches([[0, 0, -5, 0, 0, 0.1]])),
        ("wrench 1e+1, 0, 0, 0, 0, 0", Wrenches([[10, 0, 0, 0, 0, 0]])),
        ("wrench 1,0,0,0,0,0; 0,1,0,0,0,0", Wrenches(np.eye(6)[:2])),
    ],
)
def test_texts_are_tasks(text: str, task: Task) -> None:
    assert str(TaskText.of(text)) == text.strip()
    assert parse_task(text, mass=0.5) == task


@pytest.mark.parametrize("axis", ["x", "y", "z", "-x", "-y", "-z"])
def test_gravity_acts_along_its_axis(axis: str) -> None:
    direction = np.zeros(6)
    direction["xyz".index(axis[-1])] = -1.0 if axis[0] == "-" else 1.0
    support = parse_task(f"weight within 0 of {axis}").support([direction, -direction])
    np.testing.assert_allclose(support, [9.80665, -9.80665], rtol=1e-14)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "no task is called ''"),
        ("wieght", "no task is called 'wieght'; known: weight, weight within"),
        ("Weight", "no task is called 'Weight'"),
        ("weight +", r"no task is called 'weight \+'"),
        ("weight 5", "no task is called 'weight 5'; known: weight, weight within DEGREES of AXIS"),
        ("weight within 30", "no task is called 'weight within 30'"),
        ("weight within 91 of z", "the angle must be from 0 to 90 degrees"),
        ("weight within -1 of z", "the angle must be from 0 to 90 degrees"),
        ("weight within nan of z", "the angle must be from 0 to 90 degrees"),
        (
            "weight within half of z",
            "must be an angle .a number of degrees.*; got 'half'",
        ),
        ("weight within 30 of up", "the axis x, y, z, -x, -y or -z, or 3 finite numbers; got 'up'"),
        ("weight within 30 of 0,0,0", "the axis has no direction"),
        ("weight within 30 of 0,inf,0", "3 finite numbers"),
        ("acceleration", "no task is called 'acceleration'; known: .*acceleration NUMBER"),
        ("acceleration fast", "the acceleration in m/s.2 as 1 finite number; got 'fast'"),
        ("acceleration -5", "the acceleration must be at least 0"),
        ("acceleration inf", "1 finite number"),
        ("wrench 0,0,-5", r"force \[N\] and torque \[N m\] as 6 finite numbers; got '0,0,-5'"),
        ("wrench 0,0,-5,0,0,nan", "6 finite numbers"),
        ("wrench", "no task is called 'wrench'"),
        ("acceleration 0", "task 'acceleration 0': a task needs a force or a torque"),
        ("wrench 0,0,0,0,-0,0", "a task needs a force or a torque"),
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
    half = tmp_path / "half.csv"
    half.write_text("\n".join([row] * (MAX_WRENCHES // 2 + 1)))
    with pytest.raises(SettingError, match="at most 200 wrenches; got 202"):
        parse_task(f"{half} + {half}")
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
        (b"1,2,3,4,5,nan\n", " 6 finite numbers; got '1,2,3,4,5,nan'"),
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


def test_a_file_of_zeros_is_no_task_of_its_own(tmp_path: Path) -> None:
    path = tmp_path / "zeros.csv"
    path.write_text("0,0,0,0,0,0\n-0,0,0,0,0,0\n")
    with pytest.raises(SettingError, match=r"zeros\.csv': a task needs a force or a torque"):
        TaskText.of(str(path))
    assert parse_task(f"weight + {path}").mass == 1.0


@pytest.mark.parametrize(("make", "words"), [(Path.mkdir, "is a folder"), (os.mkfifo, "is a pipe")])
def test_what_is_no_file_is_no_file_of_wrenches(tmp_path: Path, make: Any, words: str) -> None:
    path = tmp_path / "pushes.csv"
    make(path)
    with pytest.raises(SettingError, match=rf"pushes\.csv': {words}"):
        TaskText.of(str(path))
