"""How safe, and how cautious, labels with uncertain contact locations are.

Grasps of three to five fingers on the unit ball with uncertain normals and locations. Tilts of the
normals are covered exactly by thresholds on the critical friction angle, so a search over the
contacts' positions decides what a label should be: from the perceived positions it climbs to the
positions with the largest critical angle, and descends to those with the smallest. An S whose
largest angle reaches beta - alpha/2, or a U whose smallest is below beta + alpha/2, is wrong. An M
for which the search finds neither is one that the safe conditions give away, or that the search
missed: a bound from above of what they cost.

    python scripts/validate_uncertainty.py [--grasps 10000] [--steps 40] [--fingers 3 4 5]
"""

import argparse
import math

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from grasp3d import Contacts, Label, classify, critical_friction_angle

Floats = NDArray[np.float64]

FRICTION, ALPHA = 0.6, math.radians(10.0)
LARGEST_ERROR = 0.08
"""Largest location error, in radii of the ball."""


def unit(vectors: Floats) -> Floats:
    """Vectors (..., 3) scaled to length 1."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def random_grasps(count: int, fingers: int, rng: np.random.Generator) -> Contacts:
    """Grasps on the unit ball; three fingers are near a great circle, or few would be closed."""
    points = rng.normal(size=(count, fingers, 3))
    if fingers == 3:
        points[..., 2] *= 0.3
    points = unit(points)
    return Contacts(points, unit(-points + 0.25 * rng.normal(size=points.shape)), FRICTION)


def climb(
    contacts: Contacts, errors: Floats, sign: float, steps: int, rng: np.random.Generator
) -> Floats:
    """Largest (sign 1) or smallest (-1) critical angle found over the positions, shape (b,)."""
    shift = np.zeros_like(contacts.points)
    best = sign * critical_friction_angle(contacts)
    for step in range(steps):
        radius = 1.5 * (1.0 - step / steps) + 0.05
        tried = shift + radius * errors[..., None] * rng.normal(size=shift.shape)
        if step < 4:
            tried = errors[..., None] * unit(rng.normal(size=shift.shape))
        length = np.linalg.norm(tried, axis=-1)
        tried *= np.minimum(1.0, errors / np.maximum(length, 1e-300))[..., None]
        moved = Contacts(contacts.points + tried, contacts.normals, contacts.friction)
        found = sign * critical_friction_angle(moved)
        better = found > best
        best = np.where(better, found, best)
        shift = np.where(better[:, None, None], tried, shift)
    return np.asarray(sign * best)


def main() -> None:
    """Print a table: labels, wrong ones, and what the safe conditions give away."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--grasps", type=int, default=10_000)
    parser.add_argument("--steps", type=int, default=40)
    parser.add_argument("--fingers", type=int, nargs="+", default=[3, 4, 5])
    options = parser.parse_args()
    table = Table("fingers", "S", "M", "U", "wrong S", "wrong U", "M, none fails", "M, none holds")
    beta, tilt = math.atan(FRICTION), ALPHA / 2.0
    for fingers in options.fingers:
        rng = np.random.default_rng(fingers)
        contacts = random_grasps(options.grasps, fingers, rng)
        errors = rng.uniform(0.0, LARGEST_ERROR, size=(options.grasps, fingers))
        label = classify(contacts, ALPHA, location_error=errors).label
        fails = climb(contacts, errors, 1.0, options.steps, rng) >= beta - tilt
        holds = climb(contacts, errors, -1.0, options.steps, rng) < beta + tilt
        counts = [int((label == code).sum()) for code in (Label.S, Label.M, Label.U)]
        ambiguous = label == Label.M
        table.add_row(
            str(fingers),
            *map(str, counts),
            str(int((fails & (label == Label.S)).sum())),
            str(int((holds & (label == Label.U)).sum())),
            f"{(~fails & ambiguous).sum() / max(counts[1], 1):.1%}",
            f"{(~holds & ambiguous).sum() / max(counts[1], 1):.1%}",
        )
    Console().print(table)


if __name__ == "__main__":
    main()
