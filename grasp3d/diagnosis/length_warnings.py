"""Lengths that do not fit the object: the millimetres that were read as metres."""

import math
from collections.abc import Iterator

from grasp3d.settings import GraspModel, MeshOptions, Sampling, Unit

SMALL, LARGE = 0.01, 100.0
"""Shares of the object's size beyond which a length is hardly meant in the object's unit."""


def length_warnings(
    size: float,
    unit: Unit | None,
    model: GraspModel,
    sampling: Sampling,
    options: MeshOptions,
) -> tuple[str, ...]:
    """Tell which settings are hardly in the mesh's unit, a sentence each.

    Args:
        size: Diameter of the object.
        unit: The mesh's, if it is known.
        model: Its torsion radius is a length.
        sampling: Openings and distances.
        options: The patch's radius.
    """
    stated = f"in {unit}" if unit else "in the mesh's unit, which nobody stated"
    return tuple(
        f"{name} {length:g} is {_times(length / size)} the object's size, {size:.4g}: lengths are "
        f"{stated}; is it the right one?"
        for name, length, upper in _lengths(model, sampling, options)
        if length / size < SMALL or (length / size > upper)
    )


def _lengths(
    model: GraspModel, sampling: Sampling, options: MeshOptions
) -> Iterator[tuple[str, float, float]]:
    """(name, length, largest share of the size) of the lengths that were given."""
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


def _times(share: float) -> str:
    if share >= LARGE:
        return f"{share:,.0f} times"
    return f"{share:.3g} times" if share > 1.0 else f"1/{1.0 / share:,.0f} of"
