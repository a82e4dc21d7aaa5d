"""The structure of the package: imports point downward, and each engine has modules of its own.

Imports by name count too: strings that name a module, as for `import_module`, and the stubs of
public names that packages import from when they are asked.
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
    "errors arrays",
    "lengths quantities",
    "uncertainty",
    "settings system _kernels contact isolation",
    "quality reading tables costs rendering",
    "loads meanings model_text",
    "stability mesh storage",
    "gripper",
    "surface planar diagnosis sweeps",
    "grasps conversions",
    "export perturbing stored_settings validating",
    "warming_up",
    "plots batch",
    "paper physics viewer",
    "cli",
]
"""From the lowest to the highest: a module imports from layers below it and from its package."""

WITHIN = {
    "batch": [
        "batch_settings folders job_requests row sweep_grasps",
        "worker_task",
        "cluster_client identity inputs journal packed_rows report summary",
        (
            "attempts checking cluster compiling_first local_client marker plan progress shards "
            "stored_names sweeping"
        ),
        "check_writing labelling run store",
        "library",
    ],
    "cli": [
        "load_report uncertainty_report",
        (
            "compiling_lines design_report examples existing_files gripper_report options ranges "
            "report streams"
        ),
        "design_options",
        "budget_report design_object",
        (
            "batch_progress batch_report check_report design grasp_report metric_report "
            "paper_report perturb_report simulate_report sweep_report time_limit"
        ),
        "pose_report validate_report",
        "batch check evaluate gripper label paper perturb simulate sweep validate view warmup",
    ],
    "diagnosis": [
        "mesh_diagnosis",
        "mesh_warnings",
        "diagnosing",
    ],
    "grasps": [
        "holding_verdict jaw_contacts kinds pose_checks pose_readings reading",
        "poses",
        "evaluated_poses pose_files",
        "pose_evaluation",
        "closed_grasps",
        "surface_grasps",
        "alternatives distinct evaluation surface_poses",
        "verdict writing",
    ],
    "gripper": [
        "convex_polygons finger_faces",
        "finger_hull parallel_gripper",
        "inner_side",
        "hand_geometry jaw_shape presets reach_settings",
        "approach link_tree table",
        "mjcf reaching scene shapes urdf",
        "closed_jaws collisions gripper_files reach",
        "closing",
    ],
    "isolation": [
        "failures limits machine_memory pickling process process_tree",
        "monitoring",
        "calls",
        "child",
    ],
    "mesh": [
        "manifolds measures noise_fields normals ray_tracing units work_bounds",
        "noise refinement repair self_intersections",
        "object_mesh patches",
        "masses mesh_sources plausible_lengths surface_points",
        "preparing",
        "noisy_copies primitives",
        "noise_lengths",
    ],
    "perturbing": [
        "advice copies noise_settings",
        "perturbation",
        "perturb writing",
    ],
    "paper": [
        "markdown paper_settings true_grasps",
        "convergence extensions objects quoted",
        "errors figures surfaces",
        "numbers",
        "writing",
    ],
    "physics": [
        "engine simulation_settings success",
        "hand parts",
        "drawing plates scene",
        "facets holding_forces pulling",
        "jobs table_columns",
        "simulation",
        "simulate writing",
        "posed",
    ],
    "planar": [
        "contacts polygons",
        "hulls located outlines",
        "circles fractions",
        "planar_scan polylines",
        "scanning",
    ],
    "plots": [
        "painting style views",
        (
            "budgets cones curves disagreements formats fractions gripper_shapes grippers grasps "
            "perturbations validations"
        ),
        "combinations error_fractions fraction_figures heat_maps html_parts tips",
        "surfaces validation_page",
    ],
    "quality": [
        "over_friction patch_lines tasks unreachable_wrenches wrench_files wrenches",
        "epsilon_options task_texts",
        "wrench_problem",
        "certificates",
        "closure critical_angle ferrari_canny opposed_fingers",
        "force_problem",
        "hardest_wrenches location_tolerance tilting",
        "grip_forces uncertain_epsilon",
        "force_options measures",
        "sampled_tilts",
        "force_ranges",
        "payloads",
    ],
    "reading": [
        "sources",
        "declared_sizes gltf_data gltf_transforms isolation obj scenes side_files stl three_mf",
        "archives gltf_tree off ply",
        "gltf",
        "ply_faces",
        "parsing",
        "child mesh_files",
    ],
    "stability": [
        "budgets extreme_normals label normal_sets round_shapes",
        "enumeration located_angles thresholds",
        "angle_distributions sampled_normals",
        "exact",
        "stability",
        "classification",
    ],
    "storage": [
        "addresses",
        "copies listing",
        "folder",
    ],
    "surface": [
        "area_statistics contacts deferred label_table load_case",
        "holding located_angles",
        "critical_angles extreme_normals labelled_grasps sampling vertex_grasps",
        "epsilon merged_grasps",
        "grasp_forces grasp_metrics vertex_hulls",
        "labels",
        "held_area scanning search",
        "labelling",
    ],
    "sweeps": [
        "axes",
        "sweep_result",
        "sweeping writing",
    ],
    "validating": [
        "hints intervals mesh_lookup ranking scores stated_object validation_settings",
        "calibration disagreements label_success tried_grasps",
        "validation",
        "evaluating sentences",
        "comparison writing",
        "validate",
    ],
    "viewer": [
        "subjects view_settings",
        "session",
        "scene",
        "web window",
        "show",
    ],
}
"""The layers within the packages that have several; kernels call each other freely."""

UPWARD = {
    ("grasp3d.grasps.surface_grasps", "grasp3d.grasps.writing"),
    ("grasp3d.grasps.surface_grasps", "grasp3d.viewer.show"),
    ("grasp3d.gripper.parallel_gripper", "grasp3d.gripper.gripper_files"),
    ("grasp3d.gripper.parallel_gripper", "grasp3d.gripper.presets"),
    ("grasp3d.mesh.object_mesh", "grasp3d.conversions"),
    ("grasp3d.mesh.object_mesh", "grasp3d.viewer.show"),
    ("grasp3d.surface.labels", "grasp3d.conversions"),
    ("grasp3d.surface.labels", "grasp3d.viewer.show"),
    ("grasp3d.isolation.calls", "grasp3d.isolation.child"),
    ("grasp3d.reading.isolation", "grasp3d.reading.child"),
}
"""`labels.show()`, `labels.to_table()` and the like find the viewer and other libraries when they
are called, as pandas does with plotting; a child process is started by the name of its module."""

ENGINES = {
    "manifold3d": {"mesh"},
    "embreex": {"mesh.ray_tracing"},
    "numba": {"_kernels"},
    "trimesh": {"mesh", "conversions", "export", "gripper", "reading"},
    "distributed": {"batch"},
    "dask": {"batch"},
    "fsspec": {"storage"},
    "psutil": {"isolation"},
    "cloudpickle": {"isolation"},
    "pyarrow": {"tables"},
    "matplotlib": {"plots", "viewer"},
    "pyvista": {"conversions", "plots.gripper_shapes", "stored_settings", "rendering", "viewer"},
    "vtkmodules": {"export", "viewer"},
    "trame": {"viewer"},
    "trame_rca": {"viewer"},
    "imageio_ffmpeg": {"viewer"},
    "aiohttp": {"viewer"},
    "yourdfpy": {"gripper.urdf"},
    "mujoco": {"gripper.mjcf", "physics.engine"},
    "coacd": {"physics.parts"},
    "yaml": {"grasps.pose_files"},
    "h5py": {"grasps.pose_files"},
    "rich": {"cli"},
    "tyro": {"cli"},
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


def children(package: str) -> set[str]:
    """Modules and packages directly in a package."""
    depth = package.count(".") + 1
    names = (name.split(".") for name in modules() if name.startswith(f"{package}."))
    return {parts[depth] for parts in names}


@pytest.mark.slow
@pytest.mark.parametrize("package", ["", *WITHIN])
def test_imports_point_downward(package: str) -> None:
    order = order_of(WITHIN[package] if package else LAYERS)
    full = ".".join(filter(None, ("grasp3d", package)))
    assert children(full) == set(order)
    depth = full.count(".") + 1
    for module, target in inner_imports():
        if module.startswith(f"{full}.") and target.startswith(f"{full}."):
            one, other = module.split(".")[depth], target.split(".")[depth]
            assert one == other or order[other] < order[one], f"{module} imports {target}"


def test_no_modules_import_each_other() -> None:
    graph: dict[str, set[str]] = {}
    for module, target in inner_imports():
        if f"{module}.".startswith(f"{target}."):
            continue  # a package is there before its modules
        graph.setdefault(module, set()).add(target)
    TopologicalSorter(graph).prepare()  # raises CycleError


def test_what_may_point_upward_still_does() -> None:
    found = {(module, module_of(name)) for module, name in imports() if name.startswith("grasp3d.")}
    assert found >= UPWARD


def test_each_engine_has_modules_of_its_own() -> None:
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


def test_importing_the_package_loads_nothing_heavy() -> None:
    heavy = {"numpy", "pyvista", "dask", "numba", "trimesh", "embreex", "pyarrow"}
    assert not heavy & loaded_after("import grasp3d")


def test_help_of_the_command_line_loads_nothing_heavy() -> None:
    code = "import grasp3d.cli\ntry: grasp3d.cli.main(['label', '--help'])\nexcept SystemExit: 0"
    assert not {"numpy", "pyvista", "dask", "numba", "trimesh", "rich"} & loaded_after(code)


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


def test_few_names_are_at_the_top() -> None:
    """Those of everyday use: 40, and what came with forces, outcomes of grasps and physics."""
    assert len(grasp3d.__all__) <= 44
    assert re.fullmatch(r"\d+\.\d+.*", grasp3d.__version__)
