"""Fewer garbage collections while Numba compiles, and as before afterwards."""

import gc
from collections.abc import Iterator

import pytest

from grasp3d._kernels.compiling.collecting import YOUNG_OBJECTS, CollectionPauses


@pytest.fixture(autouse=True)
def threshold() -> Iterator[tuple[int, int, int]]:
    before = gc.get_threshold()
    yield before
    gc.set_threshold(*before)


def test_collections_are_rarer_until_the_outermost_kernel_is_compiled() -> None:
    gc.set_threshold(700, 7, 8)
    pauses = CollectionPauses()
    pauses.on_start(None)
    pauses.on_start(None)
    assert gc.get_threshold() == (YOUNG_OBJECTS, 7, 8)
    pauses.on_end(None)
    assert gc.get_threshold() == (YOUNG_OBJECTS, 7, 8)
    pauses.on_end(None)
    assert gc.get_threshold() == (700, 7, 8)


@pytest.mark.parametrize("first", [0, YOUNG_OBJECTS + 1])
def test_who_collects_less_or_never_keeps_that(first: int) -> None:
    gc.set_threshold(first, 7, 8)
    pauses = CollectionPauses()
    pauses.on_start(None)
    assert gc.get_threshold() == (first, 7, 8)
    pauses.on_end(None)
    assert gc.get_threshold() == (first, 7, 8)
