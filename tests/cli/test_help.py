"""The help of every command, and its examples."""

import re
import shlex
from pathlib import Path
from unittest.mock import Mock

import pytest

from grasp3d.cli import KINDS, examples_of
from tests.helpers.commands import printed
from tests.helpers.commands import run_here as grasp3d

MESHES = Path(__file__).parents[2] / "meshes"


EXAMPLES = [
    line.removeprefix("  grasp3d ")
    for command in KINDS
    for line in examples_of(command).splitlines()[1::2]
]


@pytest.mark.slow
@pytest.mark.parametrize("command", KINDS)
def test_every_command_has_at_least_two_examples(command: str) -> None:
    text = printed(command, "--help", cwd=Path(), columns=80)
    lines = text[text.index("\nexamples:\n") :].split("\n")[2:-1]
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
@pytest.mark.parametrize("command", KINDS)
def test_placeholders_are_the_same_everywhere(command: str) -> None:
    text = grasp3d(command, "--help", cwd=Path(), columns=80).stdout
    for word in ("{None", "STR", "(default: )", "(default: None)", "default: False"):
        assert word not in text
    for name in re.findall(r"--(?:\w+-opening|patch-radius|max-spread|max-distance)", text):
        assert f"{name} LENGTH" in text
    if "--unit" in text:
        assert "Unit of the mesh's coordinates" in " ".join(text.replace("│", " ").split())


@pytest.mark.slow
@pytest.mark.parametrize("words", EXAMPLES)
def test_the_examples_are_valid(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: str
) -> None:
    """Those of `design` are run, the others parsed: they take longer."""
    if not words.startswith("design"):
        monkeypatch.setattr("grasp3d.cli.import_module", lambda _: Mock(run=lambda _: 0))
    printed(*shlex.split(words), cwd=tmp_path)
    for path in re.findall(r"meshes/\w+\.\w+", words):
        assert (MESHES.parent / path).exists()
