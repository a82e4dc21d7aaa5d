import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp3d.outcomes import SuccessRate


@given(st.integers(1, 10_000), st.floats(0.0, 1.0))
def test_wilson_solves_its_equation(count: int, part: float) -> None:
    """Its ends are where the score test just rejects: (p - x)^2 = z^2 x (1 - x) / n."""
    held = round(part * count)
    low, high = SuccessRate("", count, held).interval
    assert 0.0 <= low <= held / count <= high <= 1.0
    for end in (low, high):
        difference = (held / count - end) ** 2 - 1.959964**2 * end * (1.0 - end) / count
        assert difference == pytest.approx(0.0, abs=1e-6)


def test_wilson_of_known_counts() -> None:
    """Newcombe 1998, Table I: 81 of 263, 15 of 148, 0 of 20, 1 of 29."""
    for held, count, low, high in (
        (81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611),
        (1, 29, 0.0061, 0.1718),
    ):  # fmt: skip
        assert SuccessRate("", count, held).interval == pytest.approx((low, high), abs=5e-5)
    none = SuccessRate("S", 0, 0)
    assert none.interval == (0.0, 1.0)
    assert math.isnan(none.rate)
