"""Kernels are compiled ahead: all that Python calls, with the types with which it calls them."""

import ast
import importlib
import inspect
import os
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from numba.core.dispatcher import Dispatcher

import grasp3d
from grasp3d._kernels import ahead
from grasp3d._kernels.ahead import kernels, warmup
from grasp3d._kernels.compiling import code_folders, name_of
from grasp3d.errors import OutputError

PACKAGE = Path(grasp3d.__file__).parent
KERNELS = "grasp3d._kernels"

jitted = pytest.mark.skipif(bool(os.environ.get("NUMBA_DISABLE_JIT")), reason="nothing is compiled")


def names_of_kernels(source: Path) -> Iterator[tuple[str, str]]:
    """(module, name) of everything that a file takes from modules of kernels."""
    tree = ast.parse(source.read_text(encoding="utf-8"))
    modules = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(KERNELS):
            for name in node.names:
                yield str(node.module), name.name
                modules[name.asname or name.name] = f"{node.module}.{name.name}"
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            yield modules.get(node.value.id, ""), node.attr


def called_kernels() -> Iterator[Any]:
    for source in PACKAGE.rglob("*.py"):
        if "_kernels" in source.parts:
            continue
        for module, name in names_of_kernels(source):
            try:
                found = getattr(importlib.import_module(module), name, None)
            except (ImportError, ValueError):  # a name that is no module
                continue
            if isinstance(found, Dispatcher):
                yield found


@pytest.mark.slow
@jitted
def test_every_kernel_that_python_calls_is_compiled_ahead() -> None:
    called = {name_of(kernel) for kernel in called_kernels()}
    assert "wrench_problem.epsilons" in called
    assert called == kernels().keys()


@jitted
def test_each_argument_has_a_type() -> None:
    for kernel, ways in kernels().values():
        count = len(inspect.signature(kernel.py_func).parameters)
        assert {len(way) for way in ways} == {count}, kernel


@jitted
def test_what_is_compiled_is_not_compiled_again(monkeypatch: pytest.MonkeyPatch) -> None:
    warmup()
    monkeypatch.setattr(subprocess, "Popen", None)
    warmup()


@pytest.fixture
def copied(tmp_path: Path) -> Path:
    """A copy of what compiles the kernels, with machine code for all but one of them."""
    warmup()
    for part in ("_kernels", "system"):
        shutil.copytree(PACKAGE / part, tmp_path / "grasp3d" / part)
    for source in PACKAGE.glob("*.py*"):
        shutil.copy2(source, tmp_path / "grasp3d")
    folder = tmp_path / code_folders()[0].relative_to(PACKAGE.parent)
    for file in folder.glob("pair_angles.scan-*"):
        file.unlink()
    return tmp_path


def build(folder: Path) -> subprocess.CompletedProcess[str]:
    """Compile as a build does, with an empty folder for the user."""
    return subprocess.run(
        [sys.executable, "-m", ahead.__name__],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(folder), "XDG_CACHE_HOME": str(folder / "user")},
        capture_output=True,
        text=True,
        check=False,
    )


@jitted
@pytest.mark.slow
def test_what_is_missing_is_compiled_beside_the_rest(copied: Path) -> None:
    done = build(copied)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("compiling") == 1
    folder = Path(done.stdout.strip())
    assert folder.is_relative_to(copied)
    names = Counter(path.name.partition("-")[0] for path in folder.iterdir())
    for name, (_, ways) in kernels().items():  # some are called by others too
        assert names[name] >= len(ways)
    assert not (copied / "user").exists()
    again = build(copied)
    assert (again.stdout, again.stderr) == (done.stdout, "")


@jitted
def test_a_process_that_ends_early_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ahead, "is_compiled", lambda *_: False)
    monkeypatch.setattr(sys, "executable", shutil.which("false"))
    with pytest.raises(OutputError, match=r"kernels were not compiled: see the lines above"):
        warmup()
