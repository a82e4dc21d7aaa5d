"""The help of every command, and its examples."""

import shlex
import subprocess
import sys
from pathlib import Path
from unittest.mock import Mock

import pytest

from grasp3d.cli import KINDS
from grasp3d.cli.options import options_of
from grasp3d.cli.usage import GROUPS, MAIN, MOST_OPTIONS, examples_of, groups_of, invocation, parse
from tests.helpers.commands import printed

MESHES = Path(__file__).parents[2] / "meshes"


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
    """Those of `design` are run, the others parsed: they take longer."""
    if not words.startswith("design"):
        monkeypatch.setattr("grasp3d.cli.import_module", lambda _: Mock(run=lambda *_: 0))
    (tmp_path / "meshes").symlink_to(MESHES)
    printed(*shlex.split(words), cwd=tmp_path)


@pytest.mark.parametrize("up", ["z", "-x", "-y", "-z"])
def test_words_that_begin_with_a_dash_are_values(up: str) -> None:
    words = ["x.stl", "--hand", "franka", "--table", "as-is", "--best", "1", "--at", "-1,-2mm,3"]
    for given in (["--up", up], [f"--up={up}"]):
        command = parse(KINDS["label"], [*words, *given])
        assert (command.reach.up, command.at) == (up, ("-1,-2mm,3",))


@pytest.mark.slow
def test_the_module_is_the_command(tmp_path: Path) -> None:
    words = [sys.executable, "-m", "grasp3d", "design", "--nope"]
    run = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (run.returncode, run.stdout) == (2, "")
    assert run.stderr.startswith("grasp3d: grasp3d design has no option --nope")
