"""Compiling ahead, and before the jobs of a run: once, announced, and complete."""

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

import grasp3d
from grasp3d._kernels.compiling.machine_code import cache_folder
from grasp3d.batch import cluster, warmup
from grasp3d.batch.batch_settings import ClusterSettings
from grasp3d.batch.job_requests import Request
from grasp3d.batch.run import run
from grasp3d.batch.warmup import Kernels, compile_first, compile_kernels, missing_line
from grasp3d.errors import OutputError, SettingError
from grasp3d.system.compiling import NotCompiledError, announcement, compilations
from grasp3d.system.isolation import CallFailedError, CallFailure
from tests.helpers import mesh_files
from tests.helpers.commands import run_here
from tests.helpers.jobs import Work, lost, work

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
    "normal_sets.largest_angle", "normal_sets.smallest_angle", "rays.starting_rays",
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
def test_the_rare_proof_of_closure_is_compiled_too() -> None:
    """In a process of its own, where nothing else needs that kernel."""
    code = (
        "from grasp3d.batch.warmup import compile_kernels; compile_kernels(2); "
        "from grasp3d._kernels.hull.wrench_problem import verify; print(len(verify.signatures))"
    )
    found = subprocess.run([sys.executable, "-c", code], stdout=subprocess.PIPE, check=True)
    assert int(found.stdout) == 1


@pytest.mark.slow
@pytest.mark.skipif(bool(os.environ.get("NUMBA_DISABLE_JIT")), reason="nothing is compiled")
def test_a_folder_can_be_filled_for_others(tmp_path: Path) -> None:
    grasp3d.warmup()
    stored = cache_folder()
    assert stored is not None
    # What is compiled already would take a minute.
    shutil.copytree(stored, tmp_path / "kernels" / stored.name)
    (index,) = (tmp_path / "kernels" / stored.name).glob("*.scan-*.nbi")
    index.unlink()
    done = run_here("warmup", "--cache", "kernels", cwd=tmp_path)
    assert done.returncode == 0
    assert done.stdout.startswith("compiled 1 kernel in ")
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
    assert missing_line(Kernels(2, forces=True)) == ""
    assert run_here("warmup", "--forces", cwd=tmp_path).stdout == "already compiled\n"
    with compilations.refused():
        label_under_loads(torsion_radius=0.0)
        label_under_loads(torsion_radius="3mm")


def label_under_loads(torsion_radius: float | str) -> None:
    """Compute grip forces and payloads of a block, under a task of each kind."""
    block = trimesh.creation.box([0.08, 0.05, 0.03])
    mesh = grasp3d.load_mesh(block, unit="m", max_edge=0.05)
    model = grasp3d.GraspModel(torsion_radius=torsion_radius, sensor_resolution=0.2)
    for task in ("weight", "weight within 30 of -z", "wrench 0,0,-5,0,0,0.1"):
        load = grasp3d.Load(mass=0.5, grip_force=40.0, task=task, center_of_mass_radius="1mm")
        holding = grasp3d.label_surface(mesh, model, load=load).holding
        assert holding is not None
        assert (holding.grip_force[~np.isnan(holding.grip_force)] > 0.0).all()


def test_what_is_missing_is_announced(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[object] = []

    def uncompiled(*arguments: object) -> None:
        calls.append(arguments)
        raise NotCompiledError

    monkeypatch.setattr(warmup, "compile_kernels", uncompiled)
    assert missing_line(Kernels(2, forces=True)) == announcement(stored=cache_folder() is not None)
    assert calls == [(2, False, True)]
    monkeypatch.setattr(warmup, "compile_kernels", lambda *_: None)
    assert missing_line(Kernels(2)) == ""


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
    assert printed.startswith("compiled 1 kernel in ")
    assert lines == f"{announcement(stored=True)}\n"
    *_, loaded, compiled = printed.splitlines()
    assert compiled == "kernels grasp3d._kernels.surface.patches.reset_front"
    used = [*loaded.split()[1:], *(path.name for path in cache.rglob("patches.reset_front-*.nbc"))]
    for path in cache.rglob("*.nbc"):
        if path.name not in used and kernel_of(path.name) not in NESTED:
            path.unlink()
    left = {*cache.rglob("*.nb?")}
    printed, lines = run("use")
    assert printed.startswith("already compiled\n")
    assert printed.splitlines()[-1] == "kernels"
    assert "compiling" not in lines
    assert {*cache.rglob("*.nb?")} == left


def kernel_of(file: str) -> str:
    return file.rsplit("-", 1)[0]


@dataclass
class Calls:
    """Calls in child processes, which are recorded but not made."""

    line: str = ""
    failing: bool = False
    made: list[tuple[Any, ...]] = field(default_factory=list)

    def __call__(self, function: Callable[..., Any] | bytes, *arguments: Any, **limits: Any) -> str:
        time.sleep(0.01)
        self.made.append((function, *arguments))
        assert not {"memory", "seconds"} & set(limits)
        if self.failing:
            raise CallFailedError(CallFailure.CANCELLED, "was cancelled")
        return self.line if function is missing_line else ""


@pytest.fixture(autouse=True)
def _nothing_compiled() -> Iterator[None]:
    compile_first.cache_clear()
    yield
    compile_first.cache_clear()


@pytest.mark.parametrize(
    ("calls", "then"),
    [
        (Calls("compiling takes a while"), [(compile_kernels, *Kernels(2))]),
        (Calls(), []),  # all are compiled
        (Calls(failing=True), []),  # left to the jobs
    ],
)
def test_missing_kernels_are_compiled_once_and_announced_before(
    calls: Calls,
    then: list[object],
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    monkeypatch.setattr(warmup, "call", calls)
    compile_first(Kernels(2))
    compile_first(Kernels(2))
    assert calls.made == [(missing_line, Kernels(2)), *then]
    announced = [(one.name, one.getMessage()) for one in caplog.records]
    assert announced == [("grasp3d.compiling", calls.line)] * len(then)


@pytest.mark.slow
def test_a_run_compiles_before_its_first_job(monkeypatch: pytest.MonkeyPatch) -> None:
    order: list[object] = []

    def noted(kernels: Kernels, *, children: int) -> None:
        assert children == 1
        order.append(kernels)

    monkeypatch.setattr("grasp3d.batch.run.compile_first", noted)
    monkeypatch.setattr("grasp3d.batch.run.compile_kernels", lambda *kernels: order.append(kernels))
    jobs = [Work("well")]
    for workers in (1, 0):
        settings = ClusterSettings(workers=workers)
        options: dict[str, Any] = {"started": order.append, "kernels": Kernels(4, forces=True)}
        rows = run(work, jobs, 0.0, lost=lost, cluster=settings, **options)
        assert len(list(rows)) == 1
    assert order == [(4, False, True), jobs[0], (4, False, True), jobs[0]]


def test_each_worker_of_a_cluster_prepares_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Several threads of a worker get their first requests at once."""
    calls = Calls()
    monkeypatch.setattr(cluster, "call_pickled", calls)
    monkeypatch.setattr(cluster, "_prepared", set())
    plain = Request(b"job", "", memory=1.0, seconds=1.0, versions="")
    prepared = Request(b"job", "", 1.0, 1.0, versions="", preparation=b"compile")
    with ThreadPoolExecutor(4) as threads:
        for request in [prepared, plain] * 4:
            threads.submit(cluster.prepare, request, bool)
    assert calls.made == [(b"compile", "")]


def test_a_cancelled_preparation_is_made_again(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = Calls(failing=True)
    monkeypatch.setattr(cluster, "call_pickled", calls)
    monkeypatch.setattr(cluster, "_prepared", set())
    request = Request(b"job", "", 1.0, 1.0, versions="", preparation=b"compile")
    cluster.prepare(request, bool)
    cluster.prepare(request, bool)
    assert len(calls.made) == 2
