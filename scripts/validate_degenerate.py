"""Compare degenerate grasps with oracles: `python scripts/validate_degenerate.py`.

Contacts at one point, nearly at one point (1e-15 to 1e-2 of the size apart), on a line or in a
plane. For each kind of grasp and number of contacts the table counts, against the critical angles
of `tests/helpers/degenerate.py`:

* low: critical friction angles more than 1e-4 below the true one (must be 0), and the largest gap;
* closed: grasps called force-closed that are not (must be 0);
* S, U: labels that are contradicted (must be 0);
* proofs: certificates that do not prove what they are for (must be 0): forces strictly inside their
  cones whose sum is rounding beside the smallest of them, or a direction that separates;
* high: critical angles more than 2e-4 above the true one, and M: labels M where S or U is true.
  Both are safe; they occur where rounding leaves the answer open.

A sample of each kind, without contacts that nearly coincide, is compared with linear programs too.
"""

import argparse
import math
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from grasp3d import Contacts, classify, force_closure, running
from grasp3d.quality import critical_friction_angle
from tests.helpers.degenerate import (
    KINDS,
    RIGHT,
    Grasps,
    critical_angle_by_programs,
    critical_angles,
    random_grasps,
    unproven_certificates,
)

NEAR = 1e-5
"""Angle within which the oracle does not decide [rad]."""

COLUMNS = (
    "grasps", "low", "gap", "closed", "S wrong", "U wrong", "proofs", "programs", "high", "M",
)  # fmt: skip

MUST_BE_ZERO = ("low", "closed", "S wrong", "U wrong", "proofs", "programs")


@dataclass
class Row:
    """Counts of one kind of grasps."""

    counts: dict[str, float]

    def text(self) -> str:
        """The row of the table."""
        return "".join(
            f"{self.counts[name]:9.1e}" if name == "gap" else f"{self.counts[name]:9.0f}"
            for name in COLUMNS
        )


def truth(grasps: Grasps) -> np.ndarray:
    """Critical angles; of two contacts from the closed form."""
    if grasps.points.shape[1] > 2:
        angles, proven = critical_angles(grasps.points, grasps.normals, grasps.on_line)
        if not proven.all():
            raise RuntimeError(f"{grasps.kind}: the oracle did not finish")
        return angles
    line = grasps.points[:, 1] - grasps.points[:, 0]
    cosines = [
        np.arccos(np.clip((grasps.normals[:, i] * sign * line).sum(axis=1)
                          / np.maximum(np.linalg.norm(line, axis=1), 1e-300), -1.0, 1.0))
        for sign in (1.0, -1.0) for i in (0, 1)
    ]  # fmt: skip
    best = np.minimum(np.maximum(cosines[0], cosines[3]), np.maximum(cosines[1], cosines[2]))
    opposed = np.arccos(np.clip(-(grasps.normals[:, 0] * grasps.normals[:, 1]).sum(axis=1), -1, 1))
    return np.where((line == 0.0).all(axis=1), opposed / 2.0, best)


def _small_angles(count: int, rng: np.random.Generator) -> np.ndarray:
    """Angles of 1e-4 to 0.3 of either sign."""
    return 10.0 ** rng.uniform(-4.0, -0.5, count) * rng.choice([-1.0, 1.0], count)


def compare(grasps: Grasps, programs: int, rng: np.random.Generator) -> Row:
    """Compare grasps with the oracles; `programs` of them with linear programs."""
    count, contacts = grasps.points.shape[:2]
    angle = truth(grasps)
    beta = np.where(
        rng.random(count) < 0.5,
        rng.uniform(0.05, 1.4, count),
        np.clip(angle + _small_angles(count, rng), 0.02, 1.5),
    )
    tilt = rng.uniform(0.0, 0.3, count)
    friction = np.tan(beta)[:, None] * np.ones(contacts)
    batch = Contacts(grasps.points, grasps.normals, friction=friction)
    found = np.asarray(critical_friction_angle(batch))
    closure = force_closure(batch)
    labels = classify(batch, 2.0 * tilt[:, None] * np.ones(contacts)).label
    closed = np.asarray(closure.closed)
    if contacts == 2:
        closed = closed & (beta < RIGHT)
    stable, unstable = labels == 2, labels == 0
    wide = beta + tilt < RIGHT if contacts > 2 else np.ones(count, dtype=bool)
    disagreeing = 0
    gaps = np.linalg.norm(grasps.points[:, :, None] - grasps.points[:, None], axis=-1)
    apart = ~((gaps > 0.0) & (gaps < 1e-2)).any(axis=(1, 2))
    for g in np.flatnonzero(apart & (contacts > 2))[:programs]:
        low, high = critical_angle_by_programs(
            grasps.points[g], grasps.normals[g], on_line=bool(grasps.on_line[g])
        )
        true = min(max(float(angle[g]), 0.0), RIGHT - 1e-3)
        disagreeing += not low - 3e-4 <= true <= high + 3e-4
    return Row(
        {
            "grasps": count,
            "low": (found < angle - 1e-4).sum(),
            "gap": max(0.0, float((angle - found).max())),
            "closed": (closed & (angle > beta + NEAR)).sum(),
            "S wrong": (stable & (angle > beta - tilt + NEAR)).sum(),
            "U wrong": (unstable & (angle < beta + tilt - NEAR)).sum(),
            "proofs": len(unproven_certificates(batch, closure, grasps.on_line)),
            "programs": disagreeing,
            "high": (found > angle + 2e-4).sum(),
            "M": (
                (~stable & (angle < beta - tilt - NEAR))
                | (~unstable & (angle > beta + tilt + NEAR) & wide)
            ).sum(),
        }
    )


def main() -> int:
    """Compare and print; 1 where anything is contradicted."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--grasps", type=int, default=100_000, help="grasps in all")
    parser.add_argument("--programs", type=int, default=10, help="of each kind, linear programs")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    cases = [(kind, contacts) for kind, counts in KINDS.items() for contacts in counts]
    each = math.ceil(options.grasps / len(cases))
    print(f"{'':24}" + "".join(f"{name:>9}" for name in COLUMNS), flush=True)
    start, total = time.perf_counter(), dict.fromkeys(COLUMNS, 0.0)
    for kind, contacts in cases:
        row = compare(random_grasps(kind, contacts, each, rng), options.programs, rng)
        for name, value in row.counts.items():
            total[name] = max(total[name], value) if name == "gap" else total[name] + value
        print(f"{f'{kind}, {contacts}':24}{row.text()}", flush=True)
    print(f"{'all':24}{Row(total).text()}\n{time.perf_counter() - start:.0f} s")
    return int(any(total[name] for name in MUST_BE_ZERO))


if __name__ == "__main__":
    with running(threads=1):
        sys.exit(main())
