import ast
import re
import subprocess
import sys
from pathlib import Path

import grasp3d

PACKAGE = Path(grasp3d.__file__).parent

# From the basement to the roof; a floor imports from floors below it and from itself.
FLOORS = [
    {"errors", "arrays", "processors", "progress", "versions"},
    {"settings", "files", "names", "isolation"},
    {"_kernels", "sensor", "tables", "stability", "costs", "reading"},
    {"contacts", "cones", "storage"},
    {"wrenches"},
    {"solving"},
    {"quality"},
    {"critical"},
    {"distributions", "extremes", "creases"},
    {"enumeration"},
    {"tilting", "sampled_angles"},
    {"verdicts", "planar"},
    {"classification"},
    {"mesh"},
    {"rays", "surface_contacts", "surface_shares"},
    {"crease_angles", "sampling", "surface_extremes", "surface_crossings"},
    {"diagnosis"},
    {"surface_epsilons"},
    {"vertex_grasps", "label_table"},
    {"labels"},
    {"vertex_search"},
    {"surface", "grasps"},
    {"sweeps"},
    {"export", "rendering"},
    {"plots"},
    {"paper"},
    {"batch"},
    {"viewer"},
    {"cli"},
]
VIEWER = [
    {"settings"},
    {"subjects"},
    {"session"},
    {"scene"},
    {"window", "web"},
    {"showing"},
]
"""The floors of the viewer: what is chosen and drawn knows no window."""

ENGINES = {
    "manifold3d": {"mesh"},
    "embreex": {"rays"},
    "numba": {"_kernels"},
    "trimesh": {"mesh", "export", "reading"},
    "distributed": {"batch"},
    "dask": {"batch"},
    "fsspec": {"storage"},
    "psutil": {"isolation"},
    "cloudpickle": {"isolation"},
    "pyarrow": {"tables"},
    "matplotlib": {"plots", "viewer"},
    "pyvista": {"export", "rendering", "viewer"},
    "vtkmodules": {"export", "viewer"},
    "trame": {"viewer"},
    "trame_rca": {"viewer"},
    "imageio_ffmpeg": {"viewer"},
    "aiohttp": {"viewer"},
    "rich": {"cli"},
    "tyro": {"cli"},
}


def imports() -> list[tuple[str, str]]:
    """Every (room, imported module) of the package."""
    found = []
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(PACKAGE).with_suffix("").parts
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                found += [(parts[0], alias.name) for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                assert node.level == 0, f"{path}: import by full name"
                names = [node.module or ""]
                if node.module == "grasp3d":
                    names = [f"grasp3d.{alias.name}" for alias in node.names]
                found += [(parts[0], name) for name in names]
    return found


def test_every_room_stands_on_one_floor() -> None:
    rooms = {p.stem for p in PACKAGE.iterdir() if p.suffix == ".py" or (p / "__init__.py").exists()}
    assert rooms - {"__init__"} == set().union(*FLOORS)
    assert sum(len(floor) for floor in FLOORS) == len(set().union(*FLOORS))


def test_imports_point_downward() -> None:
    floor_of = {room: number for number, floor in enumerate(FLOORS) for room in floor}
    for room, module in imports():
        if room == "__init__" or not module.startswith("grasp3d."):
            continue
        target = module.split(".")[1]
        assert target == room or floor_of[target] < floor_of[room], f"{room} imports {module}"


def test_the_viewer_has_floors_of_its_own() -> None:
    floor_of = {room: number for number, floor in enumerate(VIEWER) for room in floor}
    viewer = PACKAGE / "viewer"
    rooms = {p.stem for p in viewer.iterdir() if p.suffix == ".py" or (p / "__init__.py").exists()}
    assert rooms - {"__init__"} == set(floor_of)
    for path in viewer.rglob("*.py"):
        room = path.relative_to(viewer).with_suffix("").parts[0]
        for target in re.findall(r"from grasp3d\.viewer\.(\w+)", path.read_text(encoding="utf-8")):
            assert target == room or floor_of[target] < floor_of[room], f"{path} imports {target}"


def test_each_engine_has_its_own_rooms() -> None:
    for room, module in imports():
        allowed = ENGINES.get(module.split(".")[0])
        assert allowed is None or room in allowed, f"{room} imports {module}"


def test_importing_the_package_loads_nothing_heavy() -> None:
    code = "import grasp3d, sys; print(*sys.modules)"
    loaded = subprocess.run(
        [sys.executable, "-c", code], check=True, capture_output=True, text=True
    ).stdout.split()
    assert not {"pyvista", "dask", "numba", "trimesh", "embreex", "pyarrow"} & set(loaded)


def test_help_of_the_command_line_loads_nothing_heavy() -> None:
    code = (
        "import sys, grasp3d.cli\n"
        "try: grasp3d.cli.main(['label', '--help'])\n"
        "except SystemExit: print(*sys.modules)"
    )
    loaded = subprocess.run(
        [sys.executable, "-c", code], check=True, capture_output=True, text=True
    ).stdout.split()
    assert not {"numpy", "pyvista", "dask", "numba", "trimesh", "rich"} & set(loaded)


def test_public_names_exist_and_are_listed() -> None:
    assert sorted(grasp3d.__all__) == sorted(set(dir(grasp3d)))
    for name in grasp3d.__all__:
        assert getattr(grasp3d, name).__doc__
