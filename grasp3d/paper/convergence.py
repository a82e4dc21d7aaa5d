"""Error rates of the paper's sampled method: its labels against exact ones, on random grasps."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from grasp3d.arrays import Floats, Ints, locked
from grasp3d.contact.contacts import Contacts
from grasp3d.paper.markdown import table
from grasp3d.quality.epsilon_options import EpsilonOptions
from grasp3d.stability.classification import classify
from grasp3d.stability.label import Label
from grasp3d.system.progress import Progress

SAMPLES = {2: (2000, (4, 8, 16, 32)), 3: (500, (4, 8, 16)), 4: (200, (4, 8))}
"""For each number of fingers: the number of grasps, and numbers of extreme normals to compare."""

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
"""Disagreements (exact, sampled) that an untested tilt, or a polygon inside its cone, explains."""


INTRODUCTION = """Random grasps, labelled by the paper's method (a few extreme normals of maximal
tilt and the perceived one, every combination over the fingers) and exactly. 'Not allowed' counts
disagreements that an untested tilt, or a polygon inside its cone, cannot explain. 'M taken for
sure' is the fraction of the exact M that sampled normals label S or U: their over-confidence."""


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


def random_grasps(fingers: int, count: int, seed: int = SEED) -> tuple[Contacts, Floats]:
    """Random contacts on a ball, and sensor resolutions [rad], shape (count, 1).

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
    fraction = rng.uniform(0.0, 1.0, size=(count, 1))
    return contacts, 2.0 * fraction * contacts.friction_angle[:, :1]


def compare(
    fingers: int,
    grasps: int,
    extreme_normals: int,
    *,
    edges: int | None = None,
    seed: int = SEED,
    threads: int | None = None,
) -> Comparison:
    """Label random grasps exactly and with sampled normals.

    Args:
        fingers: Contacts of each grasp.
        grasps: Number of grasps.
        extreme_normals: Extreme normals of each contact.
        edges: Edges of the friction cones of the sampled method; None: circular cones.
        seed: Seed of the grasps.
        threads: Threads; None: one per processor.
    """
    contacts, resolution = random_grasps(fingers, grasps, seed)
    exact = classify(contacts, resolution, options=EpsilonOptions(threads=threads))
    options = EpsilonOptions(edges=edges, threads=threads)
    sampled = classify(
        contacts, resolution, method="extremes", extreme_normals=extreme_normals, options=options
    )
    counts = np.zeros((len(Label), len(Label)), dtype=np.int64)
    np.add.at(counts, (exact.label, sampled.label), 1)
    return Comparison(
        fingers, grasps, extreme_normals, edges, locked(counts), int(sampled.hulls.sum())
    )


def comparisons(progress: Progress | None = None) -> list[Comparison]:
    """Compare all `SAMPLES`: circular cones first, then polygons with as many edges as normals."""
    tasks = [
        (fingers, grasps, normals, normals if polygonal else None)
        for polygonal in (False, True)
        for fingers, (grasps, numbers) in SAMPLES.items()
        for normals in numbers
    ]
    weights = np.cumsum([grasps * (count + 1) ** fingers for fingers, grasps, count, _ in tasks])
    found = []
    for (fingers, grasps, normals, edges), done in zip(tasks, weights / weights[-1], strict=True):
        found.append(compare(fingers, grasps, normals, edges=edges))
        if progress is not None:
            progress(float(done))
    return found


def convergence_tables(found: Sequence[Comparison]) -> str:
    """Write comparisons as two Markdown tables: circular cones and inscribed polygons."""
    circular = _table([one for one in found if one.edges is None])
    polygonal = _table([one for one in found if one.edges is not None])
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
