"""Files that are there already: no command replaces one without being asked to."""

from pathlib import Path

import pytest

from tests.helpers import shapes
from tests.helpers.commands import export, printed
from tests.helpers.commands import run_here as grasp3d

SWEEP = ("sweep", "circle", "--friction", "0.5", "-o", "out.csv")


@pytest.mark.parametrize(
    ("file", "words"),
    [
        ("box_labeled.ply", ("label", "box.stl")),
        ("grasps.json", ("label", "box.stl", "--best", "1", "--grasps", "grasps.json")),
        ("out.csv", SWEEP),
        ("out.svg", SWEEP),
        ("check.json", ("check", "box.stl", "-o", "check.json")),
    ],
)
def test_an_existing_file_is_kept(tmp_path: Path, file: str, words: tuple[str, ...]) -> None:
    export(tmp_path / "box.stl", shapes.box((0.04, 0.06, 0.08)))
    (tmp_path / file).write_text("mine", encoding="ascii")
    done = grasp3d(*words, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert f"{file}: exists; name another file, or replace it with --overwrite" in done.stderr
    assert {path.name for path in tmp_path.iterdir()} == {"box.stl", file}
    assert (tmp_path / file).read_text(encoding="ascii") == "mine"


def test_a_file_is_replaced_where_that_is_wanted(tmp_path: Path) -> None:
    (tmp_path / "out.csv").write_text("mine", encoding="ascii")
    printed(*SWEEP, "--overwrite", cwd=tmp_path)
    assert (tmp_path / "out.csv").read_text(encoding="utf-8").startswith('"name"')
