"""Lengths with units on the command line, and lengths that cannot be meant."""

import json
from pathlib import Path

import numpy as np
import pytest

from tests.helpers import shapes
from tests.helpers.commands import export
from tests.helpers.commands import run_here as grasp3d

COARSE = ("--max-edge", "inf")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    export(tmp_path / "box.stl", shapes.box((40.0, 60.0, 80.0)))
    (tmp_path / "pair.json").write_text(json.dumps([[[-20, 0, 0], [20, 0, 0]]]), encoding="utf-8")
    return tmp_path


def settings_in(path: Path) -> dict[str, str]:
    with np.load(path) as data:
        return {name: str(data[name]) for name in data.files if name.startswith("setting_")}


@pytest.mark.slow
def test_a_length_with_a_unit_is_written_in_metres(folder: Path) -> None:
    for name, length in (("text", "7cm"), ("number", "0.07")):
        done = grasp3d(
            "label", "box.stl", "--unit", "mm", "--max-opening", length, *COARSE,
            "-o", f"{name}.npz", cwd=folder,
        )  # fmt: skip
        assert (done.returncode, done.stderr) == (0, "")
    text, number = (settings_in(folder / f"{name}.npz") for name in ("text", "number"))
    assert text == number
    assert (text["setting_max_opening"], text["setting_lengths"]) == ("0.07", "m")


@pytest.mark.slow
def test_a_mesh_of_a_batch_fails_where_a_length_cannot_be_meant(
    folder: Path,
) -> None:
    (folder / "lib").mkdir()
    export(folder / "lib" / "small.glb", shapes.box((0.04, 0.06, 0.08)))
    export(folder / "lib" / "large.glb", shapes.box((4.0, 6.0, 8.0)))
    words = ("batch", "lib", "-o", "out", "--workers", "0", *COARSE)
    done = grasp3d(*words, "--max-opening", "1cm", cwd=folder)
    assert done.returncode == 1
    assert "1 labelled, 1 failed" in done.stdout
    assert "failed: max_opening is 10 mm, 0.000928 times the size of large.glb" in done.stdout
    assert "max_opening 0.01\n" in (folder / "out/surfaces/small.glb.ply").read_bytes()[
        :4096
    ].decode("ascii", "replace")
    done = grasp3d(*words, "--max-opening", "1cm", cwd=folder)
    assert "0 to label" not in done.stdout
    assert "; 2 of them were finished before" in done.stdout
    done = grasp3d(*words, "--max-opening", "1cm", "--force", cwd=folder)
    assert done.returncode == 0
    assert "2 labelled, 0 failed; 1 of them were finished before" in done.stdout
    assert "max_opening is 10 mm, 0.000928 times the size of large.glb" in done.stdout
