import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from grasp3d import GraspModel, Label, load_mesh, scan_surface
from grasp3d.errors import SearchCoverageError
from grasp3d.planar import Circle, Square
from grasp3d.stability.angle_distributions import (
    AngleDistribution,
    SampledAngles,
    SphereAngles,
    accuracy_ceiling,
)
from grasp3d.stability.label import label_angles, max_resolution, unstable_from
from tests.helpers import shapes

FRICTIONS = (0.05, 0.2, 0.5, 1.0)
RESOLUTIONS = tuple(np.radians([0.0, 5.0, 22.6, 40.0, 60.0]))

frictions = st.floats(0.05, 3.0)
resolutions = st.floats(0.0, 3.0)
area_fractions = st.floats(1e-3, 1.0)


@st.composite
def sampled(draw: st.DrawFn) -> SampledAngles:
    """Angles with ties, creases and samples without a grasp."""
    angle = st.one_of(st.floats(0.0, math.pi), st.sampled_from([0.0, 0.3, 0.5, math.inf]))
    rows = draw(st.lists(st.tuples(angle, angle, st.floats(0.01, 1.0)), min_size=1, max_size=12))
    first, second, weights = np.array(rows, dtype=np.float64).T
    return SampledAngles(
        worst=np.maximum(first, second),
        best=np.minimum(first, second),
        weights=weights / weights.sum(),
    )


@given(
    sampled(), st.one_of(st.floats(0.0, 1.0), st.integers(0, 12).map(lambda twelfth: twelfth / 12))
)
def test_quantiles_of_samples_are_those_of_the_bisection(
    angles: SampledAngles, fraction: float
) -> None:
    assert angles.worst_quantile(fraction) == AngleDistribution.worst_quantile(angles, fraction)


def distributions() -> st.SearchStrategy[AngleDistribution]:
    return st.one_of(sampled(), st.sampled_from([SphereAngles(), Circle(), Square()]))


@given(distributions(), frictions, resolutions)
def test_fractions_add_up_to_1(
    angles: AngleDistribution, friction: float, resolution: float
) -> None:
    fractions = angles.fractions(friction=friction, sensor_resolution=resolution)
    assert list(fractions) == ["S", "M", "U"]
    assert min(fractions.values()) >= -1e-12
    assert sum(fractions.values()) == pytest.approx(1.0, abs=1e-12)
    assert accuracy_ceiling(fractions) == pytest.approx(1.0 - fractions["M"] / 2.0, abs=1e-12)


def fraction_of(label: str, angles: AngleDistribution, friction: float, resolution: float) -> float:
    return angles.fractions(friction=friction, sensor_resolution=resolution)[label]


NEVER_RISES: dict[str, tuple[st.SearchStrategy[float], Callable[..., float]]] = {
    "S of coarser sensors": (resolutions, lambda angles, x, mu, _: fraction_of("S", angles, mu, x)),
    "U of coarser sensors": (resolutions, lambda angles, x, mu, _: fraction_of("U", angles, mu, x)),
    "no S at more friction": (frictions, lambda angles, x, _, a: -fraction_of("S", angles, x, a)),
    "U at more friction": (frictions, lambda angles, x, _, a: fraction_of("U", angles, x, a)),
    "resolution for more S": (
        area_fractions, lambda angles, x, mu, _: angles.required_resolution(x, friction=mu)
    ),
}  # fmt: skip
"""What a value is drawn from, and what does not rise with it at a friction and a resolution."""


@pytest.mark.parametrize("law", NEVER_RISES)
@given(st.data(), distributions(), frictions, resolutions)
def test_fractions_and_required_resolutions_are_monotone(
    law: str, data: st.DataObject, angles: AngleDistribution, friction: float, resolution: float
) -> None:
    values, result = NEVER_RISES[law]
    low, high = sorted(data.draw(st.tuples(values, values)))
    at_low, at_high = (result(angles, value, friction, resolution) for value in (low, high))
    assert at_high <= at_low + 1e-12


ON_THRESHOLD = SampledAngles(*np.full((2, 1), math.atan(0.5)), np.ones(1))


@given(sampled(), frictions, resolutions)
@example(ON_THRESHOLD, 0.5, 0.0)
def test_fractions_are_those_of_the_labels(
    angles: SampledAngles, friction: float, resolution: float
) -> None:
    model = GraspModel(friction=friction, sensor_resolution=resolution)
    labels = label_angles(angles.worst, angles.best, model)
    fractions = angles.fractions(friction=friction, sensor_resolution=resolution)
    for label in Label:
        assert fractions[label.name] == pytest.approx(
            angles.weights[labels == label].sum(), abs=1e-12
        )


@given(distributions(), area_fractions, frictions)
def test_the_fraction_is_stable_just_below_the_required_resolution_and_not_above(
    angles: AngleDistribution, fraction: float, friction: float
) -> None:
    needed = angles.required_resolution(fraction, friction=friction)

    def stable(resolution: float) -> float:
        return angles.fractions(friction=friction, sensor_resolution=resolution)["S"]

    if needed > 1e-6:
        assert stable(needed - 1e-7) >= fraction - 1e-9
    assert stable(needed + 1e-7) < fraction


@given(st.floats(0.01, 1.0), st.floats(0.0, 1.0))
def test_the_ambiguous_fraction_of_a_sphere_has_a_closed_form(
    friction: float, relative: float
) -> None:
    beta = math.atan(friction)
    tilt = relative * min(beta, math.pi / 2.0 - beta)
    fractions = SphereAngles().fractions(friction=friction, sensor_resolution=2.0 * tilt)
    assert fractions["M"] == pytest.approx(math.sin(2.0 * beta) * math.sin(2.0 * tilt), abs=1e-12)
    assert fractions["S"] == pytest.approx(math.sin(beta - tilt) ** 2, abs=1e-12)


def test_the_sphere_agrees_with_a_scan_of_one() -> None:
    scan = scan_surface(load_mesh(shapes.sphere(5)), fixed=(0.0, 0.0, 1.0))
    sampled_sphere = scan.angle_distribution()
    for friction in FRICTIONS:
        for resolution in RESOLUTIONS:
            assert sampled_sphere.fractions(friction=friction, sensor_resolution=resolution) == (
                pytest.approx(
                    SphereAngles().fractions(friction=friction, sensor_resolution=resolution),
                    abs=0.01,
                )
            )


def test_settings_beyond_the_search_are_refused() -> None:
    angles = SampledAngles(
        np.array([0.1, 0.6]), np.array([0.1, 0.6]), np.array([0.5, 0.5]), limit=0.4
    )
    assert angles.fractions(friction=math.tan(0.3), sensor_resolution=0.2)["S"] == 0.5
    with pytest.raises(SearchCoverageError, match=r"22\.9"):
        angles.fractions(friction=math.tan(0.3), sensor_resolution=0.3)
    assert angles.required_resolution(0.5, friction=1.0) == pytest.approx(math.pi / 2.0 - 0.2)
    assert angles.required_resolution(0.9, friction=0.3) == 0.0
    with pytest.raises(SearchCoverageError, match=r"22\.9"):
        angles.required_resolution(0.9, friction=1.0)
    # A search up to 90 degrees covers every setting.
    angles = SampledAngles(np.array([0.1]), np.array([0.1]), np.array([1.0]), limit=math.pi / 2.0)
    assert angles.fractions(friction=10.0, sensor_resolution=3.0) == {"S": 0.0, "M": 1.0, "U": 0.0}


any_angles = st.floats(-0.5, 2.0)


def label_of(worst: float, friction: float, resolution: float) -> int:
    model = GraspModel(friction=friction, sensor_resolution=resolution)
    return int(label_angles(np.array([worst]), np.array([worst]), model)[0])


@given(any_angles, frictions, resolutions)
def test_labels_are_thresholds_on_the_critical_angle(
    worst: float, friction: float, resolution: float
) -> None:
    beta, tilt = math.atan(friction), resolution / 2.0
    expected = Label.S if worst < beta - tilt else Label.U if worst >= beta + tilt else Label.M
    assert label_of(worst, friction, resolution) == expected


@given(any_angles, frictions, st.floats(0.0, 1.0))
def test_a_grasp_is_stable_below_its_coarsest_resolution_and_not_above(
    worst: float, friction: float, fraction: float
) -> None:
    model = GraspModel(friction=friction, sensor_resolution=0.0)
    coarsest = float(max_resolution(np.array([worst]), model)[0])
    if not 0.0 < coarsest < 3.1:  # resolutions are below pi
        return
    assert label_of(worst, friction, fraction * coarsest * (1.0 - 1e-9)) == Label.S
    assert label_of(worst, friction, coarsest * (1.0 + 1e-9)) != Label.S


def test_labels_at_a_threshold_at_a_crease_and_without_a_grasp() -> None:
    beta = math.atan(0.5)
    assert label_of(beta, 0.5, 0.0) == Label.U
    assert label_of(np.nextafter(beta, 0.0), 0.5, 0.0) == Label.S
    assert label_of(0.0, 0.5, 2.0 * beta) == Label.M
    model = GraspModel(friction=1.0, sensor_resolution=0.2)
    worst = np.array([1.5, 1.5, 0.1, math.inf])  # decides S
    best = np.array([0.0, 1.2, 0.1, math.inf])  # decides U
    found = label_angles(worst, best, model).tolist()
    assert found == [Label.M, Label.U, Label.S, Label.U]
    assert max_resolution(worst[-1:], model).tolist() == [0.0]


def test_three_fingers_are_never_u_from_90_degrees_on() -> None:
    assert unstable_from(1.0, 0.8, 2) == pytest.approx(1.8)
    assert unstable_from(1.0, 0.5, 3) == pytest.approx(1.5)
    assert unstable_from([1.0, 0.5], 0.8, 3) == pytest.approx([math.inf, 1.3])
    worst = np.array([0.1, 1.5, 2.0, math.inf])
    for fingers, expected in ((2, "MMUU"), (3, "MMMU")):
        model = GraspModel(friction=math.tan(1.0), sensor_resolution=1.8, fingers=fingers)
        labels = label_angles(worst, worst, model)
        assert labels.tolist() == [Label[letter] for letter in expected]
