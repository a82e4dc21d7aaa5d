import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp3d.contact import overlapping_field
from grasp3d.errors import SettingError


def longest_cell(field: float, pitch: float) -> float:
    """Longest stretch of a line on which the same fields report, by trying every point."""
    middles = pitch * np.arange(-40, 41)
    points = np.linspace(0.0, 2.0 * pitch, 4001)
    reports = np.abs(points[:, None] - middles) < field / 2.0
    changes = np.nonzero((reports[1:] != reports[:-1]).any(axis=1))[0]
    return float(np.diff(points[changes]).max())


@settings(max_examples=60, deadline=None)
@given(st.floats(0.1, 10.0), st.floats(1.0, 12.0))
def test_it_is_the_longest_stretch_on_which_the_same_fields_report(
    pitch: float, ratio: float
) -> None:
    field = ratio * pitch
    found = overlapping_field(field, pitch)
    assert found == pytest.approx(longest_cell(field, pitch), abs=0.002 * pitch)
    assert 0.5 * pitch * (1.0 - 1e-9) <= found <= pitch * (1.0 + 1e-9)


@pytest.mark.parametrize("fields", [1, 2, 3, 7])
def test_half_a_pitch_at_best_and_a_pitch_at_worst(fields: int) -> None:
    pitch = 0.3
    assert overlapping_field((fields + 0.5) * pitch, pitch) == pytest.approx(pitch / 2.0)
    assert overlapping_field(fields * pitch, pitch) == pytest.approx(pitch)


def test_fields_side_by_side_are_one_field() -> None:
    assert overlapping_field(4.0, 4.0) == 4.0
    assert overlapping_field(0.3, 0.1) == pytest.approx(0.1)  # 0.1 + 0.1 + 0.1 is not 0.3


@pytest.mark.parametrize(
    ("field", "pitch", "message"),
    [
        (0.0, 1.0, "receptive field must be a finite length above 0"),
        (math.inf, 1.0, "receptive field must be a finite length above 0"),
        (4.0, 0.0, "pitch must be above 0"),
        (4.0, 4.1, "pitch must be above 0 and at most the receptive field"),
        (4.0, math.nan, "pitch must be above 0"),
    ],
)
def test_bad_lengths_are_refused(field: float, pitch: float, message: str) -> None:
    with pytest.raises(SettingError, match=message):
        overlapping_field(field, pitch)
