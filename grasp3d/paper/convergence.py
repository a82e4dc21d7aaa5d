"""How often the paper's sampled method errs: its labels beside exact ones, on random grasps."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from grasp3d.arrays import Floats, Ints, locked
from grasp3d.contact.contacts import Contacts
from grasp3d.paper.markdown import table
from grasp3d.stability.classification import classify
from grasp3d.stability.label import Label
from grasp3d.system.progress import Progress

SAMPLES = {2: (2000, (4, 8, 16, 32)), 3: (500, (4, 8, 16)), 4: (200, (4, 8))}
"""For each number of fingers: how many grasps, and the numbers of extreme normals on a rim."""

SEED = 2018

ALLOWED = {
    "circular": ((Label.M, Label.S), (Label.M, Label.U)),
    "polygonal": (
        (Label.M, Label.S),
        (Label.M, Label.U),
        (Label.S, Label.M),
        (Label.S, Label.U),
    ),
}
"""Disagreements (exact, sampled) that a tilt left out, or a polygon inside its cone, explains."""


INTRODUCTION = """Random grasps, labelled by the paper's method (a few extreme normals on a rim and
the perceived one, every combination over the fingers) and exactly. 'Not allowed' counts
disagreements that a tilt not tried, or a polygon inside its cone, cannot explain. 'M taken for
sure' is the share of the exact M that sampled normals call S or U: how over-confident they are."""


@dataclass(frozen=True, eq=False)
class Comparison:
    """Labels of one sampled method beside the exact ones."""

    fingers: int
    grasps: int
    extreme_normals: int
    """Normals on a rim; with them the perceived one."""
    edges: int | None
    """Edges of the friction cones; None: circular ones."""
    counts: Ints
    """Grasps by exact label (rows) and sampled label (columns), in the order of `Label`, (3, 3)."""
    hulls: int
    """Wrench hulls grown."""

    @property
    def share(self) -> float:
        """Share of the grasps whose labels differ."""
        return 1.0 - float(np.trace(self.counts)) / self.grasps

    @property
    def error(self) -> float:
        """Standard error of that share."""
        return math.sqrt(self.share * (1.0 - self.share) / self.grasps)

    @property
    def overconfident(self) -> float:
        """Share of the exact M that are called S or U."""
        ambiguous = self.counts[Label.M]
        return float(ambiguous.sum() - ambiguous[Label.M]) / max(int(ambiguous.sum()), 1)

    @property
    def forbidden(self) -> int:
        """Disagreements that no missing tilt and no inscribed polygon explains."""
        allowed = ALLOWED["circular" if self.edges is None else "polygonal"]
        wrong = self.counts.sum() - np.trace(self.counts)
        return int(wrong - sum(self.counts[exact, sampled] for exact, sampled in allowed))


def random_grasps(fingers: int, count: int, seed: int = SEED) -> tuple[Contacts, Floats]:
    """Contacts about a ball, and sensor resolutions [rad], shape (count, 1).

    Friction is 0.3 to 1 and the resolution up to twice the friction angle, so that S, M and U are
    all common.
    """
    rng = np.random.default_rng([seed, fingers])
    points = rng.normal(size=(count, fingers, 3))
    if fingers == 2:
        points[:, 1] = -points[:, 0] + 0.25 * rng.normal(size=(count, 3))
    points /= np.linalg.norm(points, axis=-1, keepdims=True)
    normals = -points + 0.25 * rng.normal(size=points.shape)
    contacts = Contacts(points, normals, rng.uniform(0.3, 1.0, size=(count, 1)))
    share = rng.uniform(0.0, 1.0, size=(count, 1))
    return contacts, 2.0 * share * contacts.friction_angle[:, :1]


def compare(
    fingers: int,
    grasps: int,
    extreme_normals: int,
    *,
    edges: int | None = None,
    seed: int = SEED,
    threads: int | None = None,
) -> Comparison:
    """Label random grasps both ways.

    Args:
        fingers: Contacts of each grasp.
        grasps: How many.
        extreme_normals: Normals on a rim.
        edges: Edges of the friction cones of the sampled method; None: circular ones.
        seed: Of the grasps.
        threads: Threads; None: one per processor.
    """
    contacts, resolution = random_grasps(fingers, grasps, seed)
    exact = classify(contacts, resolution, threads=threads)
    sampled = classify(
        contacts, resolution, method="extremes", extreme_normals=extreme_normals, edges=edges,
        threads=threads,
    )  # fmt: skip
    counts = np.zeros((len(Label), len(Label)), dtype=np.int64)
    np.add.at(counts, (exact.label, sampled.label), 1)
    return Comparison(
        fingers, grasps, extreme_normals, edges, locked(counts), int(sampled.hulls.sum())
    )


def comparisons(progress: Progress | None = None) -> list[Comparison]:
    """Compare all `SAMPLES`: circular cones first, then polygons of as many edges as normals."""
    tasks = [
        (fingers, grasps, around, around if polygonal else None)
        for polygonal in (False, True)
        for fingers, (grasps, rims) in SAMPLES.items()
        for around in rims
    ]
    weights = np.cumsum([grasps * (around + 1) ** fingers for fingers, grasps, around, _ in tasks])
    found = []
    for (fingers, grasps, around, edges), done in zip(tasks, weights / weights[-1], strict=True):
        found.append(compare(fingers, grasps, around, edges=edges))
        if progress is not None:
            progress(float(done))
    return found


def convergence_tables(found: Sequence[Comparison]) -> str:
    """Write comparisons as two Markdown tables, of circular cones and of inscribed polygons."""
    circular = _table([one for one in found if one.edges is None])
    polygonal = _table([one for one in found if one.edges is not None])
    return (
        f"{INTRODUCTION}\n\n"
        "Circular friction cones. A tilt that was not tried can only make an exact M look like S "
        f"or U.\n\n{circular}\n\n"
        "Polygons of as many edges as there are normals on a rim, inside those cones: besides, an "
        f"exact S can look like M or U.\n\n{polygonal}"
    )


def _table(rows: Sequence[Comparison]) -> str:
    head = [
        "fingers", "grasps", "normals on a rim", "edges", "exact S / M / U", "M called S",
        "M called U", "S called M", "S called U", "not allowed", "disagree", "M taken for sure",
        "hulls grown",
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
                str(row.forbidden),
                f"{100.0 * row.share:.2f} ± {100.0 * row.error:.2f} %",
                f"{100.0 * row.overconfident:.2f} %",
                f"{row.hulls:,}",
            ]
        )
    return table(head, cells, left=0)
