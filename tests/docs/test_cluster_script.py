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

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")


def fake_command(folder: Path, name: str, text: str) -> None:
    """Write a command that imitates one of a SLURM cluster."""
    path = folder / "bin" / name
    path.parent.mkdir(exist_ok=True)
    path.write_text(text, encoding="ascii")
    path.chmod(0o755)


SBATCH = """#!/bin/sh
cp "$1" "job-$$.sh" # whoever submits it removes it
setsid sh "job-$$.sh" > job.log 2>&1 &
echo $! >> jobs
echo "Submitted batch job $!"
"""
SCANCEL = """#!/bin/sh
kill -- "-$1"
"""
SRUN = """#!/bin/sh
while [ "${1#--}" != "$1" ]; do shift; done
"$@" > one.log 2>&1 & one=$!
"$@" > two.log 2>&1 & two=$!
trap 'kill $one $two' TERM
wait
"""
CHECK = """#!/bin/sh
# Labelling takes too long for a test; `check` uses the workers in the same way.
while [ "$1" != --scheduler ]; do shift; done
exec {python} -P -c 'import sys; from grasp3d.cli import main; sys.exit(main())' \
check meshes --quiet -o checked.json "$@"
"""


@pytest.fixture
def slurm(tmp_path: Path) -> Path:
    """A folder with meshes and the commands of a SLURM cluster."""
    (tmp_path / "meshes").mkdir()
    for number in range(2):
        trimesh.creation.box().export(tmp_path / "meshes" / f"{number}.stl")
    for name, text in {"sbatch": SBATCH, "scancel": SCANCEL, "squeue": "#!/bin/sh\n"}.items():
        fake_command(tmp_path, name, text)
    fake_command(tmp_path, "srun", SRUN)
    fake_command(tmp_path, "grasp3d", CHECK.format(python=sys.executable))
    fake_command(tmp_path, "dask", f'#!/bin/sh\nexec {sys.executable} -m dask "$@"\n')
    return tmp_path


def check_run(command: list[str], folder: Path) -> None:
    path = os.pathsep.join([str(folder / "bin"), os.environ["PATH"]])
    with (folder / "log").open("wb") as log:  # no pipe: processes left behind would keep it open
        done = subprocess.run(
            command,
            cwd=folder,
            env={**os.environ, **PATHS, "PATH": path, "SLURM_JOB_ID": "7", "SLURM_NTASKS": "2"},
            stdout=log,
            stderr=log,
            timeout=180.0,
            check=False,
        )
    assert done.returncode == 0, (folder / "log").read_text()
    meshes = json.loads((folder / "checked.json").read_text(encoding="utf-8"))["meshes"]
    assert [mesh["mesh"] for mesh in meshes] == ["0.stl", "1.stl"]
    assert meshes[0]["trust"] == "yes"


@pytest.mark.slow
def test_the_script_of_the_guide_runs_in_one_job(slurm: Path) -> None:
    guide = (ROOT / "docs" / "guide" / "libraries.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```sh\n(#!/bin/bash\n.*?)```", guide, flags=re.DOTALL)
    (slurm / "job.sh").write_text(block.replace(".venv/bin/activate", "/dev/null"))
    check_run(["bash", "job.sh"], slurm)
