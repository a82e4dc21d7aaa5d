"""Compiling ahead: once, announced, and complete."""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

import grasp3d
from grasp3d._kernels.compiling import announcing
from grasp3d._kernels.compiling.announcing import FORCES, PHASES, Phase, all_compiled
from grasp3d._kernels.compiling.machine_code import cache_folder
from grasp3d.batch import warmup
from grasp3d.batch.warmup import announcement
from grasp3d.errors import OutputError, SettingError
from tests.helpers import mesh_files
from tests.helpers.commands import run_here

ROOT = Path(grasp3d.__file__).parents[1]

COMMANDS = """
import sys
from pathlib import Path
from grasp3d.cli import main
from numba.core import event
from numba.core.caching import IndexDataCacheFile

used, kernels = [], set()
load = IndexDataCacheFile._load_data

def recorded(self, name):
    used.append(name)
    return load(self, name)

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
    IndexDataCacheFile._load_data = recorded
    meshes, stage = Path(sys.argv[1]), sys.argv[2]
    if stage == "warm up":
        run("warmup", "--gripper")
        print("files", *used)
    else:
        mug = (meshes / "mug.glb", "--max-edge", "20mm")
        # Epsilon of soft fingers takes long.
        small = ("small.off", "--unit", "cm", "--max-edge", "2mm", "--friction", 1)
        run("warmup", "--gripper")
        run("label", *mug, "--best", 2)
        run("label", *mug, "-o", "patches.ply", "--patch-radius", "5mm")
        run("label", *small, "-o", "extremes.ply", "--method", "extremes", "--edges", 4)
        run("label", *mug, "-o", "located.ply", "--location-error", "1mm", "--normal-error", 2)
        run("label", *small, "-o", "soft.ply", "--torsion-radius", "1mm")
        held = ("--gripper", "robotiq_2f85", "--table", "as-is")
        run("label", *mug, *held, "-o", "held.ply", "--best", 2, "--grasps", "poses.json")
        run("evaluate", *mug, "mug_grasps.json", "-q")
        run("evaluate", *mug, "poses.json", *held, "-q")
        run("sweep", *mug)
        run("check", *mug)
        run("batch", meshes / "cone.off", meshes / "sphere.stl", "-o", "results", "--workers", 1)
    print("kernels", *kernels)
"""


NESTED = {
    "normal_angles.largest_angle", "normal_angles.smallest_angle", "ray_tracing.starting_rays",
}  # fmt: skip
"""Kernels that commands call, and that are compiled with others, which call them as well."""


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
def test_a_folder_can_be_filled_for_others(tmp_path: Path) -> None:
    grasp3d.warmup()
    stored = cache_folder()
    assert stored is not None
    # What is compiled already would take a minute.
    shutil.copytree(stored, tmp_path / "kernels" / stored.name)
    (index,) = (tmp_path / "kernels" / stored.name).glob("scanning.scan-*.nbi")
    index.unlink()
    done = run_here("warmup", "--cache", "kernels", cwd=tmp_path)
    assert (done.returncode, done.stdout[-7:]) == (0, " scans\n")
    assert index.exists()
    assert grasp3d.warmup(cache=tmp_path / "kernels") == ()


def test_a_folder_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match=r"cannot write machine code to .*file"):
        grasp3d.warmup(cache=tmp_path / "file")
    done = run_here("warmup", "--cache", "file", cwd=tmp_path)
    assert done.returncode != 0
    assert "choose a folder that can be written" in done.stderr


@pytest.mark.slow
def test_what_a_load_needs_is_compiled_on_request(tmp_path: Path) -> None:
    grasp3d.warmup(forces=True)
    assert grasp3d.warmup(forces=True) == ()
    assert FORCES.compiled or os.environ.get("NUMBA_DISABLE_JIT")
    assert announcement(2, forces=True) == ""
    assert run_here("warmup", "--forces", cwd=tmp_path).stdout == "already compiled\n"
    assert all_compiled(lambda: label_under_loads(torsion_radius=0.0))
    assert all_compiled(lambda: label_under_loads(torsion_radius="3mm"))


def label_under_loads(torsion_radius: float | str) -> None:
    """Compute grip forces and payloads of a block, under a task of each kind."""
    block = trimesh.creation.box([0.08, 0.05, 0.03])
    mesh = grasp3d.load_mesh(block, unit="m", max_edge=0.05)
    model = grasp3d.GraspModel(torsion_radius=torsion_radius, sensor_resolution=0.2)
    for task in ("weight", "weight within 30 of -z", "wrench 0,0,-5,0,0,0.1"):
        load = grasp3d.Load(mass=0.5, grip_force=40.0, task=task, center_of_mass_radius="1mm")
        holding = grasp3d.label_surface(mesh, model, load=load, threads=1).holding
        assert holding is not None
        assert (holding.grip_force[~np.isnan(holding.grip_force)] > 0.0).all()


@pytest.mark.parametrize("forces", [False, True])
def test_forces_are_announced_and_compiled_only_for_a_load(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, forces: bool
) -> None:
    asked: list[bool] = []

    def uncompiled(run: Callable[[], object]) -> bool:
        monkeypatch.setattr(warmup, "compile_kernels", lambda *given: asked.append(given[2]))
        run()
        return False

    monkeypatch.setattr(announcing, "all_compiled", uncompiled)
    monkeypatch.setattr(Phase, "compiled", property(lambda phase: phase is not FORCES))
    line = announcement(2, forces=forces)
    assert asked == [forces]
    assert f"about {FORCES.seconds if forces else 0} s" in line
    assert not caplog.messages


@pytest.mark.slow
@pytest.mark.skipif(bool(os.environ.get("NUMBA_DISABLE_JIT")), reason="nothing is compiled")
def test_after_warmup_no_command_compiles(tmp_path: Path) -> None:
    """In a folder with the machine code that warming up uses: compiling it would take minutes."""
    grasp3d.warmup(gripper=True)
    stored, cache, code = cache_folder(), tmp_path / "cache", tmp_path / "commands.py"
    assert stored is not None
    shutil.copytree(stored, cache / stored.name)
    for missing in cache.rglob("patches.reset_front-*"):
        missing.unlink()
    code.write_text(COMMANDS)
    (tmp_path / "small.off").write_text(mesh_files.off_text())
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": str(ROOT)}

    def run(stage: str) -> tuple[str, str]:
        words = [sys.executable, str(code), str(ROOT / "meshes"), stage]
        done = subprocess.run(
            words, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        return done.stdout, done.stderr

    printed, lines = run("warm up")
    assert printed.startswith("compiled in ")
    assert re.findall("kernels for (.*), about", lines) == ["contact patches"]
    *_, loaded, compiled = printed.splitlines()
    assert compiled == "kernels grasp3d._kernels.surface.patches.reset_front"
    used = [*loaded.split()[1:], *(path.name for path in cache.rglob("patches.reset_front-*.nbc"))]
    assert phases_of(used) == {
        "meshes", "contact patches", "uncertain contact locations", "two fingers",
        "searches by rays", "wrenches of contacts", "epsilon of two fingers", "epsilon",
        "epsilon in fewer than six dimensions", "scans", "pictures of batches", "grippers",
        "closing jaws",
    }  # fmt: skip
    for path in cache.rglob("*.nbc"):
        if path.name not in used and kernel_of(path.name) not in NESTED:
            path.unlink()
    left = {*cache.rglob("*.nb?")}
    printed, lines = run("use")
    assert printed.startswith("already compiled\n")
    assert printed.splitlines()[-1] == "kernels"
    assert "compiling" not in lines
    assert {*cache.rglob("*.nb?")} == left


def phases_of(files: list[str]) -> set[str]:
    """What kernels do whose machine code is in these files; each belongs to a phase."""
    works = {kernel: phase.work for phase in PHASES for kernel in phase.kernels}
    return {works[kernel_of(name)] for name in files}


def kernel_of(file: str) -> str:
    return file.rsplit("-", 1)[0]
