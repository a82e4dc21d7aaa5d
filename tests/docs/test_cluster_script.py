"""The script of the guide on libraries runs on a SLURM cluster, which commands imitate here."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import trimesh

from tests.helpers.dask_cluster import PATHS, ROOT

COMMANDS = {
    "srun": """
while [ "${1#--}" != "$1" ]; do shift; done
"$@" > one.log 2>&1 & one=$!
"$@" > two.log 2>&1 & two=$!
trap 'kill $one $two' TERM
wait
""",
    # Labelling takes too long for a test; `check` uses the workers in the same way.
    "grasp3d": f"""
while [ "$1" != --scheduler ]; do shift; done
exec {sys.executable} -P -m grasp3d check meshes --quiet -o checked.json "$@"
""",
    "dask": f'\nexec {sys.executable} -m dask "$@"\n',
}
"""Commands of a SLURM cluster that the script calls, by name."""


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_the_script_of_the_guide_runs_in_one_job(tmp_path: Path) -> None:
    (tmp_path / "bin").mkdir()
    for name, text in COMMANDS.items():
        path = tmp_path / "bin" / name
        path.write_text(f"#!/bin/sh{text}", encoding="ascii")
        path.chmod(0o755)
    (tmp_path / "meshes").mkdir()
    for number in range(2):
        trimesh.creation.box().export(tmp_path / "meshes" / f"{number}.stl")
    guide = (ROOT / "docs" / "guide" / "libraries.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```\w+\n(#!/bin/bash\n.*?)```", guide, flags=re.DOTALL)
    (tmp_path / "job.sh").write_text(block.replace(".venv/bin/activate", "/dev/null"))
    command, path = ["bash", "job.sh"], os.pathsep.join([str(tmp_path / "bin"), os.environ["PATH"]])
    with (tmp_path / "log").open("wb") as log:  # no pipe: processes left behind would keep it open
        done = subprocess.run(
            command,
            cwd=tmp_path,
            env={**os.environ, **PATHS, "PATH": path, "SLURM_JOB_ID": "7", "SLURM_NTASKS": "2"},
            stdout=log,
            stderr=log,
            timeout=180.0,
            check=False,
        )
    assert done.returncode == 0, (tmp_path / "log").read_text()
    meshes = json.loads((tmp_path / "checked.json").read_text(encoding="utf-8"))["meshes"]
    assert [mesh["mesh"] for mesh in meshes] == ["0.stl", "1.stl"]
    assert meshes[0]["trust"] == "yes"
