"""Compare the labels of meshes, and the time that they take, between two checkouts.

Each mesh is labelled by each checkout in a process of its own, the two in turn, one thread, after a
first labelling that compiles. The table has a row per mesh: vertices; those whose critical angle,
over the worst normals and then over the best ones, is the same within 1e-6 rad, better or worse,
and the largest increase; labels that differ, as before>after; CPU seconds of both. Angles beyond
the half-angle of the search cone count as that: there no label depends on them.

    python scripts/compare_labels.py BEFORE AFTER [MESH ...] [--json FILE]
"""

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

SHIPPED = Path(__file__).parents[1] / "meshes"
SUFFIXES = {".glb", ".obj", ".off", ".ply", ".stl"}
FRICTION, RESOLUTION = 0.5, math.radians(22.6)
SAME = 1e-6
REPEATS = 3


def label(path: Path, output: Path) -> None:
    """Label one mesh in this process; write angles, labels, and the least time of some runs."""
    from grasp3d import GraspModel, label_surface, load_mesh

    model = GraspModel(friction=FRICTION, sensor_resolution=RESOLUTION)
    mesh, seconds = load_mesh(path), math.inf
    for _ in range(REPEATS):
        start = time.process_time()
        labels = label_surface(mesh, model)
        seconds = min(seconds, time.process_time() - start)
    np.savez(
        output, worst=labels.critical_angle, best=labels.critical_angle_best, label=labels.label,
        seconds=seconds, cone=labels.search.cone,
    )  # fmt: skip


def labels_of(checkout: Path, mesh: Path, folder: Path) -> dict[str, np.ndarray]:
    """Labels of a mesh by the package in a folder, in a process of its own."""
    output = folder / "labels.npz"
    environment = {**os.environ, "PYTHONPATH": str(checkout)}
    command = [sys.executable, __file__, "--one", str(mesh), str(output)]
    subprocess.run(command, check=True, env=environment, stdout=subprocess.DEVNULL)  # noqa: S603
    with np.load(output) as arrays:
        return dict(arrays)


def differences(before: np.ndarray, after: np.ndarray, cone: float) -> dict[str, float]:
    """Vertices with the same, a better and a worse angle, and the largest increase."""
    # nan where a vertex is not on the surface
    change = np.nan_to_num(np.minimum(after, cone) - np.minimum(before, cone))
    return {
        "same": int(np.sum(np.abs(change) <= SAME)),
        "better": int(np.sum(change < -SAME)),
        "worse": int(np.sum(change > SAME)),
        "loss": float(change.max(initial=0.0)),
    }


def compared(before: dict[str, np.ndarray], after: dict[str, np.ndarray]) -> dict[str, object]:
    """The row of a mesh."""
    cone = float(before["cone"])
    if len(before["worst"]) != len(after["worst"]):
        sys.exit("the checkouts prepare the mesh differently: they have different vertices")
    pairs = zip(before["label"].tolist(), after["label"].tolist(), strict=True)
    changes = Counter(f"{'UMS'[a]}>{'UMS'[b]}" for a, b in pairs if a != b)
    return {
        "vertices": len(before["worst"]),
        **{kind: differences(before[kind], after[kind], cone) for kind in ("worst", "best")},
        "labels": dict(sorted(changes.items())),
        "seconds": [float(before["seconds"]), float(after["seconds"])],
    }


def add_row(table: Table, name: str, row: dict) -> None:
    """Add the row of a mesh."""
    cells = []
    for kind in ("worst", "best"):
        one = row[kind]
        cells += [str(one["same"]), str(one["better"]), str(one["worse"]), f"{one['loss']:.1e}"]
    changes = " ".join(f"{key} {number}" for key, number in row["labels"].items()) or "none"
    one, other = row["seconds"]
    table.add_row(
        name, str(row["vertices"]), *cells, changes, f"{one:.3f}", f"{other:.3f}",
        f"{one / other:.2f}",
    )  # fmt: skip


def main() -> None:
    """Label every mesh with both checkouts and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("before", type=Path)
    parser.add_argument("after", type=Path)
    parser.add_argument("meshes", nargs="*", type=Path)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    shipped = sorted(path for path in SHIPPED.iterdir() if path.suffix in SUFFIXES)
    headings = ["same", "better", "worse", "loss"]
    table = Table(
        "mesh", "vertices", *headings, *headings, "labels", "before s", "after s", "ratio"
    )
    rows = {}
    with tempfile.TemporaryDirectory() as folder:
        for mesh in options.meshes or shipped:
            checkouts = options.before.resolve(), options.after.resolve()
            both = [labels_of(checkout, mesh.resolve(), Path(folder)) for checkout in checkouts]
            rows[str(mesh)] = compared(*both)
            add_row(table, mesh.name, rows[str(mesh)])
    Console(width=180).print(table)
    total = np.sum([row["seconds"] for row in rows.values()], axis=0)
    changes = sum((Counter(row["labels"]) for row in rows.values()), Counter())
    vertices = sum(row["vertices"] for row in rows.values())
    losses = [max(row[kind]["loss"] for row in rows.values()) for kind in ("worst", "best")]
    Console().print(f"{vertices:,} vertices; labels {dict(changes) or 'the same'}; largest losses "
                    f"{losses[0]:.1e} and {losses[1]:.1e}")  # fmt: skip
    Console().print(f"{total[0]:.2f} s before, {total[1]:.2f} s after: {total[0] / total[1]:.2f}")
    if options.json:
        options.json.write_text(json.dumps(rows, indent=2) + "\n")


if __name__ == "__main__":
    if len(sys.argv) == 4 and sys.argv[1] == "--one":
        label(Path(sys.argv[2]), Path(sys.argv[3]))
    else:
        main()
