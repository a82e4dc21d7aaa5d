"""Kernels are compiled once, before several processes run the tests."""

import os
import subprocess
import sys

import pytest

COMPILE = """
import numpy as np
from grasp3d import EpsilonOptions, GraspModel, Sampling, classify, label_surface, scan_surface
from grasp3d.mesh.primitives import box_mesh
from grasp3d.system.progress import ignore

box = box_mesh((1.0, 0.8, 0.6), max_edge=0.5)
fingers = {fingers}
for method in ("exact", "extremes"):
    model = GraspModel(fingers=fingers, method=method, extreme_normals=3, edges=3)
    label_surface(box, model, sampling=Sampling()).compute_epsilon(ignore)
model = GraspModel(fingers=fingers)
label_surface(box, model).compute_epsilon(ignore)
scan_surface(box, fixed=box.vertices[: fingers - 1]).compute_epsilon(ignore)
"""
"""What most tests need, for a number of fingers."""


def pytest_configure(config: pytest.Config) -> None:
    """Compile what most tests need, two and three fingers in a process each.

    Otherwise every worker, and every command that a test starts, would compile the same kernels.
    """
    if hasattr(config, "workerinput") or not config.getoption("numprocesses", None):
        return
    from grasp3d._kernels.compiling import compiled_before

    if not compiled_before() and not os.environ.get("NUMBA_DISABLE_JIT"):
        codes = (COMPILE.format(fingers=fingers) for fingers in (2, 3))
        processes = [subprocess.Popen([sys.executable, "-c", code]) for code in codes]
        failed = [process.wait() for process in processes]
        if any(failed):
            raise pytest.UsageError("the kernels could not be compiled, see above")
