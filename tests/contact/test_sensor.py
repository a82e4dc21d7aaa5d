import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.spatial.transform import Rotation

import grasp3d
from grasp3d.contact.contacts import effective_friction
from grasp3d.contact.sensor import Sensor, required_counts, resolution_limit
from grasp3d.errors import SettingError

radii = st.floats(1e-3, 1e3)
resolutions = st.floats(1e-6, 3.1)
openings = st.floats(1e-2, 1e4)
frictions = st.floats(1e-3, 20.0)
tips = st.one_of(radii, st.just(math.inf))


@st.composite
def sensors(draw: st.DrawFn) -> Sensor:
    """Round and flat fingertips."""
    radius = draw(tips)
    if math.isinf(radius):
        return Sensor(draw(st.floats(1e-3, 1e3)), radius)
    return Sensor.for_resolution(draw(resolutions), radius)


@given(frictions, radii)
def test_the_limiting_sensor_without_locations_is_the_bound_of_the_paper(
    friction: float, radius: float
) -> None:
    sensor = Sensor.limiting(friction, radius)
    assert sensor.receptive_field == pytest.approx(sensor.resolution * radius, rel=1e-15)
    assert sensor.tilt == sensor.resolution / 2.0
    assert sensor.resolution == pytest.approx(resolution_limit(friction), rel=1e-14)
    assert sensor.required_friction == pytest.approx(friction, rel=1e-12)


@given(sensors(), openings)
def test_effective_friction_is_zero_at_the_required_friction_and_positive_above(
    sensor: Sensor, opening: float
) -> None:
    for needed, angle in (
        (sensor.required_friction, sensor.resolution),
        (sensor.required_friction_at(opening), 2.0 * sensor.misalignment(opening)),
    ):
        assume(needed < 1e6)
        assert effective_friction(needed, angle) == pytest.approx(0.0, abs=1e-9)
        assert effective_friction(1.001 * needed + 1e-6, angle) > 0.0


def contacts_within(
    sensor: Sensor, opening: float, tilts: np.ndarray, turns: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Contacts of two opposing fingers (k, 2, 3) at angles on their tips, in turns about x."""
    inward = np.array([1.0, -1.0])
    tangential = np.stack([np.zeros_like(turns), np.cos(turns), np.sin(turns)], axis=-1)
    along = np.array([1.0, 0.0, 0.0])
    if sensor.flat:
        normals = np.broadcast_to(inward[:, None] * along, tangential.shape)
        return -0.5 * opening * normals + tilts[..., None] * tangential, normals
    radius = sensor.fingertip_radius
    cosines, sines = np.cos(tilts)[..., None], np.sin(tilts)[..., None]
    normals = inward[:, None] * cosines * along + sines * tangential
    centers = -inward[:, None] * (opening / 2.0 + radius) * along
    return centers + radius * normals, normals


@pytest.mark.parametrize(
    ("sensor", "opening"),
    [
        (Sensor(9.0, 10.0), 20.0),
        (Sensor(9.0, 10.0), 300.0),
        (Sensor(0.5, 10.0), 2.0),
        (Sensor(6.0, math.inf), 30.0),
        (Sensor(6.0, math.inf), 2.0),
    ],
)
def test_misalignment_is_the_largest_critical_angle_of_indistinguishable_grasps(
    sensor: Sensor, opening: float
) -> None:
    rng = np.random.default_rng(7)
    largest = sensor.location_uncertainty if sensor.flat else sensor.tilt
    tilts = largest * np.sqrt(rng.uniform(size=(4000, 2)))
    turns = rng.uniform(0.0, 2.0 * math.pi, size=(4000, 2))
    tilts[0], turns[0] = largest, (0.0, math.pi)  # the ends of both fields, on opposite sides
    points, normals = contacts_within(sensor, opening, tilts, turns)
    angles = grasp3d.critical_friction_angle(grasp3d.Contacts(points, normals, friction=0.5))
    assert angles[0] == pytest.approx(sensor.misalignment(opening), abs=1e-12)
    assert angles.max() <= sensor.misalignment(opening) + 1e-12
    lines = points[:, 1] - points[:, 0]
    turned = np.arctan2(np.linalg.norm(lines[:, 1:], axis=1), lines[:, 0])
    assert turned[0] == pytest.approx(sensor.line_error(opening), abs=1e-12)
    assert turned.max() <= sensor.line_error(opening) + 1e-12


def test_no_line_turns_past_the_common_tangent_of_both_tips() -> None:
    sensor, opening = Sensor(28.0, 10.0), 4.0  # a tilt of 80 degrees on a thin plate
    tilts = np.stack(np.meshgrid(*2 * [np.linspace(0.0, sensor.tilt, 801)]), -1).reshape(-1, 2)
    points, _ = contacts_within(sensor, opening, tilts, np.full_like(tilts, [0.0, math.pi]))
    lines = points[:, 1] - points[:, 0]
    turned = np.arctan2(-lines[:, 1], lines[:, 0]).max()
    assert sensor.line_error(opening) == pytest.approx(turned, abs=1e-6)
    assert sensor.line_error(opening) == pytest.approx(math.asin(10.0 / 12.0))
    assert sensor.misalignment(opening) > math.pi / 2.0
    assert math.isinf(sensor.required_friction_at(opening))


@given(resolutions)
def test_numbers_of_sensors_are_areas_rounded_up(resolution: float) -> None:
    sensor = Sensor.for_resolution(resolution, 3.0)
    hemisphere = 2.0 * math.pi * 3.0**2
    disc = math.pi * (sensor.receptive_field / 2.0) ** 2
    cap = quad(lambda a: 2.0 * math.pi * 3.0**2 * math.sin(a), 0.0, resolution / 2.0)[0]
    for count, area in ((sensor.sensors_by_discs, disc), (sensor.sensors_by_caps, cap)):
        assert count is not None
        assert count * area >= hemisphere * (1.0 - 1e-9)
        assert (count - 1) * area < hemisphere * (1.0 + 1e-9)
    assert sensor.sensors_by_caps is not None
    assert sensor.sensors_by_discs is not None
    assert 0 <= sensor.sensors_by_caps - sensor.sensors_by_discs <= 1


def test_exact_coverage_is_not_rounded_up() -> None:
    for count in range(2, 400):
        discs = Sensor.for_resolution(math.sqrt(8.0 / count), 7.0)
        assert discs.sensors_by_discs == count
        caps = Sensor.for_resolution(2.0 * math.acos(1.0 - 1.0 / count), 7.0)
        assert caps.sensors_by_caps == count


def test_the_numbers_of_the_paper() -> None:
    half = Sensor.limiting(0.5, 10.0)
    assert math.degrees(half.resolution) == pytest.approx(53.13010235415598, rel=1e-14)
    assert half.receptive_field == pytest.approx(20.0 * math.atan(0.5), rel=1e-14)
    assert (half.sensors_by_discs, half.sensors_by_caps) == (10, 10)
    fifth = Sensor.limiting(0.2, 10.0)
    assert math.degrees(fifth.resolution) == pytest.approx(22.619864948040426, rel=1e-14)
    assert (fifth.sensors_by_discs, fifth.sensors_by_caps) == (52, 52)
    assert Sensor(4.0, 10.0).sensors_by_discs == 50  # 3.95 mm rounded to 4, as in the paper


def test_a_flat_fingertip_has_one_normal_and_an_uncertain_location() -> None:
    sensor = Sensor(4.0, math.inf)
    assert (sensor.flat, sensor.resolution, sensor.tilt) == (True, 0, 0)
    assert sensor.location_uncertainty == 2.0
    assert sensor.required_friction == 0.0
    assert sensor.required_friction_at(20.0) == pytest.approx(0.2)
    assert sensor.line_error(20.0) == pytest.approx(math.atan(0.2))
    assert (sensor.sensors_by_discs, sensor.sensors_by_caps) == (None, None)


def test_extreme_receptive_fields() -> None:
    for field, radius in ((1e-300, 1.0), (1e-300, 1e300), (5e-324, 1e308), (1.0, 1e308)):
        tiny = Sensor(field, radius)
        assert (tiny.sensors_by_discs, tiny.sensors_by_caps) == (None, None)
        assert 0.0 <= tiny.misalignment(10.0) <= math.atan(0.1 * field) * (1.0 + 1e-6) + 1e-300
    near = Sensor(1e-9, 1.0)
    assert near.sensors_by_discs == pytest.approx(8e18)
    half_way = Sensor(math.nextafter(math.pi, 0.0), 1.0)
    assert (half_way.sensors_by_discs, half_way.sensors_by_caps) == (1, 1)
    assert half_way.required_friction > 1e15
    assert math.isinf(half_way.required_friction_at(1.0))


@given(st.integers(1, 4), frictions, resolutions, st.integers(0, 10_000))
def test_encoders_of_the_required_counts_turn_no_normal_out_of_the_friction_cone(
    joints: int, friction: float, resolution: float, seed: int
) -> None:
    margin = math.atan(friction) - resolution / 2.0
    counts = required_counts(joints, friction, resolution)
    assert required_counts(joints, friction, resolution_limit(friction)) is None
    if counts is None:
        assert margin <= 1e-12
        return
    error = math.pi / counts
    assert joints * error < margin
    assert counts == 1 or joints * math.pi / (counts - 1) >= margin * (1.0 - 1e-9)
    axes = np.random.default_rng(seed).normal(size=(joints, 3))
    turns = [Rotation.from_rotvec(error * axis / np.linalg.norm(axis)) for axis in axes]
    assert math.prod(turns, start=Rotation.identity()).magnitude() < margin


@pytest.mark.parametrize(
    ("make", "values", "message"),
    [
        (lambda field: Sensor(field, 10.0), (0.0, -1.0, math.nan, math.inf),
         "receptive field must be a finite length above 0; got"),
        (lambda radius: Sensor(1.0, radius), (0.0, -2.0, math.nan),
         "fingertip radius must be above 0, inf for flat; got"),
        (lambda field: Sensor(field, 10.0), (10.0 * math.pi, 40.0),
         "must be shorter than half the fingertip's circumference, pi x 10 = 31.42; got"),
        (lambda resolution: Sensor.for_resolution(resolution, 10.0),
         (0.0, -0.1, math.pi, math.nan, 22.6), "above 0 and below 180 degrees"),
        (lambda radius: Sensor.for_resolution(0.3, radius), (math.inf,),
         "its resolution is 0; give its receptive field"),
        (lambda joints: required_counts(int(joints), 0.5), (0, -1), "at least one joint; got"),
        (lambda friction: Sensor.limiting(friction, 10.0), (0.0, -0.5, math.nan, math.inf),
         "friction must be a finite number above 0"),
        *[
            (function, (0.0, -1.0, math.nan), "distance between two fingers must be above 0")
            for function in (
                Sensor(4.0, 10.0).line_error, Sensor(4.0, 10.0).required_friction_at,
            )
        ],
    ],
)  # fmt: skip
def test_values_out_of_range_are_refused(
    make: Callable[[float], object], values: tuple[float, ...], message: str
) -> None:
    for value in values:
        with pytest.raises(SettingError, match=message):
            make(value)
