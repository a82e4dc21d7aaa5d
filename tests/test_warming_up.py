"""Compiling ahead: once, announced, and complete."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import grasp3d
from grasp3d._kernels.announcing import PHASES
from grasp3d.errors import SettingError
from tests.helpers.commands import run_here

ROOT = Path(grasp3d.__file__).parents[1]

COMMANDS = """
import sys
from pathlib import Path
from grasp3d.cli import main
from numba.core import event

kernels = set()

class Recorder(event.Listener):
    depth = 0
    def on_start(self, event):
        self.depth += 1
        kernel = event.data["dispatcher"].py_func
        kernels.update({f"{kernel.__module__}.{kernel.__name__}"} if self.depth == 1 else ())
    def on_end(self, event):
        self.depth -= 1

def run(*words):
    assert main(list(map(str, words))) == 0, words

if __name__ == "__main__":
    event.register("numba:compile", Recorder())
    meshes, stage = Path(sys.argv[1]), sys.argv[2]
    if stage == "compile":
        run("warmup")
    else:
        mug = (meshes / "mug.glb", "--max-edge", "20mm")
        run("warmup")
        run("label", *mug, "--best", 2)
        run("label", *mug, "-o", "patches.ply", "--patch-radius", "5mm")
        run("label", *mug, "-o", "extremes.ply", "--method", "extremes", "--edges", 4)
        run("label", *mug, "-o", "soft.ply", "--torsion-radius", "5mm")
        run("evaluate", *mug, "mug_grasps.json", "-q")
        run("sweep", *mug)
        run("check", *mug)
        run("batch", meshes / "cone.off", meshes / "sphere.stl", "-o", "results", "--workers", 1)
    print("kernels", *kernels)
"""


@pytest.mark.parametrize("fingers", [1, 6, 2.5, "two"])
def test_numbers_of_fingers_outside_the_range_are_refused(fingers: object) -> None:
    with pytest.raises(SettingError, match="fingers must be"):
        grasp3d.warmup(fingers)  # type: ignore[arg-type]


@pytest.mark.slow
def test_what_is_compiled_is_compiled_once(tmp_path: Path) -> None:
    grasp3d.warmup()
    assert grasp3d.warmup() == ()
    done = run_here("warmup", cwd=tmp_path)
    assert (done.returncode, done.stdout) == (0, "already compiled\n")
    assert run_here("warmup", "--quiet", cwd=tmp_path).stdout == ""


@pytest.mark.slow
@pytest.mark.skipif(bool(os.environ.get("NUMBA_DISABLE_JIT")), reason="nothing is compiled")
def test_after_warmup_no_command_compiles(tmp_path: Path) -> None:
    cache, code = tmp_path / "cache", tmp_path / "commands.py"
    code.write_text(COMMANDS)
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": str(ROOT)}

    def run(stage: str) -> tuple[str, str, set[Path]]:
        words = [sys.executable, str(code), str(ROOT / "meshes"), stage]
        done = subprocess.run(
            words, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        return done.stdout, done.stderr, set(cache.rglob("*.nb?"))

    printed, lines, compiled = run("compile")
    assert printed.startswith("compiled in ")
    works = [line.split("kernels for ")[1].split(",")[0] for line in lines.splitlines()]
    assert works == ["meshes", "contact patches", "two fingers", "epsilon"]
    known = {f"grasp3d._kernels.{kernel}" for phase in PHASES for kernel in phase.kernels}
    assert set(printed.splitlines()[-1].split()[1:]) <= known
    printed, lines, after = run("use")
    assert printed.startswith("already compiled\n")
    assert printed.splitlines()[-1] == "kernels"
    assert "compiling" not in lines
    assert after == compiled
