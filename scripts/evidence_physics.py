"""Compare labels and grip forces with MuJoCo: `python scripts/evidence_physics.py -o physics`.

There are two parts. Facets: two round tips press on two plates that are tilted at random; the tilt
and the friction at which they begin to slip are compared with the critical friction angle, and the
labels of pairs as perceived with hold and slip of the true ones. Forces: the smallest force that
holds a load at random contacts, hard and soft, is compared with `grip_force`. Whole grippers on
objects are in `evidence_grippers.py`. The script needs the extra `physics`.

It writes a CSV table for each part, and `physics.md` with all printed tables.
"""

import argparse
import math
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

import grasp3d
from grasp3d.outcomes.success import success_rate
from grasp3d.system.tables import write_columns
from tests.helpers.facets import (
    SLIPPED,
    FacetPress,
    facet_slip,
    holding_force,
    random_facets,
    slip_friction,
    slip_tilt,
    tilt_at_random,
)

FRICTIONS = (0.2, 0.5, 0.8)
RESOLUTIONS = {0.2: math.radians(10.0), 0.5: math.radians(22.6), 0.8: math.radians(22.6)}
"""Resolutions by friction: at 0.2, no grasp is S with 22.6 degrees."""

OPENING = 0.05


class Report:
    """Lines that are printed and kept for a file."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def add(self, *lines: str) -> None:
        """Print and keep lines."""
        print(*lines, sep="\n", flush=True)
        self.lines += lines

    def table(self, head: str, rows: Iterator[str]) -> None:
        """Print and keep a table whose cells are separated by |."""
        self.add("", f"| {head} |", "|" + "---|" * (head.count("|") + 1))
        for row in rows:
            self.add(f"| {row} |")
        self.add("")


def facets(report: Report, folder: Path, pairs: int) -> None:
    """Compare slip on random facets with critical friction angles and labels."""
    random, rows = np.random.default_rng(22), []
    report.add("## Two facets", "")
    _creep(report)
    for friction in FRICTIONS:
        for _ in range(pairs):
            normals = random_facets(random, 0.5 * math.pi - 0.2)
            angle = _critical_angle(normals, friction)
            rows.append({
                "friction": friction,
                "critical_angle": angle,
                "slip_friction_angle": slip_friction(normals),
                "slip_tilt": slip_tilt(normals, friction),
            })  # fmt: skip
    columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    write_columns(folder / "facets.csv", columns, settings={"seed": 22, "pairs": pairs})

    def lines() -> Iterator[str]:
        for friction in FRICTIONS:
            mine = columns["friction"] == friction
            tilt = np.degrees(columns["slip_tilt"][mine] - math.atan(friction))
            turned = np.degrees((columns["slip_friction_angle"] - columns["critical_angle"])[mine])
            yield (
                f"{friction} | {mine.sum()} | {tilt.min():+.3f} to {tilt.max():+.3f} | "
                f"{turned.min():+.3f} to {turned.max():+.3f}"
            )

    report.table(
        "friction | pairs | tilt of slip - beta [deg] | friction angle of slip - beta* [deg]",
        lines(),
    )
    _labelled_facets(report, folder, random, pairs)


def _creep(report: Report) -> None:
    """Measure how a grasp 5 degrees within its cone creeps with and without dry friction."""
    tilt = math.atan(0.5) - math.radians(5.0)
    normals = [[math.cos(tilt), math.sin(tilt), 0.0], [-1.0, 0.0, 0.0]]
    shifts = [
        facet_slip(normals, 0.5, FacetPress(dry_friction=dry, seconds=2.0, most_shift=math.inf))
        for dry in (True, False)
    ]
    report.add(
        f"5 degrees within the cone, 2 s: shift {1e3 * shifts[0]:.4f} mm with elliptic cones, "
        f"impratio 10 and no-slip iterations, {1e3 * shifts[1]:.1f} mm with MuJoCo's defaults"
    )


def _labelled_facets(report: Report, folder: Path, random: np.random.Generator, pairs: int) -> None:
    """Compare labels of perceived facets with hold and slip of the true ones."""
    rows = []
    for friction in FRICTIONS:
        for label, wanted in (("S", pairs), ("M", pairs), ("U", pairs)):
            found = 0
            for _ in range(100_000):
                if found == wanted:
                    break
                tilt = 0.5 * RESOLUTIONS[friction]
                seen = random_facets(random, math.atan(friction) + tilt + 0.3)
                named, margin = _label(seen, friction)
                if named != label:
                    continue
                # Half of the facets are at the rim, where the label is hardest to satisfy.
                tilts = np.full(2, tilt)
                true = (
                    tilt_at_random(seen, tilts, random) if found % 2 else _rim(seen, tilts, random)
                )
                if not (true[:, 0] * (1.0, -1.0) > 0.05).all():
                    continue
                found += 1
                rows.append({
                    "friction": friction, "label": label, "margin": margin,
                    "held": facet_slip(true, friction) < SLIPPED,
                })  # fmt: skip

    columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    write_columns(folder / "labels.csv", columns, settings={"seed": 22, "pairs": pairs})

    def lines() -> Iterator[str]:
        for friction in FRICTIONS:
            mine = columns["friction"] == friction
            cells = [_cell(columns["held"][mine & (columns["label"] == label)]) for label in "SMU"]
            yield f"{friction} | " + " | ".join(cells)

    report.add("True normals within alpha/2 of the perceived ones, half of them on the rim:")
    report.table("friction | S holds | M holds | U holds", lines())


def _rim(seen: np.ndarray, tilts: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Normals tilted by exactly the largest angle."""
    away = tilt_at_random(seen, np.full(2, 1e-3), random) - seen
    across = away - (away * seen).sum(axis=1, keepdims=True) * seen
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    return np.cos(tilts)[:, None] * seen + np.sin(tilts)[:, None] * across


def _contacts(normals: np.ndarray, friction: float) -> grasp3d.Contacts:
    points = 0.5 * OPENING * np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    return grasp3d.Contacts(points, normals, friction)


def _critical_angle(normals: np.ndarray, friction: float) -> float:
    return float(grasp3d.critical_friction_angle(_contacts(normals, friction)))


def _label(normals: np.ndarray, friction: float) -> tuple[str, float]:
    found = grasp3d.classify(_contacts(normals, friction), RESOLUTIONS[friction])
    return grasp3d.Label(int(found.label)).name, float(found.margin)


def forces(report: Report, folder: Path, cases: int) -> None:
    """Compare the smallest holding forces in simulation with computed ones."""
    random, rows = np.random.default_rng(8), []
    for number in range(cases):
        soft = number % 2 == 1
        friction = float(random.uniform(0.3, 1.0))
        torsion = float(random.uniform(0.001, 0.006)) if soft else 0.0
        opening = float(random.uniform(0.02, 0.08))
        normals = random_facets(random, 0.6 * math.atan(friction) if number % 4 > 1 else 0.0)
        points = 0.5 * opening * np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
        center = random.uniform(-0.015, 0.015, 3) * soft
        contacts = grasp3d.Contacts(points - center, normals, friction, torsion)
        down = random.standard_normal(3)
        wrench = np.concatenate([down / np.linalg.norm(down), np.zeros(3)])
        simulated = holding_force(contacts, wrench)
        computed = float(grasp3d.grip_force(contacts, wrench, bound="normal").value)
        rows.append({
            "soft": soft, "friction": friction, "torsion_radius": torsion, "opening": opening,
            "offset": float(np.linalg.norm(center)), "computed": computed,
            "simulated": simulated.normal, "motor": simulated.motor,
        })  # fmt: skip
    columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    write_columns(folder / "forces.csv", columns, settings={"seed": 8, "cases": cases})
    ratio = columns["simulated"] / columns["computed"]
    report.add("## Grip force", "", "The load is 1 N in a random direction.")

    def lines() -> Iterator[str]:
        for name, mine in (
            ("hard tips, load on the line", ~columns["soft"]),
            ("soft tips, load up to 26 mm off it", columns["soft"]),
        ):
            computed = columns["computed"][mine]
            yield (
                f"{name} | {mine.sum()} | {computed.min():.2f} to {computed.max():.2f} | "
                f"{ratio[mine].min():.3f} to {ratio[mine].max():.3f}"
            )

    report.table("case | count | computed force [N] | simulated / computed", lines())


def _cell(held: np.ndarray) -> str:
    """Write the share of some grasps that held, with its 95 % confidence interval."""
    rate = success_rate("", held)
    if not rate.count:
        return "–"
    low, high = rate.interval
    return f"{rate.successes}/{rate.count} ({low:.2f} to {high:.2f})"


def main() -> int:
    """Run the chosen parts and write their tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", default="physics", help="folder of the tables")
    parser.add_argument("--only", nargs="*", default=["facets", "forces"])
    parser.add_argument("--pairs", type=int, default=60, help="facets for each friction")
    parser.add_argument("--cases", type=int, default=24, help="of grip forces")
    options = parser.parse_args()
    folder, report, start = Path(options.output), Report(), time.process_time()
    folder.mkdir(parents=True, exist_ok=True)
    if "facets" in options.only:
        facets(report, folder, options.pairs)
    if "forces" in options.only:
        forces(report, folder, options.cases)
    report.add(f"{time.process_time() - start:.0f} s of one core")
    (folder / "physics.md").write_text("\n".join(report.lines) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
