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
from PIL import Image

from grasp3d.pictures import opengl
from grasp3d.viewer.page import PORT
from tests.helpers import shapes
from tests.helpers.commands import COMMAND, export, run_process
from tests.pictures.test_opengl import needs_opengl

KEPT = {name: value for name, value in os.environ.items() if name not in {"DISPLAY", opengl.WINDOW}}


@pytest.fixture
def box(tmp_path: Path) -> Path:
    export(tmp_path / "box.stl", shapes.box((0.06, 0.04, 0.1)))
    return tmp_path


@pytest.mark.slow
@needs_opengl
def test_a_picture_without_a_display(box: Path) -> None:
    options = ("--width", "401", "--height", "301", "--friction", "0.9", "--paint", "label")
    run = run_process("view", "box.stl", "--screenshot", "a.png", *options, cwd=box, env=KEPT)
    assert (run.returncode, run.stdout) == (0, "written: a.png\n")
    assert re.fullmatch(r"(grasp3d: compiling .*\n)*", run.stderr)  # if nothing was compiled before
    with Image.open(box / "a.png") as image:
        colors = np.array(image.convert("RGB"))
    assert colors.shape == (301, 401, 3)
    green = (colors[..., 1] > colors[..., 0] + 50) & (colors[..., 1] > colors[..., 2])
    assert green.mean() > 0.1  # most of a box is S
    assert sorted(p.name for p in box.iterdir()) == ["a.png", "box.stl"]


@pytest.mark.slow
@needs_opengl
def test_the_page_is_served_at_a_free_port_until_interrupted(box: Path) -> None:
    with socket.socket() as taken:
        with suppress(OSError):  # another process has it
            taken.bind(("127.0.0.1", PORT))
            taken.listen()
        command = [str(COMMAND), "view", "box.stl"]
        with subprocess.Popen(
            command, cwd=box, env=KEPT, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE
        ) as run:
            try:
                assert run.stdout is not None
                line = run.stdout.readline()
                address = r"(http://127\.0\.0\.1:(\d+)/[0-9a-f]{32}/)"
                found = re.match(f"no display here: DISPLAY is not set; {address} shows ", line)
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
