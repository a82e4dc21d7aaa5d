"""Bounds on the work of repair and preparation, checked before the work is done."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from grasp3d.arrays import Floats, Ints
from grasp3d.errors import MeshError

_MIX = np.uint64(0x9E3779B97F4A7C15)
"""Odd factor that spreads the numbers of a cell over 64 bits (Fibonacci hashing)."""


class WorkBoundError(MeshError):
    """A step would take longer than its bound allows; the message does not name the mesh."""


@dataclass(frozen=True)
class WorkBound:
    """The most work that one step does: at most a minute of one processor."""

    step: str
    """The step, as the subject of a sentence."""
    things: str
    """What is counted, in the plural."""
    most: int
    """Largest count."""
    remedy: str
    """What to do about the mesh."""

    def check(self, count: float) -> None:
        """Refuse work above the bound.

        Args:
            count: Amount of work, or an upper bound of it.

        Raises:
            WorkBoundError: It is above the bound.
        """
        if count > self.most:
            raise WorkBoundError(
                f"{self.step} would need {count:,.0f} {self.things}, and at most {self.most:,} are "
                f"computed; {self.remedy}"
            )


CLOSE_POINTS = WorkBound(
    "joining vertices that differ by rounding",
    "pairs of close vertices",
    20_000_000,
    "most vertices are within rounding of each other: remove far parts, or export the mesh with "
    "more digits",
)
BODY_BOXES = WorkBound(
    "searching for bodies that overlap",
    "comparisons of bodies' boxes",
    100_000_000,
    "reduce the number of separate bodies",
)
NESTED_BODIES = WorkBound(
    "searching for bodies within others",
    "faces to subtract",
    20_000_000,
    "reduce the number of bodies that lie within others, or give --repair none",
)
UNITED_BODIES = WorkBound(
    "uniting bodies that overlap",
    "comparisons of faces",
    10_000_000,
    "unite them in a CAD program, or give --repair none",
)
BODY_COPIES = WorkBound(
    "searching for copies of bodies",
    "comparisons of bodies",
    5_000_000,
    "remove the bodies that are repeated, or give --repair none",
)
INNER_WALLS = WorkBound(
    "searching for walls inside the object",
    "faces to sum over",
    60_000_000,
    "reduce the number of bodies that share faces, or give --repair none",
)
MATCHED_WALLS = WorkBound(
    "searching for faces that are back to back",
    "pairs of sheets with one border",
    100_000,
    "remove the sheets that share their border, or give --repair none",
)
NEAR_FACES = WorkBound(
    "searching for the faces where bodies meet",
    "pairs of a vertex and a face",
    30_000_000,
    "unite the bodies in a CAD program, or give --repair none",
)
POINTS_ON_FACES = WorkBound(
    "dividing the faces where bodies meet",
    "divisions",
    1_000_000,
    "unite the bodies in a CAD program, or give --repair none",
)
LONG_HOLES = WorkBound(
    "closing the long holes",
    "comparisons of edges",
    20_000_000_000,
    "close it in a CAD program, or leave it open with --repair safe",
)


@contextmanager
def bounds_of(where: str) -> Iterator[None]:
    """Name the mesh in errors about bounds.

    Args:
        where: Name of the mesh in errors.

    Raises:
        MeshError: A step would exceed its bound.
    """
    try:
        yield
    except WorkBoundError as error:
        raise MeshError(f"{where}: {error}") from error


def close_pairs(points: Floats, distance: float) -> Ints:
    """Pairs of points within a distance of each other, shape (k, 2).

    Args:
        points: Positions (n, 3).
        distance: Largest distance.

    Raises:
        WorkBoundError: There are too many.
    """
    if len(points) ** 2 > CLOSE_POINTS.most and distance > 0.0:
        CLOSE_POINTS.check(pairs_in_cells(points, distance))
    pairs = cKDTree(points).query_pairs(distance, output_type="ndarray")
    return np.asarray(pairs, dtype=np.int64)


def pairs_in_cells(points: Floats, side: float) -> int:
    """Number of pairs of points (n, d) in one cell of a grid, found without comparing the points.

    That of pairs closer than a cell's side is of the same order, wherever points crowd.
    """
    count = cell_counts(points, side)
    return int((count * (count - 1) // 2).sum())


def cell_counts(points: Floats, side: float) -> Ints:
    """Number of points (n, d) in each cell of a grid that has any.

    Args:
        points: Positions.
        side: Side of a cell, > 0.
    """
    cells = (np.floor(points / side) + 0.0).view(np.uint64)  # -0.0 and 0.0 are one cell
    mixed = np.zeros(len(points), dtype=np.uint64)
    for column in cells.T:
        mixed = (mixed ^ column ^ (mixed >> np.uint64(29))) * _MIX
    _, count = np.unique(mixed ^ (mixed >> np.uint64(32)), return_counts=True)
    return np.asarray(count, dtype=np.int64)
