"""Compiles the kernels while the package is built, so that no run waits for it.

`GRASP3D_NO_COMPILE=1 pip install .` leaves that to the first run. All else about the package stands
in pyproject.toml.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

HERE = Path(__file__).resolve().parent

OWN_FOLDER_ALONE = {"NUMBA_CACHE_DIR": "", "XDG_CACHE_HOME": "none: this is no absolute path"}
"""Machine code that this user has compiled before in another folder is not what others need."""


class BuildWithMachineCode(build_py):
    """Copies the modules, and the machine code of the kernels beside them."""

    def run(self) -> None:
        """Compile in this folder, where it is kept for the next build, or else in the copy."""
        super().run()
        if os.environ.get("GRASP3D_NO_COMPILE"):
            return
        copy = HERE if self.editable_mode else Path(self.build_lib).resolve()
        root = HERE if os.access(HERE / "grasp3d" / "_kernels", os.W_OK) else copy
        paths = [str(root), *filter(None, sys.path)]  # what an isolated build has installed
        compiled = subprocess.run(
            [sys.executable, "-m", "grasp3d._kernels.ahead"],
            cwd=root,
            env={**os.environ, **OWN_FOLDER_ALONE, "PYTHONPATH": os.pathsep.join(paths)},
            stdout=subprocess.PIPE,
            text=True,
            check=False,
        )
        if compiled.returncode:
            sys.exit("the kernels were not compiled, see above; GRASP3D_NO_COMPILE=1 omits that")
        folder = Path(compiled.stdout.strip())
        if root != copy:
            shutil.copytree(folder, copy / folder.relative_to(root), dirs_exist_ok=True)


setup(cmdclass={"build_py": BuildWithMachineCode})
