"""The help of every command, and its examples."""

import re
import shlex
from pathlib import Path

import pytest

from grasp3d.cli.batch import Batch
from grasp3d.cli.check import Check
from grasp3d.cli.evaluate import Evaluate
from grasp3d.cli.examples import EXAMPLES
from grasp3d.cli.hand import Hand
from grasp3d.cli.label import Label
from grasp3d.cli.paper import Paper
from grasp3d.cli.perturb import Perturb
from grasp3d.cli.simulate import Simulate
from grasp3d.cli.sweep import Sweep
from grasp3d.cli.validate import Validate
from grasp3d.cli.view import View
from grasp3d.cli.warmup import Warmup
from tests.helpers.commands import run_here as grasp3d

MESHES = Path(__file__).parents[2] / "meshes"


def commands() -> list[str]:
    usage = grasp3d("--help", cwd=Path()).stdout.splitlines()[0]
    return re.findall(r"\w+", usage.partition("{")[2])


@pytest.mark.slow
def test_every_command_has_at_least_two_examples() -> None:
    assert set(EXAMPLES) <= set(commands())
    for command in commands():
        run = grasp3d(command, "--help", cwd=Path(), columns=80)
        assert run.returncode == 0
        lines = run.stdout[run.stdout.index("\nexamples:\n") :].split("\n")[2:-1]
        assert len(lines) >= 4
        assert [line[:4] for line in lines] == ["  # ", "  gr"] * (len(lines) // 2)
        assert all(f"{line} ".startswith(f"  grasp3d {command} ") for line in lines[1::2])
        assert max(map(len, lines)) <= 100


def test_the_version_is_listed() -> None:
    run = grasp3d("--help", cwd=Path(), columns=80)
    assert re.search(r"--version +Print the version\.", run.stdout)
    assert "examples:\n" in run.stdout
    assert grasp3d("--version", cwd=Path()).stdout.startswith("grasp3d 0.")


@pytest.mark.slow
def test_placeholders_are_the_same_everywhere() -> None:
    for command in commands():
        text = grasp3d(command, "--help", cwd=Path(), columns=80).stdout
        for word in ("{None", "STR", "(default: )", "(default: None)", "default: False"):
            assert word not in text, command
        for name in re.findall(r"--(?:\w+-opening|patch-radius|max-spread|max-distance)", text):
            assert f"{name} LENGTH" in text
        if "--unit" in text:
            assert "Unit of the mesh's coordinates" in " ".join(text.replace("│", " ").split())


@pytest.mark.slow
@pytest.mark.parametrize("words", [words for pair in EXAMPLES.values() for _, words in pair])
def test_the_examples_are_valid(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: str
) -> None:
    """Those of `design` are run, the others parsed: they take longer."""
    others = Evaluate, Validate, Simulate, Batch, Sweep, Hand, View, Paper, Perturb, Warmup
    for command in (Label, Check, *others):
        monkeypatch.setattr(command, "run", lambda _: 0)
    run = grasp3d(*shlex.split(words), cwd=tmp_path)
    assert (run.returncode, run.stderr) == (0, "")
    for path in re.findall(r"meshes/\w+\.\w+", words):
        assert (MESHES.parent / path).exists()
