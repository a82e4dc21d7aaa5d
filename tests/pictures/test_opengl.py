"""Whether pictures can be rendered here."""

import os
import subprocess
import sys
from ctypes.util import find_library
from pathlib import Path

import pytest

from grasp3d.errors import OutputError
from grasp3d.pictures import opengl
from grasp3d.pictures.opengl import can_render

NO_LIBRARY = {opengl.WINDOW: "vtkOSOpenGLRenderWindow"}
# In CI a missing OpenGL is a failure.
needs_opengl = pytest.mark.skipif(not (os.environ.get("CI") or can_render()), reason="needs OpenGL")


@pytest.fixture
def without_cache() -> object:
    """Clear the cached result of `can_render` before and after the test."""
    for cached in (can_render, opengl.begin_render_test):
        cached.cache_clear()
    yield None
    for cached in (can_render, opengl.begin_render_test):
        cached.cache_clear()


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="needs a shell script")
@pytest.mark.parametrize("script", ["kill -SEGV $$", "exit 1", "exec sleep 60"])
@pytest.mark.usefixtures("without_cache")
def test_a_process_that_dies_or_hangs_means_no_rendering(
    script: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(opengl, "TIMEOUT", 0.5)
    python = tmp_path / "python"
    python.write_text(f"#!/bin/sh\n{script}\n")
    python.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(python))
    assert not can_render()
    with pytest.raises(OutputError, match="need OpenGL"):
        opengl.check_rendering()


@pytest.mark.usefixtures("without_cache")
def test_the_separate_process_finds_what_it_imports(monkeypatch: pytest.MonkeyPatch) -> None:
    codes: list[str] = []
    monkeypatch.setattr(opengl, "_started", codes.append)
    can_render()
    imports, _, _ = codes[0].partition(";")
    exec(imports)  # noqa: S102


@pytest.mark.slow
@pytest.mark.skipif(
    sys.platform != "linux" or find_library("OSMesa") is not None, reason="OSMesa draws"
)
def test_a_missing_library_is_detected_in_a_separate_process() -> None:
    code = (
        f"import os; os.environ.update({NO_LIBRARY}); os.environ.pop('DISPLAY', None)\n"
        "from grasp3d.pictures.opengl import can_render; print(can_render(), can_render())"
    )
    run = subprocess.run(
        [sys.executable, "-c", code], check=True, capture_output=True, text=True, timeout=120
    )
    assert (run.stdout, run.stderr) == ("False False\n", "")
