"""The structure of the package: imports point downward, and each engine has modules of its own.

Strings that name a module count too, as do the stubs of public names that packages import lazily.
"""

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import grasp3d

ROOT = Path(grasp3d.__file__).parents[1]

LAYERS = [
    "errors",
    "arrays",
    "system",
    "settings _kernels",
    "contact",
    "quality",
    "stability mesh",
    "hand",
    "surface planar",
    "formats",
    "grasps",
    "describe",
    "pictures",
    "jobs",
    "batch",
    "outcomes viewer datasets",
    "paper",
    "cli",
    "__main__",
]
"""From the lowest to the highest: a module imports from layers below it and from its package.

Within a package no modules import each other in a circle."""

UPWARD = {("grasp3d.surface.labelled_grasps", "grasp3d.viewer.show")}
"""`labels.show()` finds the viewer when it is called, as pandas does with plotting."""

ENGINES = {
    "manifold3d": {"mesh"},
    "clarabel": {"quality.hand_forces"},
    "embreex": {"mesh.surface_points"},
    "numba": {"_kernels"},
    "trimesh": {"mesh", "formats", "hand", "paper", "surface"},
    "mapbox_earcut": {"mesh.mesh_files"},
    "distributed": {"jobs.cluster"},
    "dask": {"jobs.cluster"},
    "upath": {"system.places", "batch"},
    "jinja2": {"batch.report_page"},
    "psutil": {"jobs"},
    "cloudpickle": {"jobs"},
    "pyarrow": {"system.tables", "batch.chunks"},
    "matplotlib": {"outcomes.validation", "paper", "pictures"},
    "pyvista": {"mesh", "surface", "pictures", "viewer"},
    "vtkmodules": {"formats", "pictures", "viewer"},
    "trame": {"viewer"},
    "trame_rca": {"viewer"},
    "aiohttp": {"viewer"},
    "mujoco": {"hand.mujoco_model", "outcomes"},
    "coacd": {"outcomes.simulate"},
    "yaml": {"formats"},
    "h5py": {"formats"},
    "rich": {"cli"},
}

_MODULE = re.compile(r"grasp3d(\.\w+)+")


def name_of(path: Path) -> str:
    """Dotted name of a module, from its file."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@cache
def modules() -> frozenset[str]:
    return frozenset(name_of(path) for path in (ROOT / "grasp3d").rglob("*.py"))


def imported(path: Path) -> Iterator[str]:
    """Full names of what a file imports, or names in a string, and of attributes imported."""
    package = ".".join(path.parent.relative_to(ROOT).parts)
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == (path.suffix == ".pyi"), f"{path}: import by full name"
            start = f"{package}." if node.level else ""
            module = f"{start}{node.module or ''}".rstrip(".")
            yield from (f"{module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Constant) and _MODULE.fullmatch(str(node.value)):
            yield str(node.value)


@cache
def stubs() -> dict[str, str]:
    """Full name of every public name of a package, by the name that it has there."""
    return {
        f"{name_of(path)}.{name.rpartition('.')[2]}": name
        for path in (ROOT / "grasp3d").rglob("__init__.pyi")
        for name in imported(path)
    }


def module_of(name: str) -> str:
    """The module that a name is imported from, also by way of a package's public names."""
    name = stubs().get(name, name)
    while name not in modules():
        name = name.rpartition(".")[0]
    return name


@cache
def imports() -> tuple[tuple[str, str], ...]:
    """Every (module, name imported by it) of the package."""
    files = sorted((ROOT / "grasp3d").rglob("*.py*"))
    return tuple(
        (name_of(path), name)
        for path in files
        if path.suffix in {".py", ".pyi"}
        for name in imported(path)
    )


def inner_imports() -> Iterator[tuple[str, str]]:
    """(module, module) of the imports within the package, but those that UPWARD declares."""
    for module, name in imports():
        if name.split(".")[0] == "grasp3d" and module != "grasp3d":
            pair = module, module_of(name)
            if pair not in UPWARD:
                yield pair


def order_of(layers: list[str]) -> dict[str, int]:
    names = [(name, number) for number, layer in enumerate(layers) for name in layer.split()]
    assert len(dict(names)) == len(names)
    return dict(names)


def test_imports_point_downward_but_those_that_are_declared() -> None:
    inner = [pair for pair in imports() if pair[1].startswith("grasp3d.")]
    assert {(module, module_of(name)) for module, name in inner} >= UPWARD
    order = order_of(LAYERS)
    assert {name.split(".")[1] for name in modules() if "." in name} == set(order)
    for module, target in inner_imports():
        if target != "grasp3d":
            one, other = module.split(".")[1], target.split(".")[1]
            assert one == other or order[other] < order[one], f"{module} imports {target}"


def test_no_modules_import_each_other() -> None:
    graph: dict[str, set[str]] = {}
    for module, target in inner_imports():
        if f"{module}.".startswith(f"{target}."):
            continue  # a package is there before its modules
        graph.setdefault(module, set()).add(target)
    TopologicalSorter(graph).prepare()  # raises CycleError


def test_each_engine_has_modules_of_its_own() -> None:
    allowed_at_all = {f"grasp3d.{name}" for names in ENGINES.values() for name in names}
    assert allowed_at_all <= modules()
    for module, name in imports():
        allowed = ENGINES.get(name.split(".")[0])
        inside = module.removeprefix("grasp3d.")
        if allowed is not None:
            fits = any(f"{inside}.".startswith(f"{engine}.") for engine in allowed)
            assert fits, f"{module} imports {name}"


def loaded_after(code: str) -> set[str]:
    """Modules that a fresh interpreter has loaded after running some code."""
    command = [sys.executable, "-c", f"{code}\nimport sys; print(*sys.modules)"]
    return set(subprocess.run(command, check=True, capture_output=True, text=True).stdout.split())


def test_the_package_and_the_help_load_nothing_heavy() -> None:
    heavy = {"numpy", "pyvista", "dask", "numba", "trimesh", "embreex", "pyarrow", "rich"}
    code = "import grasp3d.cli\ntry: grasp3d.cli.main(['label', '--help'])\nexcept SystemExit: 0"
    for one in ("import grasp3d", code):
        assert not heavy & loaded_after(one)


@pytest.mark.slow
def test_public_names_exist_and_are_documented() -> None:
    code = """
import importlib, inspect, pathlib, grasp3d
root = pathlib.Path(grasp3d.__file__).parent
packages = ["grasp3d", *(f"grasp3d.{p.parent.name}" for p in root.glob("*/__init__.py"))]
for package in map(importlib.import_module, packages):
    for name in getattr(package, "__all__", ()):
        value = getattr(package, name)
        doc = inspect.getdoc(value) or ""
        # What dataclasses write where there is no docstring begins like a call.
        assert name == "__version__" or doc and not doc.startswith(f"{name}("), (package, name)
        assert not inspect.ismodule(value) or name == "planar", (package, name)
        assert name in dir(package), (package, name)
print("checked", len(packages))
"""
    assert "checked" in loaded_after(code)
