"""Compare what two checkouts write for the same meshes, array by array, bit for bit.

`run` labels meshes with the command line of a checkout, as far as both checkouts share it: two and
three fingers, exact labels and those at extreme normals, and a gripper with a table and a mass,
each with its best grasps. A Python program makes scans, which the command line lacks. `compare`
reads both folders and prints a row per setting, with the numbers of meshes, of arrays equal in
every bit, and of those that differ, were dropped or were added; then it prints the differences.

    python scripts/compare_outputs.py run CHECKOUT FOLDER [MESH ...] [--only SETTING ...]
    python scripts/compare_outputs.py compare BEFORE AFTER
"""

import argparse
import json
import os
import subprocess
import sys
from collections import Counter, defaultdict
from pathlib import Path

import numpy as np
import numpy.typing as npt
from rich.console import Console
from rich.table import Table

SHIPPED = Path(__file__).parents[1] / "meshes"
SUFFIXES = {".glb", ".obj", ".off", ".ply", ".stl"}
SETTINGS: dict[str, list[str]] = {
    f"{fingers} fingers, {method}": ["--fingers", str(fingers), "--method", method]
    for fingers in (2, 3)
    for method in ("exact", "extremes")
} | {
    "franka, table, mass": ["--hand", "franka", "--mass", "0.2kg", "--table", "as-is"],
    "location error": ["--location-error", "1mm", "--friction", "0.4..0.6"],
}
"""Arguments of the command line, by name of the setting."""

PROGRAMS = {
    "scan": "labels = grasp3d.scan_surface(mesh, fixed=mesh.vertices[:1])",
}
"""Programs that make `labels` of `mesh`, by name of the setting."""

UNIT = ("--unit", "m")
"""Arguments for meshes that state no unit; the others state metres themselves."""

FORMATS = ("npz", "ply", "vtp", "parquet")
IN_EVERY_FORMAT = {"box", "mug", "wrench"}
"""Meshes written in all formats, except at extreme normals; the others are written as NPZ."""

Arrays = dict[str, npt.NDArray[np.generic]]


def run(checkout: Path, folder: Path, meshes: list[Path], only: list[str]) -> None:
    """Label the meshes with the package in a checkout."""
    environment = {**os.environ, "PYTHONPATH": str(checkout)}
    start = "import sys; from grasp3d.cli import main; sys.exit(main())"
    for name in only or [*SETTINGS, *PROGRAMS]:
        for mesh in meshes:
            target = folder / name.replace(", ", "-").replace(" ", "_")
            target.mkdir(parents=True, exist_ok=True)
            if name in PROGRAMS:
                program = (
                    f"import grasp3d, sys; mesh = grasp3d.load_mesh(sys.argv[1], unit='m'); "
                    f"{PROGRAMS[name]}; grasp3d.write_npz(sys.argv[2], labels)"
                )
                words = [str(mesh), str(target / f"{mesh.stem}.npz")]
                command = [sys.executable, "-P", "-c", program, *words]
                subprocess.run(command, check=True, env=environment)  # noqa: S603
                continue
            every = mesh.stem in IN_EVERY_FORMAT and "extremes" not in name
            for suffix in FORMATS if every else FORMATS[:1]:
                words = [
                    "label", str(mesh), *SETTINGS[name], *UNIT, "--overwrite", "--quiet",
                    "--output", str(target / f"{mesh.stem}.{suffix}"),
                ]  # fmt: skip
                if suffix == "npz":
                    words += ["--best", "10", "--grasps", str(target / f"{mesh.stem}.json")]
                command = [sys.executable, "-P", "-c", start, *words]  # not from this folder
                subprocess.run(command, check=True, env=environment)  # noqa: S603


def arrays_of(path: Path) -> Arrays:
    """Return all arrays and settings in a written file, by name."""
    read = {".npz": _npz, ".ply": _ply, ".vtp": _vtp, ".parquet": _parquet, ".json": _json}
    return read[path.suffix](path)


def _npz(path: Path) -> Arrays:
    with np.load(path) as arrays:
        return dict(arrays)


def _ply(path: Path) -> Arrays:
    from plyfile import PlyData

    data = PlyData.read(path)
    vertex, face = data["vertex"], data["face"]
    found = {entry.name: np.asarray(vertex[entry.name]) for entry in vertex.properties}
    found["faces"] = np.vstack(face["vertex_indices"])
    comments = "\n".join(data.comments).replace("\ngrasp3d+ ", "").splitlines()
    settings = (line.removeprefix("grasp3d ").partition(" ") for line in comments)
    return found | {f"setting_{key}": np.array(value) for key, _, value in settings}


def _vtp(path: Path) -> Arrays:
    import pyvista

    data = pyvista.read(path)
    found = {name: np.asarray(data.point_data[name]) for name in data.point_data.keys()}  # noqa: SIM118
    fields = {name: np.asarray(data.field_data[name]) for name in data.field_data.keys()}  # noqa: SIM118
    return found | fields | {"points": np.asarray(data.points), "faces": data.regular_faces}


def _parquet(path: Path) -> Arrays:
    import pyarrow.parquet as pq

    table = pq.read_table(path)
    found = {name: table[name].to_numpy() for name in table.column_names}
    settings = json.loads((table.schema.metadata or {}).get(b"grasp3d", b"{}"))
    return {name: v.astype(str) if v.dtype.kind == "O" else v for name, v in found.items()} | {
        f"setting_{key}": np.array(str(value)) for key, value in settings.items()
    }


def _json(path: Path) -> Arrays:
    found: Arrays = {}
    for row, grasp in enumerate(json.loads(path.read_text(encoding="utf-8"))["grasps"]):
        for name, value in grasp.items():
            found[f"{row} {name}"] = np.array(json.dumps(value))
    return found


def same(before: npt.NDArray[np.generic], after: npt.NDArray[np.generic]) -> bool:
    """Whether two arrays are equal in type, shape and every bit."""
    return (
        before.dtype == after.dtype
        and before.shape == after.shape
        and before.tobytes() == after.tobytes()
    )


def widened(before: npt.NDArray[np.generic], after: npt.NDArray[np.generic]) -> bool:
    """Whether 32-bit numbers now have 64 bits and still round to the same."""
    return (
        before.dtype == np.float32
        and after.dtype == np.float64
        and np.array_equal(before, after.astype(np.float32), equal_nan=True)
    )


COUNTED = ("files", "equal arrays", "widened", "differ", "dropped", "added")


def compare(before: Path, after: Path) -> int:
    """Print the comparison of two folders; 1 if a common array differs or a file is missing."""
    counts: dict[tuple[str, str], Counter[str]] = defaultdict(Counter)
    notes: dict[str, list[str]] = defaultdict(list)
    for path in sorted(one for one in before.rglob("*.*") if one.suffix != ".png"):
        key, other = (path.parent.name, path.suffix), after / path.relative_to(before)
        if not other.exists():
            notes[f"{' '.join(key)} missing"].append(path.stem)
            continue
        counts[key]["files"] += 1
        for name, found in differences(arrays_of(path), arrays_of(other)).items():
            counts[key][found] += 1
            if found != "equal arrays":
                notes[f"{' '.join(key)} {name}: {found}"].append(path.stem)
    table = Table("setting", "format", *COUNTED)
    for key, row in counts.items():
        table.add_row(*key, *(str(row[column]) for column in COUNTED))
    console = Console(width=120)
    console.print(table)
    for note, meshes in sorted(notes.items()):
        console.print(f"{note}: {len(meshes)} ({', '.join(meshes[:3])})", highlight=False)
    wrong = any(row["differ"] for row in counts.values())
    return int(wrong or any(note.endswith("missing") for note in notes))


def differences(before: Arrays, after: Arrays) -> dict[str, str]:
    """Classify each array by name as one of `COUNTED`."""
    common = before.keys() & after.keys()
    return (
        dict.fromkeys(before.keys() - common, "dropped")
        | dict.fromkeys(after.keys() - common, "added")
        | {name: _change(before[name], after[name]) for name in common}
    )


def _change(before: npt.NDArray[np.generic], after: npt.NDArray[np.generic]) -> str:
    if same(before, after):
        return "equal arrays"
    return "widened" if widened(before, after) else "differ"


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    commands = parser.add_subparsers(dest="command", required=True)
    running = commands.add_parser("run")
    running.add_argument("checkout", type=Path)
    running.add_argument("folder", type=Path)
    running.add_argument("meshes", type=Path, nargs="*")
    running.add_argument("--only", nargs="+", choices=[*SETTINGS, *PROGRAMS], default=[])
    comparing = commands.add_parser("compare")
    comparing.add_argument("before", type=Path)
    comparing.add_argument("after", type=Path)
    options = parser.parse_args()
    if options.command == "compare":
        return compare(options.before, options.after)
    meshes = options.meshes or sorted(p for p in SHIPPED.iterdir() if p.suffix in SUFFIXES)
    run(options.checkout.resolve(), options.folder, meshes, options.only)
    return 0


if __name__ == "__main__":
    sys.exit(main())
