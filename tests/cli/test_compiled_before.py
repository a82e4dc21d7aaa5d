"""Commands compile nothing that was compiled ahead."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
import trimesh

import grasp3d
from grasp3d._kernels.ahead import warmup
from tests.helpers import mesh_files

ROOT = Path(grasp3d.__file__).parents[1]

COMMANDS = """
import sys
from pathlib import Path
from grasp3d._kernels.ahead import kernels
from grasp3d._kernels.compiling import SIGNATURES
from grasp3d.cli import main

def run(*words):
    assert main(list(map(str, words))) == 0, words

if __name__ == "__main__":
    meshes = Path(sys.argv[1])
    mug = (meshes / "mug.glb", "--max-edge", "20mm")
    small = ("small.off", "--unit", "cm", "--max-edge", "2mm", "--friction", 1)
    block = ("block.off", "--unit", "m", "--max-edge", "40mm")
    held = ("--hand", "robotiq_2f85", "--table", "as-is", "--mass", "0.1kg")
    run("label", *mug, "--best", 2)
    run("label", *small, "-o", "extremes.ply", "--method", "extremes")
    run("label", *mug, "-o", "part.ply", "--region", "mug_labeled.ply")
    run("label", *mug, "-o", "located.ply", "--location-error", "1mm", "--friction", "0.4..0.6")
    run("label", *mug, *held, "-o", "held.ply", "--best", 2, "--grasps", "poses.json")
    run("label", *small, "--fingers", 3, "-o", "three.ply")
    load = ("--mass", "0.5kg", "--grip-force", 40, "--overwrite")
    for task, radius in (("weight", 0), ("weight within 30 of -z", "3mm")):
        run("label", *block, *load, "--task", task, "--torsion-radius", radius)
    run("evaluate", *mug, "mug_grasps.json", "-q")
    run("evaluate", *mug, "poses.json", *held, "-q", "-o", "p.csv", "--region", "mug_labeled.ply")
    run("evaluate", *mug, "poses.json", *held, "-q", "--overwrite")
    run("check", *mug)
    print("compiled", *(kernel for kernel in SIGNATURES if kernel.stats.cache_misses))
    # What other tests have compiled is found, too.
    called = ((name, kernel.signatures, ways) for name, (kernel, ways) in kernels().items())
    print("undeclared", *(name for name, types, ways in called if not {*types} <= {*ways}))
"""


@pytest.mark.slow
@pytest.mark.skipif(bool(os.environ.get("NUMBA_DISABLE_JIT")), reason="nothing is compiled")
def test_no_command_compiles_what_was_compiled_ahead(tmp_path: Path) -> None:
    warmup()
    code = tmp_path / "commands.py"
    code.write_text(COMMANDS)
    (tmp_path / "small.off").write_text(mesh_files.off_text())
    trimesh.creation.box([0.08, 0.05, 0.03]).subdivide().export(tmp_path / "block.off")
    done = subprocess.run(
        [sys.executable, str(code), str(ROOT / "meshes")], cwd=tmp_path, capture_output=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)}, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-2:] == ["compiled", "undeclared"]
    assert "compiling" not in done.stderr
