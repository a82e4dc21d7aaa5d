"""Compare labels of the paper's sampled method with exact ones, on random grasps and surfaces.

python scripts/compare_extremes.py
"""

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from grasp3d.arrays import Bools, Ints, locked
from grasp3d.mesh.primitives import box_mesh, cylinder_mesh, sphere_mesh
from grasp3d.paper.markdown import fraction_cells, resolution_cell, table
from grasp3d.paper.paper_settings import PaperSettings
from grasp3d.quality.wrenches import EpsilonOptions
from grasp3d.settings import DEGREE, GraspModel
from grasp3d.stability.classification import classify
from grasp3d.stability.label import Label
from grasp3d.surface.labelling import label_surface
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.scanning import scan_surface
from grasp3d.system.context import report_progress, unreported
from tests.helpers.random_grasps import SEED, random_grasps

SAMPLES = {2: (2000, (4, 8, 16, 32)), 3: (500, (4, 8, 16)), 4: (200, (4, 8))}
"""For each number of fingers: the number of grasps, and numbers of extreme normals to compare."""

ALLOWED = {
    "circular": ((Label.M, Label.S), (Label.M, Label.U)),
    "polygonal": (
        (Label.M, Label.S),
        (Label.M, Label.U),
        (Label.S, Label.M),
        (Label.S, Label.U),
    ),
}
"""Disagreements (exact, sampled) that an untested tilt, or a polygon inside its cone, explains."""


INTRODUCTION = """Random grasps, labelled by the paper's method (a few extreme normals of maximal
tilt and the perceived one, every combination over the fingers) and exactly. 'Not allowed' counts
disagreements that an untested tilt, or a polygon inside its cone, cannot explain. 'M taken for
sure' is the fraction of the exact M that sampled normals label S or U: their over-confidence."""

BELOW = (0.0, 0.0, -1.0)
"""Contact point of the first finger in scans."""
EDGE = 1.0 / 8.0
"""Longest edge of the box, whose sides are 2; twice that on the cylinder."""
SUBDIVISIONS = 4
"""Subdivisions of the sphere: 2,562 vertices."""
EDGES = (None, 8)
ROUNDED = 1e-9
"""Distance of a critical angle from a threshold that rounding errors explain [rad]."""
SEARCHED = GraspModel(friction=0.2, sensor_resolution=15.0 * DEGREE)
"""Model for searched grasps: low friction, so that not all vertices are S."""


@dataclass(frozen=True, eq=False)
class Comparison:
    """Labels of one sampled method against the exact ones."""

    fingers: int
    grasps: int
    extreme_normals: int
    """Extreme normals of each contact; the perceived one is added."""
    edges: int | None
    """Edges of the friction cones; None: circular cones."""
    counts: Ints
    """Grasps by exact label (rows) and sampled label (columns), in the order of `Label`, (3, 3)."""
    hulls: int
    """Number of wrench hulls computed."""

    @property
    def disagreement(self) -> float:
        """Fraction of the grasps whose labels differ."""
        return 1.0 - float(np.trace(self.counts)) / self.grasps

    @property
    def error(self) -> float:
        """Standard error of that fraction."""
        return math.sqrt(self.disagreement * (1.0 - self.disagreement) / self.grasps)

    @property
    def overconfident(self) -> float:
        """Fraction of the exact M that are labelled S or U."""
        ambiguous = self.counts[Label.M]
        return float(ambiguous.sum() - ambiguous[Label.M]) / max(int(ambiguous.sum()), 1)

    @property
    def not_allowed(self) -> int:
        """Disagreements that neither an untested tilt nor an inscribed polygon explains."""
        allowed = ALLOWED["circular" if self.edges is None else "polygonal"]
        wrong = self.counts.sum() - np.trace(self.counts)
        return int(wrong - sum(self.counts[exact, sampled] for exact, sampled in allowed))


def compare(
    fingers: int, grasps: int, extreme_normals: int, *, edges: int | None = None, seed: int = SEED
) -> Comparison:
    """Label random grasps exactly and with sampled normals.

    Args:
        fingers: Contacts of each grasp.
        grasps: Number of grasps.
        extreme_normals: Extreme normals of each contact.
        edges: Edges of the friction cones of the sampled method; None: circular cones.
        seed: Seed of the grasps.
    """
    contacts, resolution = random_grasps(fingers, grasps, seed)
    exact = classify(contacts, resolution)
    options = EpsilonOptions(edges=edges)
    sampled = classify(
        contacts, resolution, method="extremes", extreme_normals=extreme_normals, options=options
    )
    counts = np.zeros((len(Label), len(Label)), dtype=np.int64)
    np.add.at(counts, (exact.label, sampled.label), 1)
    return Comparison(
        fingers, grasps, extreme_normals, edges, locked(counts), int(sampled.hulls.sum())
    )


def comparisons() -> list[Comparison]:
    """Compare all `SAMPLES`: circular cones first, then polygons with as many edges as normals."""
    tasks = [
        (fingers, grasps, normals, normals if polygonal else None)
        for polygonal in (False, True)
        for fingers, (grasps, numbers) in SAMPLES.items()
        for normals in numbers
    ]
    weights = np.cumsum([grasps * (count + 1) ** fingers for fingers, grasps, count, _ in tasks])
    results = []
    for (fingers, grasps, normals, edges), part in zip(tasks, weights / weights[-1], strict=True):
        with unreported():
            results.append(compare(fingers, grasps, normals, edges=edges))
        report_progress(float(part))
    return results


def convergence_tables(results: Sequence[Comparison]) -> str:
    """Write comparisons as two Markdown tables: circular cones and inscribed polygons."""
    circular = _table([one for one in results if one.edges is None])
    polygonal = _table([one for one in results if one.edges is not None])
    return (
        f"{INTRODUCTION}\n\n"
        "Circular friction cones. An untested tilt can only turn an exact M into S or U.\n\n"
        f"{circular}\n\n"
        "Polygons inside those cones, with as many edges as there are extreme normals: in addition "
        f"an exact S can become M or U.\n\n{polygonal}"
    )


def _table(rows: Sequence[Comparison]) -> str:
    head = [
        "fingers", "grasps", "extreme normals", "edges", "exact S / M / U", "M labelled S",
        "M labelled U", "S labelled M", "S labelled U", "not allowed", "disagree",
        "M taken for sure", "hulls computed",
    ]  # fmt: skip
    cells = []
    for row in rows:
        exact = row.counts.sum(axis=1)
        cells.append(
            [
                str(row.fingers),
                f"{row.grasps:,}",
                str(row.extreme_normals),
                "circular" if row.edges is None else str(row.edges),
                " / ".join(str(exact[label]) for label in (Label.S, Label.M, Label.U)),
                *(str(row.counts[exact_, sampled]) for exact_, sampled in ALLOWED["polygonal"]),
                str(row.not_allowed),
                f"{100.0 * row.disagreement:.2f} ± {100.0 * row.error:.2f} %",
                f"{100.0 * row.overconfident:.2f} %",
                f"{row.hulls:,}",
            ]
        )
    return table(head, cells, left=0)


def surface_table(settings: PaperSettings) -> str:
    """Write a table of three solids, scanned and labelled by both methods."""
    head = ("object", "grasps", "μ", "α", "cones", "S, exact", "M, exact", "U, exact", "S, hulls",
            "M, hulls", "U, hulls", "area that differs", "vertices not allowed")  # fmt: skip
    solids = {
        "sphere": sphere_mesh(subdivisions=SUBDIVISIONS),
        "box": box_mesh(max_edge=EDGE),
        "cylinder": cylinder_mesh(max_edge=2.0 * EDGE),
    }
    rows = []
    for name, mesh in solids.items():
        exact = {
            "one finger fixed": scan_surface(mesh, settings.models[0], fixed=BELOW),
            "searched": label_surface(mesh, SEARCHED),
        }
        for kind, labels in exact.items():
            rows += [[name, kind, *_compared(labels, edges)] for edges in EDGES]
    return (
        "The same grasps labelled exactly, for all normals, and from the wrench hulls of 8 extreme "
        "normals and the perceived one; at creases those of every face, and the bisecting normal. "
        "The meshes are coarser than above, so the area fractions differ a little. 'Vertices not "
        "allowed' are those whose labels differ in a way that neither an untested tilt nor a "
        "polygon inside its cone nor rounding at the threshold of U explains.\n\n"
        + table(head, rows, left=2)
    )


def _compared(exact: SurfaceLabels, edges: int | None) -> list[str]:
    """The cells of one row."""
    model = replace(exact.model, method="extremes", edges=edges)
    hulls = exact.using(model=model)
    areas = exact.mesh.vertex_areas
    differ = float(areas[exact.label != hulls.label].sum() / areas.sum())
    wrong = (exact.label != hulls.label) & ~_left_open(exact, hulls)
    for pair in ALLOWED["circular" if edges is None else "polygonal"]:
        wrong &= (exact.label != pair[0]) | (hulls.label != pair[1])
    return [
        f"{model.friction:g}",
        resolution_cell(model),
        "circular" if edges is None else f"{edges} edges",
        *fraction_cells(exact.fractions()),
        *fraction_cells(hulls.fractions()),
        f"{100.0 * differ:.2f} %",
        str(int(np.count_nonzero(wrong))),
    ]


def _left_open(exact: SurfaceLabels, hulls: SurfaceLabels) -> Bools:
    """Whether a grasp at the threshold of U is U exactly, and rounding leaves its hulls open, (V,).

    What rounding leaves open is M.
    """
    threshold = exact.model.friction_angle + exact.model.tilt
    near = np.abs(exact.critical_angle_best - threshold) < ROUNDED
    tied: Bools = near & (exact.label == Label.U) & (hulls.label == Label.M)
    return tied


if __name__ == "__main__":
    print(f"## The same solids from wrench hulls alone\n\n{surface_table(PaperSettings())}\n")
    tables = convergence_tables(comparisons())
    print(f"## Sampled extreme normals against exact labels\n\n{tables}")
