"""Words, help, completion, streams and tables of the command line."""

import io
import math
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from unittest.mock import Mock

import pytest
from rich.console import Console

from grasp3d import GraspModel
from grasp3d.cli import KINDS
from grasp3d.cli.options import options_of
from grasp3d.cli.report import UNLIMITED, Report
from grasp3d.cli.usage import GROUPS, MAIN, MOST_OPTIONS, examples_of, groups_of, invocation, parse
from grasp3d.contact.contacts import effective_friction
from grasp3d.contact.sensor import Sensor, required_counts
from grasp3d.settings.parsing import plain_values
from tests.helpers.commands import COMMAND, printed

EXAMPLES = [
    line.removeprefix("  grasp3d ")
    for command in KINDS
    for line in examples_of(KINDS[command]).splitlines()[1::2]
]


@pytest.mark.slow
@pytest.mark.parametrize("command", KINDS)
def test_help_is_one_screen_of_what_matters_and_help_all_has_every_option(command: str) -> None:
    options = list(options_of(KINDS[command]))
    lines = printed(command, "--help", cwd=Path(), columns=80).splitlines()
    whole = printed(command, "--help-all", cwd=Path(), columns=80)
    for option in options:
        assert f"\n  {invocation(option)}\n" in whole
    places = [whole.index(f"\n{GROUPS[name][:40]}") for name in groups_of(KINDS[command])]
    assert places == sorted(places)
    if len(options) <= MOST_OPTIONS:
        assert "\n".join(lines) == whole.rstrip("\n")
        return
    assert f"all options: grasp3d {command} --help-all" in lines
    assert len(lines) <= 40
    assert max(len(line) for line in lines if line[:4] not in {"  gr", "  # "}) <= 80
    shown = [line for line in lines if line.lstrip().startswith("-")]
    assert 7 <= len(shown) == sum(bool(one.names) and one.field in MAIN for one in options) <= 14


def test_label_has_at_most_36_options() -> None:
    assert sum(bool(one.names) for one in options_of(KINDS["label"])) <= 36


@pytest.mark.slow
@pytest.mark.parametrize("words", EXAMPLES)
def test_the_examples_are_valid(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: str
) -> None:
    """They are parsed, and not run."""
    monkeypatch.setattr("grasp3d.cli.import_module", lambda _: Mock(run=lambda *_: 0))
    (tmp_path / "meshes").symlink_to(Path(__file__).parents[2] / "meshes")
    printed(*shlex.split(words), cwd=tmp_path)


@pytest.mark.parametrize("up", ["z", "-x", "-y", "-z"])
def test_words_that_begin_with_a_dash_are_values(up: str) -> None:
    words = ["x.stl", "--hand", "franka", "--table", "as-is", "--at", "-1,-2mm,3"]
    words += ["--unit", "mm", "--center-of-mass", "-5mm,0,2mm"]
    for given in (["--up", up], [f"--up={up}"]):
        command = parse(KINDS["label"], [*words, *given])
        assert (command.reach.up, command.at) == (up, ("-1,-2mm,3",))
        assert command.mesh.center_of_mass == (-0.005, 0.0, 0.002)


def test_options_are_the_settings_with_angles_in_degrees() -> None:
    words = ["--friction", "0.4..0.6", "--sensor-resolution", "14", "--location-error", "1mm"]
    model = GraspModel((0.4, 0.6), math.radians(14.0), location_error=0.001)
    assert plain_values(parse(GraspModel, words)) == plain_values(model)
    assert plain_values(parse(GraspModel, [])) == plain_values(GraspModel())
    given = parse(KINDS["label"], ["x.stl", "--max-opening", "7cm", "--sensor-resolution", "2rad"])
    assert (given.sampling.max_opening, given.model.sensor_resolution) == (0.07, 2.0)


@pytest.mark.slow
def test_the_module_is_the_command(tmp_path: Path) -> None:
    words = [sys.executable, "-m", "grasp3d", "design", "--nope"]
    run = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (run.returncode, run.stdout) == (2, "")
    assert run.stderr.startswith("grasp3d: grasp3d design has no option --nope")


FULL = "grasp3d: standard output: cannot be written (No space left on device)\n"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="/dev/full is missing")
@pytest.mark.parametrize("unbuffered", ["", "1"])
@pytest.mark.parametrize(
    ("words", "code", "error"),
    [
        ("--version > /dev/full", 2, FULL),
        ("design --help > /dev/full", 2, FULL),
        ("batch --help | head -n 1", 0, ""),
    ],
)
def test_a_full_output_is_an_error_in_one_line_and_a_closed_pipe_is_none(
    tmp_path: Path, words: str, code: int, error: str, unbuffered: str
) -> None:
    run = subprocess.run(  # noqa: S602
        f"'{COMMAND}' {words}", check=False, capture_output=True, text=True, shell=True,
        cwd=tmp_path, env={**os.environ, "PYTHONUNBUFFERED": unbuffered},
    )  # fmt: skip
    assert (run.returncode, run.stderr) == (code, error)


COMPLETED = {
    ("grasp3d", "lab"): ["label"],
    ("grasp3d", "label", "--sensor"): ["--sensor-resolution"],
    ("grasp3d", "label", "x.stl", "--unit", "m"): ["m", "mm"],
    ("grasp3d", "sweep", "--mass"): [],
    ("grasp3d", "label", "--repair", "f"): ["full"],
}


def test_shells_complete_commands_options_and_words(tmp_path: Path) -> None:
    (tmp_path / "grasp3d.sh").write_text(printed("--completion", cwd=tmp_path), encoding="utf-8")

    def told(shell: str, code: str) -> str:
        words = [shell, "-c", f"source ./grasp3d.sh; {code}"]
        return subprocess.run(
            words, cwd=tmp_path, check=True, capture_output=True, text=True
        ).stdout

    for words, expected in COMPLETED.items():
        typed = f"COMP_WORDS=({' '.join(words)}); COMP_CWORD={len(words) - 1}"
        assert told("bash", f'{typed}; _grasp3d; echo "${{COMPREPLY[@]}}"').split() == expected
    if shutil.which("zsh"):
        assert "function" in told("zsh", "whence -w _grasp3d")


WORDS = "the motors do not carry the links alone"
HEADINGS = ("pose", "margin", "holds\nkg", "load", "reason")
ROWS = [(str(row + 1), f"{row}.25°", f"0.{row}04", f"{row} %", WORDS * row) for row in range(2)]


def table(width: int) -> list[str]:
    report, stream = Report(), io.StringIO()
    report.console = Console(file=stream, width=width, color_system=None, legacy_windows=False)
    report.table(HEADINGS, ROWS, texts=(4,))
    return [line.rstrip() for line in stream.getvalue().splitlines()]


@pytest.mark.parametrize("width", [200, 60, 20])
def test_a_narrow_terminal_folds_texts_and_cuts_no_number(width: int) -> None:
    lines = table(width)
    assert (max(map(len, lines)) <= width) == (width > 20)
    words = " ".join(lines).split()
    for row in ROWS:
        assert {*row[1:3], *row[-1].split()} <= {*words}
    assert "…" not in " ".join(lines)


def test_files_and_pipes_get_whole_lines() -> None:
    assert Report().console.width == UNLIMITED
    assert len(table(UNLIMITED)) == 4


def design(*arguments: object) -> tuple[dict[str, str], list[list[str]]]:
    """Values by the words in the left column, and rows of the table that start with a number."""
    lines = printed("design", *map(str, arguments), cwd=Path(), columns=80).splitlines()
    pairs = (re.split(r"  +", line.strip(), maxsplit=1) for line in lines)
    rows = [line.split() for line in lines if re.match(r" *\d\S*  ", line)]
    return {pair[0]: pair[1].strip() for pair in pairs if len(pair) == 2}, rows


def test_without_options_it_prints_the_numbers_of_the_paper() -> None:
    facts, rows = design()
    assert facts["fingertip"] == "radius 10 mm"
    assert [float(row[0]) for row in rows] == [step / 10.0 for step in range(1, 11)]
    assert ["0.5", "9.273", "53.13°", "10", "10"] in rows
    assert ["0.2", "3.948", "22.62°", "52", "52"] in rows
    for words, radius, given in (((), 10.0, rows), (("--fingertip-radius", "0.6cm"), 6.0, None)):
        for row in given or design(*words, "--friction", 0.3, 0.7)[1]:
            sensor = Sensor.limiting(float(row[0]), radius)
            assert float(row[1]) == pytest.approx(sensor.receptive_field, abs=0.006)
            assert row[2] == f"{math.degrees(sensor.resolution):.2f}°"
            assert row[3:] == [str(sensor.sensors_by_discs), str(sensor.sensors_by_caps)]


def test_a_sensor_requires_friction_and_is_compared_with_some() -> None:
    words = ("--receptive-field", "4mm", "--friction", 0.2, 0.5, "--joints", 2)
    facts, rows = design(*words)
    assert (
        facts.items()
        >= {
            "fingertip": "radius 10 mm",
            "receptive field": "4 mm",
            "sensor resolution": f"{math.degrees(0.4):.2f}°",
            "location uncertainty": "within 2 mm",
            "sensors on the hemisphere": "at least 50 (discs), 51 (caps)",
            "required friction": f"above {math.tan(0.2):.4g}",
        }.items()
    )
    for row, friction in zip(rows, (0.2, 0.5), strict=True):
        margin = math.atan(friction) - 0.2
        assert float(row[0]) == friction
        assert row[1:3] == ["yes" if margin > 0.0 else "no", f"{math.degrees(margin):.2f}°"]
        assert float(row[3]) == pytest.approx(float(effective_friction(friction, 0.4)), rel=1e-3)
        assert row[4] == str(required_counts(2, friction, 0.4)).lower()
    assert design("--sensor-resolution", "0.4rad", *words[2:]) == (facts, rows)


def test_a_sensor_with_the_limiting_resolution_is_not_fine_enough() -> None:
    resolution = math.degrees(2.0 * math.atan(0.5))
    _, rows = design("--sensor-resolution", repr(resolution), "--friction", 0.5, 0.51, 0.499999)
    assert [row[1] for row in rows] == ["no", "yes", "no"]
    assert rows[0][2] == rows[2][2] == "0.00°"  # rounded from -0.00005
