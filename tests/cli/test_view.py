"""The command `grasp3d view`; the window and the page are tested in `tests/viewer`."""

import os
import re
import signal
import socket
import subprocess
from contextlib import suppress
from pathlib import Path
from urllib.request import urlopen

import numpy as np
import pytest
import trimesh
from PIL import Image

from grasp3d.pictures import opengl
from grasp3d.viewer.collection import open_collection
from grasp3d.viewer.page import PORT, page_state
from tests.helpers import shapes
from tests.helpers.commands import COMMAND, run_process
from tests.helpers.viewing import ready_session

KEPT = {name: value for name, value in os.environ.items() if name not in {"DISPLAY", opengl.WINDOW}}
needs_opengl = pytest.mark.skipif(
    not (os.environ.get("CI") or opengl.can_render()), reason="needs OpenGL"
)


@pytest.fixture
def box(tmp_path: Path) -> Path:
    trimesh.Trimesh(*shapes.box((0.06, 0.04, 0.1)), process=False).export(tmp_path / "box.stl")
    return tmp_path


@pytest.mark.slow
@needs_opengl
def test_a_picture_without_a_display(box: Path) -> None:
    options = ("--width", "401", "--height", "301", "--friction", "0.9", "--paint", "label")
    run = run_process("view", "box.stl", "--screenshot", "a.png", *options, cwd=box, env=KEPT)
    assert run.returncode == 0
    assert re.fullmatch(r"(grasp3d: compiling .*\n)*", run.stderr)  # if nothing was compiled before
    assert run.stdout == "written: a.png\n"
    with Image.open(box / "a.png") as image:
        colors = np.array(image.convert("RGB"))
    assert colors.shape == (301, 401, 3)
    green = (colors[..., 1] > colors[..., 0] + 50) & (colors[..., 1] > colors[..., 2])
    assert green.mean() > 0.1  # most of a box is S
    assert sorted(p.name for p in box.iterdir()) == ["a.png", "box.stl"]


@pytest.mark.slow
@pytest.mark.parametrize("suffix", ["ply", "npz"])
def test_the_page_of_a_labelled_file_has_the_fractions_that_were_printed(
    box: Path, suffix: str
) -> None:
    words = ("--unit", "m", "--max-edge", "0.02", "--hand", "franka", "--max-opening", "0.05")
    run = run_process("label", "box.stl", *words, "-o", f"box.{suffix}", cwd=box, env=KEPT)
    printed = re.findall(r"■ ([SMU]) .*?([\d.]+) %", run.stdout)
    rows = page_state(ready_session(open_collection(box / f"box.{suffix}")))["rows"]
    shown = {row["letter"]: row["percent"].split()[0] for row in rows}
    assert dict(printed) == shown
    assert 0.0 < float(shown["U"]) < 100.0


@pytest.mark.slow
@needs_opengl
@pytest.mark.parametrize("options", [["--web"], []])
def test_the_page_is_served_at_a_free_port_until_interrupted(box: Path, options: list[str]) -> None:
    with socket.socket() as taken:
        with suppress(OSError):  # another process has it
            taken.bind(("127.0.0.1", PORT))
            taken.listen()
        command = [str(COMMAND), "view", "box.stl", *options]
        with subprocess.Popen(
            command, cwd=box, env=KEPT, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE
        ) as run:
            try:
                assert run.stdout is not None
                line = run.stdout.readline()
                reason = "" if options else "no display here: DISPLAY is not set; "
                found = re.match(
                    rf"{reason}(http://127\.0\.0\.1:(\d+)/[0-9a-f]{{32}}/) shows ", line
                )
                assert found is not None, line
                assert PORT < int(found[2]) <= PORT + 20
                with urlopen(found[1]) as page:  # noqa: S310
                    assert b"<html" in page.read().lower()
                run.send_signal(signal.SIGINT)
                out, error = run.communicate(timeout=60)
            finally:
                run.kill()
    assert (run.returncode, out) == (130, "")
    assert re.fullmatch(r"(grasp3d: compiling .*\n)*grasp3d: interrupted\n", error)
