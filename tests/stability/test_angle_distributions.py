import math
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from grasp3d import (
    Contacts,
    GraspModel,
    Label,
    SurfaceLabels,
    critical_friction_angle,
    label_surface,
    load_mesh,
    scan_surface,
)
from grasp3d.errors import SearchCoverageError
from grasp3d.planar import Circle, Square
from grasp3d.stability.angle_distributions import (
    AngleDistribution,
    SampledAngles,
    SphereAngles,
    accuracy_ceiling,
)
from grasp3d.stability.label import label_angles
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


@cache
def labelled(name: str) -> SurfaceLabels:
    mesh = load_mesh(shapes.LIBRARY / name)
    return label_surface(mesh, GraspModel(friction=1.0, sensor_resolution=math.radians(60.0)))


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


@given(sampled(), frictions, resolutions)
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


@pytest.mark.slow
@pytest.mark.parametrize("weights", ["area", "vertex"])
@pytest.mark.parametrize("name", ["bowl.ply", "wrench.glb"])
def test_a_surface_has_the_fractions_of_its_labels(name: str, weights: str) -> None:
    labels = labelled(name)
    angles = labels.angle_distribution(weights=weights)  # type: ignore[arg-type]
    for friction in FRICTIONS:
        for resolution in RESOLUTIONS:
            again = labels.relabel(friction=friction, sensor_resolution=resolution)
            assert angles.fractions(friction=friction, sensor_resolution=resolution) == (
                pytest.approx(again.fractions(weights=weights), abs=1e-12)  # type: ignore[arg-type]
            )


@pytest.mark.slow
@pytest.mark.parametrize("fraction", [0.25, 0.5, 0.9])
def test_the_required_resolution_is_where_the_labels_of_a_surface_change(fraction: float) -> None:
    labels = labelled("bowl.ply")
    for friction in (0.2, 0.5):
        needed = labels.angle_distribution().required_resolution(fraction, friction=friction)
        below, above = (
            labels.relabel(friction=friction, sensor_resolution=needed + step).fractions()["S"]
            for step in (-1e-9, 1e-9)
        )
        assert below >= fraction > above


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


@given(sampled(), area_fractions)
def test_quantiles_are_those_of_the_sorted_angles(angles: SampledAngles, fraction: float) -> None:
    order = np.argsort(angles.worst)
    cumulative = np.cumsum(angles.weights[order])
    assume(np.abs(cumulative - fraction).min() > 1e-8)
    expected = (
        angles.worst[order][np.searchsorted(cumulative, fraction)]
        if fraction < cumulative[-1]
        else None
    )
    assume(expected is not None)
    found = angles.worst_quantile(fraction)
    assert found == pytest.approx(expected, abs=1e-9)


@given(area_fractions)
def test_the_quantile_by_bisection_equals_the_closed_form(fraction: float) -> None:
    for shape in (SphereAngles(), Circle()):
        assert AngleDistribution.worst_quantile(shape, fraction) == pytest.approx(
            shape.worst_quantile(fraction), abs=2e-6
        )


@given(st.floats(0.01, 1.0), st.floats(0.0, 1.0))
def test_the_ambiguous_fraction_of_a_sphere_has_a_closed_form(
    friction: float, relative: float
) -> None:
    beta = math.atan(friction)
    tilt = relative * min(beta, math.pi / 2.0 - beta)
    fractions = SphereAngles().fractions(friction=friction, sensor_resolution=2.0 * tilt)
    assert fractions["M"] == pytest.approx(math.sin(2.0 * beta) * math.sin(2.0 * tilt), abs=1e-12)
    assert fractions["S"] == pytest.approx(math.sin(beta - tilt) ** 2, abs=1e-12)


def test_the_sphere_agrees_with_random_pairs_on_it() -> None:
    count = 40_000
    random = np.random.default_rng(7)
    points = random.normal(size=(count, 2, 3))
    points /= np.linalg.norm(points, axis=-1, keepdims=True)
    angles = critical_friction_angle(Contacts(points, -points, 1.0))
    for friction in FRICTIONS:
        for resolution in RESOLUTIONS:
            model = GraspModel(friction=friction, sensor_resolution=resolution)
            labels = label_angles(angles, angles, model)
            exact = SphereAngles().fractions(friction=friction, sensor_resolution=resolution)
            for label in Label:
                fraction = exact[label.name]
                error = 4.0 * math.sqrt(fraction * (1.0 - fraction) / count) + 1e-12
                assert np.mean(labels == label) == pytest.approx(fraction, abs=error)


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


def test_a_search_up_to_90_degrees_covers_every_setting() -> None:
    angles = SampledAngles(np.array([0.1]), np.array([0.1]), np.array([1.0]), limit=math.pi / 2.0)
    assert angles.fractions(friction=10.0, sensor_resolution=3.0) == {"S": 0.0, "M": 1.0, "U": 0.0}
