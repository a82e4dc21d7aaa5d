"""Warnings about lengths that are probably in another unit than the mesh."""

import math
from collections.abc import Iterator

from grasp3d.settings import GraspModel, MeshOptions, Sampling, Unit

SMALL, LARGE = 0.01, 100.0
"""Range of lengths that are plausible in the mesh's unit, as fractions of the object's size."""


def length_warnings(
    size: float,
    unit: Unit | None,
    model: GraspModel,
    sampling: Sampling,
    options: MeshOptions,
) -> tuple[str, ...]:
    """Return a message for each setting that is probably not in the mesh's unit.

    Args:
        size: Diameter of the object, in the mesh's unit.
        unit: The mesh's unit; None: not stated.
        model: With its torsion radius.
        sampling: With its openings and distances.
        options: With the patch radius.
    """
    stated = f"in {unit}" if unit else "in the mesh's unit, which is not stated"
    return tuple(
        f"{name} {length:g} is {_times(length / size)} the object's size, {size:.4g}: lengths are "
        f"{stated}; is it the right one?"
        for name, length, upper in _lengths(model, sampling, options)
        if length / size < SMALL or (length / size > upper)
    )


def _lengths(
    model: GraspModel, sampling: Sampling, options: MeshOptions
) -> Iterator[tuple[str, float, float]]:
    """Yield (name, length, largest plausible fraction of the size) of the lengths that are set."""
    for name, length, upper in (
        ("max_opening", sampling.max_opening, LARGE),
        ("min_opening", sampling.min_opening, 1.0),
        ("max_spread", sampling.max_spread, LARGE),
        ("min_separation", sampling.min_separation or 0.0, 1.0),
        ("torsion_radius", model.torsion_radius, 1.0),
        ("patch_radius", options.patch_radius, 1.0),
    ):
        if 0.0 < length < math.inf:
            yield name, length, upper


def _times(ratio: float) -> str:
    if ratio >= LARGE:
        return f"{ratio:,.0f} times"
    return f"{ratio:.3g} times" if ratio > 1.0 else f"1/{1.0 / ratio:,.0f} of"
