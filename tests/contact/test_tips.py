import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import dblquad, quad

import grasp3d
from grasp3d.contact import CylinderTip, EllipsoidTip
from grasp3d.errors import SettingError

axes = st.floats(2.0, 20.0)


@settings(max_examples=60, deadline=None)
@given(st.floats(1.0, 50.0), st.floats(0.05, 3.0), st.floats(-10.0, 10.0))
def test_a_cylinders_normal_turns_as_far_as_a_helix_goes_around(
    radius: float, turn: float, direction: float
) -> None:
    field = turn * radius
    found = CylinderTip(radius).resolution(field, direction=direction)
    # Ends of an arc of that length in that direction, unrolled.
    angle = np.array([-0.5, 0.5]) * field * math.cos(direction) / radius
    normals = np.stack([np.cos(angle), np.sin(angle)])
    between = math.acos(np.clip(normals[:, 0] @ normals[:, 1], -1.0, 1.0))
    assert found == pytest.approx(between, abs=1e-6)
    assert CylinderTip(radius).sensor(field) == grasp3d.Sensor(field, radius)


@settings(max_examples=60, deadline=None)
@given(axes, st.floats(0.05, 3.0), st.integers(0, 1000))
def test_a_ball_has_the_resolution_of_a_round_tip_everywhere(
    radius: float, turn: float, seed: int
) -> None:
    tip, field = EllipsoidTip((radius, radius, radius)), turn * radius
    towards = np.random.default_rng(seed).normal(size=3)
    sensor = grasp3d.Sensor(field, radius)
    assert tip.resolution_at(field, towards).resolution == pytest.approx(turn, rel=1e-4)
    assert tip.worst(field).resolution == pytest.approx(turn, rel=1e-9)
    assert tip.sensor(field).fingertip_radius == pytest.approx(radius, rel=1e-9)
    assert tip.sensors_by_discs(field) == sensor.sensors_by_discs


@pytest.mark.slow
@settings(max_examples=15, deadline=None)
@given(st.tuples(axes, axes, axes), st.floats(0.05, 0.9), st.integers(0, 1000))
def test_nowhere_on_a_tip_is_the_resolution_coarser_than_the_worst(
    semi_axes: tuple[float, float, float], fraction: float, seed: int
) -> None:
    tip = EllipsoidTip(semi_axes)
    field = fraction * tip.longest_field
    worst = tip.worst(field)
    assert worst.resolution <= field * tip.largest_curvature * (1.0 + 1e-9)
    at = tip.resolution_at(field, worst.point)
    assert at.resolution == pytest.approx(worst.resolution, rel=1e-3)
    np.testing.assert_allclose(at.point, worst.point, atol=1e-9 * max(semi_axes))
    for towards in np.random.default_rng(seed).normal(size=(12, 3)):
        assert tip.resolution_at(field, towards).resolution <= worst.resolution * (1.0 + 1e-4)


@pytest.mark.slow
def test_the_worst_is_found_by_a_search_over_the_tip() -> None:
    tip, field = EllipsoidTip((8.0, 10.0, 12.0)), 4.0
    grid = np.linspace(0.0, math.pi / 2.0, 11)
    polar, azimuth = map(np.ravel, np.meshgrid(grid, grid))
    towards = np.stack(
        [np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=-1
    )
    searched = max(tip.resolution_at(field, one).resolution for one in towards)
    worst = tip.worst(field)
    assert searched <= worst.resolution + 1e-6
    assert searched == pytest.approx(worst.resolution, rel=0.01)
    assert worst.point[1] == 0.0  # between the longest axis, the third, and the shortest
    assert worst.direction[0] < 0.0 < worst.point[0]


def test_at_the_end_of_an_axis_the_normal_turns_along_an_ellipse() -> None:
    tip, half = EllipsoidTip((8.0, 8.0, 12.0)), 2.0
    turned = tip.resolution_at(2.0 * half, (0.0, 0.0, 1.0)).resolution / 2.0

    def radius(angle: float) -> float:  # of curvature of the ellipse, by the normal's angle
        extent = (12.0 * math.cos(angle)) ** 2 + (8.0 * math.sin(angle)) ** 2
        return float((8.0 * 12.0) ** 2 / extent**1.5)

    assert quad(radius, 0.0, turned)[0] == pytest.approx(half, rel=1e-6)


def test_sensors_are_counted_by_the_area() -> None:
    a, b, c = 6.0, 9.0, 13.0

    def element(polar: float, azimuth: float) -> float:
        x, y, z = (
            math.sin(polar) * math.cos(azimuth),
            math.sin(polar) * math.sin(azimuth),
            math.cos(polar),
        )
        return a * b * c * math.sqrt((x / a) ** 2 + (y / b) ** 2 + (z / c) ** 2) * math.sin(polar)

    half = dblquad(element, 0.0, 2.0 * math.pi, 0.0, math.pi / 2.0)[0]
    count = EllipsoidTip((a, b, c)).sensors_by_discs(1.0)
    assert count == math.ceil(half / (math.pi / 4.0))


def test_the_unit_and_the_order_of_the_axes_do_not_matter() -> None:
    expected = EllipsoidTip((8.0, 10.0, 12.0)).worst(4.0).resolution
    for semi_axes in ((12.0, 8.0, 10.0), (10.0, 12.0, 8.0)):
        assert EllipsoidTip(semi_axes).worst(4.0).resolution == pytest.approx(expected)
    assert EllipsoidTip((0.8, 1.0, 1.2)).worst(0.4).resolution == pytest.approx(expected)


@pytest.mark.parametrize(
    "semi_axes", [(1.0, 2.0), (0.0, 1.0, 1.0), (1.0, math.inf, 1.0), ("a", 1, 1), 3.0]
)
def test_semi_axes_must_be_three_lengths(semi_axes: object) -> None:
    with pytest.raises(SettingError, match="semi-axes of a fingertip must be three finite lengths"):
        EllipsoidTip(semi_axes)  # type: ignore[arg-type]


def test_bad_receptive_fields_and_directions_are_refused() -> None:
    tip = EllipsoidTip((3.0, 10.0, 10.0))
    assert tip.worst(0.9999 * tip.longest_field).resolution == pytest.approx(math.pi, rel=1e-3)
    with pytest.raises(
        SettingError, match=r"receptive field must be below 3.941 on this fingertip"
    ):
        tip.worst(4.0)
    for field in (0.0, math.nan, math.inf):
        with pytest.raises(SettingError, match="receptive field must be a finite length above 0"):
            tip.resolution_at(field, (0.0, 0.0, 1.0))
        with pytest.raises(SettingError, match="receptive field must be a finite length above 0"):
            tip.worst(field)
        with pytest.raises(SettingError, match="receptive field must be a finite length above 0"):
            tip.sensors_by_discs(field)
    for towards in ((0.0, 0.0, 0.0), (math.nan, 0.0, 1.0), (1.0, 2.0)):
        with pytest.raises(SettingError, match="a direction must be three finite numbers, not 0"):
            tip.resolution_at(1.0, towards)
