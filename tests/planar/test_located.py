"""Planar grasps whose contact locations are uncertain: laws, sampling, attained limits."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from grasp3d import Contacts, GraspModel, Label, classify, load_mesh, scan_surface
from grasp3d.errors import SettingError
from grasp3d.planar import (
    Circle,
    Outline,
    OutlineContacts,
    Polyline,
    circle_fractions,
    regular_polygon,
    scan,
    square,
    square_fractions,
)
from grasp3d.planar.contacts import located_angles
from grasp3d.stability.angle_distributions import SphereAngles, critical_angle_below, worst_angle
from tests.helpers import shapes
from tests.planar.test_planar import HOOK, SQUARE, random_outline

Floats = NDArray[np.float64]

DEGREE = math.pi / 180.0
few = settings(max_examples=25, deadline=None)
seeds = st.integers(0, 100_000)
frictions = st.floats(0.05, 4.0)
resolutions = st.floats(0.0, 2.0)
locations = st.floats(0.0, 0.6)
errors = st.floats(0.0, 0.3)
MODELS = [
    GraspModel(friction=0.6, sensor_resolution=0.3, location_error=0.15),
    GraspModel(friction=(0.3, 0.9), sensor_resolution=0.2, normal_error=0.05, location_error=0.05),
    GraspModel(friction=3.0, sensor_resolution=1.2, location_error=0.3),
]


def turned(vectors: Floats, angle: Floats) -> Floats:
    """Vectors (..., 2) turned counter-clockwise."""
    x, y = vectors[..., 0], vectors[..., 1]
    return np.stack(
        [np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y], axis=-1
    )


def closed(points: Floats, normals: Floats, cones: Floats) -> NDArray[np.bool_]:
    """Force closure of two planar contacts (..., 2, 2) by the definition (Nguyen 1988)."""
    line = points[..., 1, :] - points[..., 0, :]
    line /= np.linalg.norm(line, axis=-1, keepdims=True)
    cosines = np.stack(
        [(normals[..., 0, :] * line).sum(axis=-1), -(normals[..., 1, :] * line).sum(axis=-1)]
    )
    off = np.arccos(np.clip(cosines, -1.0, 1.0))
    within = np.moveaxis(cones, -1, 0)
    return np.asarray((off < within).all(axis=0) | (math.pi - off < within).all(axis=0))


def true_grasps(
    contacts: Floats, normals: Floats, model: GraspModel, count: int, rng: np.random.Generator
) -> NDArray[np.bool_]:
    """Closure of random true grasps (k, count) of perceived ones; half of all errors are extreme.

    Args:
        contacts: Perceived points (k, 2, 2).
        normals: Perceived normals (k, 2, 2).
        model: What is known about them.
        count: True grasps of each.
        rng: Random numbers.
    """
    shape = (len(contacts), count, 2)

    def extreme(low: float) -> Floats:
        return np.where(rng.random(shape) < 0.5, rng.choice([low, 1.0], shape), rng.random(shape))

    radius = np.sqrt(np.abs(extreme(0.0))) * model.location_error
    direction = rng.uniform(0.0, 2.0 * math.pi, shape)
    shift = radius[..., None] * np.stack([np.cos(direction), np.sin(direction)], axis=-1)
    tilt = (
        np.where(
            rng.random(shape) < 0.5, rng.choice([-1.0, 1.0], shape), rng.uniform(-1.0, 1.0, shape)
        )
        * model.tilt
    )
    low, high = map(math.atan, model.friction_interval)
    cones = low + (high - low) * extreme(0.0)
    points = contacts[:, None] + shift
    return closed(points, turned(np.broadcast_to(normals[:, None], points.shape), tilt), cones)


def of_scan(outline: Outline, model: GraspModel, points: int) -> tuple[Any, Floats, Floats]:
    """A scan, and the perceived contacts and normals of the rows that are not corners."""
    found = scan(outline, model, points=points)
    rows = found.weights > 0.0
    contact_pairs = np.stack(
        [np.broadcast_to(found.points[0], (rows.sum(), 2)), found.points[rows]], axis=1
    )
    normals = np.stack(
        [np.broadcast_to(found.contacts.first[0], (rows.sum(), 2)), found.contacts.first[rows]],
        axis=1,
    )
    return found, contact_pairs, normals


# Attack: true contacts, normals and frictions within their bounds


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize(
    "outline",
    [Circle(fixed=1.0), square(), Polyline(HOOK, fixed=0.7), random_outline(1), random_outline(4)],
    ids=str,
)
def test_no_s_fails_and_no_u_holds_whatever_is_true(outline: Outline, model: GraspModel) -> None:
    found, contacts, normals = of_scan(outline, model, 90)
    label = found.label[found.weights > 0.0]
    if found.contacts.half_range[0] > 1e-9:
        pytest.skip("the fixed finger has a range of normals; see the sampled definition")
    held = true_grasps(contacts, normals, model, 400, np.random.default_rng(3))
    assert held[label == Label.S].all()
    assert not held[label == Label.U].any()


@pytest.mark.slow
@given(seeds, st.floats(0.02, 0.5), st.floats(0.1, 2.0))
@few
def test_limits_are_attained(seed: int, location: float, size: float) -> None:
    """The worst and the best true line of random contacts are found by a dense search."""
    rng = np.random.default_rng(seed)
    angles = rng.uniform(-math.pi, math.pi, (2, 40))
    points = size * rng.normal(size=(2, 40, 2))
    normals = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    for row in range(40):
        one, other = (OutlineContacts(points[k, [row]], *[normals[k, [row]]] * 2) for k in (0, 1))
        worst, best = located_angles(one, other, location)
        apart = points[1, row] - points[0, row]
        opening = float(np.hypot(*apart))
        turn = math.asin(min(1.0, location / opening))
        lines = math.atan2(apart[1], apart[0]) + np.linspace(-turn, turn, 4001)
        off = [np.abs(np.remainder(lines - angles[0, row] + math.pi, 2.0 * math.pi) - math.pi)]
        off += [np.abs(np.remainder(lines - angles[1, row], 2.0 * math.pi) - math.pi)]
        step = 2.0 * turn / 4000.0

        larger = np.minimum(
            np.maximum(off[0], off[1]), np.maximum(math.pi - off[0], math.pi - off[1])
        )

        searched = larger.min()
        assert max(searched, 0.0) - step <= best[0] <= max(searched, 0.0) + 1e-9
        searched = larger.max()
        assert worst[0] >= searched - 1e-9
        if worst[0] < math.pi / 2.0:
            assert worst[0] == pytest.approx(searched, abs=1e-9)


def witness(points: Floats, errors: Floats, turn: Floats) -> Floats:
    """True contacts (k, 2, 2) within the errors (2,) whose line is turned by an angle (k,)."""
    line = points[:, 1] - points[:, 0]
    opening = np.linalg.norm(line, axis=1, keepdims=True)
    across = turned(turned(line / opening, turn), np.full(len(line), 0.5 * math.pi))
    shift = opening * np.sin(turn)[:, None] * across
    assert (np.linalg.norm(shift, axis=1) <= errors.sum() + 1e-12).all()
    parts = (errors / errors.sum())[:, None] * np.array([[-1.0], [1.0]])
    return np.asarray(points + shift[:, None] * parts)


def test_witnesses_attain_both_limits() -> None:
    """Within 1e-6 of its limits a grasp has true contacts and normals that fail, or that hold."""
    rng = np.random.default_rng(11)
    count, tilt, errors = 400, 0.2, np.array([0.1, 0.2])
    angles = rng.uniform(-math.pi, math.pi, (count, 1)) + [0.0, math.pi]
    angles += rng.uniform(-0.5, 0.5, (count, 2))
    normals = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    reach = rng.uniform(0.5, 3.0, (count, 1)) * turned(normals[:, 0], rng.uniform(-0.5, 0.5, count))
    points = np.stack([np.zeros((count, 2)), reach], axis=1)
    worst, best = np.array(
        [
            located_angles(
                *(OutlineContacts(p[[k]], n[[k]], n[[k]]) for k in (0, 1)),
                errors.sum(),
            )
            for p, n in zip(points, normals, strict=True)
        ]
    )[..., 0].T
    assert (worst < math.pi / 2.0).sum() > 200
    eta = np.arcsin(np.minimum(1.0, errors.sum() / np.linalg.norm(reach, axis=1)))
    polar = np.arctan2(reach[:, 1], reach[:, 0])
    middle = 0.5 * np.angle(np.exp(1j * (angles - [0.0, math.pi] - polar[:, None]))).sum(axis=1)
    fails, holds = np.zeros((2, count), dtype=np.bool_)
    for turn in (-eta, eta, np.clip(middle, -eta, eta)):
        true = witness(points, errors, turn)
        line = true[:, 1] - true[:, 0]
        toward = np.arctan2(line[:, 1], line[:, 0])[:, None] + [0.0, math.pi]
        side = np.angle(np.exp(1j * (angles - toward)))  # of each normal from the line
        for limit, sign in ((worst, 1.0), (best, -1.0)):
            shift = np.where(side >= 0.0, sign, -sign) * tilt
            if sign < 0.0:  # not past the line
                shift = np.clip(-side, -tilt, tilt)
            tilted = turned(normals, shift)
            cones = np.repeat((limit + sign * (tilt - 1e-6))[:, None], 2, axis=1)
            found = closed(true, tilted, cones)
            if sign > 0.0:
                fails |= ~found
            else:
                holds |= found
    below = worst < math.pi / 2.0 - tilt
    assert fails[below].all()
    assert holds[best > tilt].all()


def test_on_a_circle_no_line_is_nearer_to_both_normals() -> None:
    model = GraspModel(friction=0.6, sensor_resolution=0.3, location_error=0.3)
    found = scan(Circle(2.0, fixed=1.0), model, points=360)
    worst, best = found.located_angles
    np.testing.assert_allclose(best[1:], found.critical_angle[1:], atol=1e-12)
    expected = worst_angle(found.critical_angle[1:], 0.15)
    np.testing.assert_allclose(worst[1:], np.minimum(expected, math.pi), atol=1e-9)


@pytest.mark.slow
@given(st.floats(0.0, 1.2), st.floats(0.0, math.pi / 2.0))
def test_the_worst_angle_has_its_inverse(ratio: float, angle: float) -> None:
    worst = worst_angle(angle, ratio)
    assert float(critical_angle_below(worst, ratio)) == pytest.approx(angle, abs=1e-7)


# Fractions in closed form against sampling


@pytest.mark.parametrize("location", [0.0, 0.01, 0.1, 0.3, 0.9, 1.5])
@pytest.mark.parametrize(("friction", "degrees"), [(1.0, 30.0), (0.3, 10.0), (3.0, 100.0)])
def test_the_closed_form_of_the_circle_agrees_with_the_labels_of_a_scan(
    location: float, friction: float, degrees: float
) -> None:
    model = GraspModel(
        friction=friction, sensor_resolution=degrees * DEGREE, location_error=location
    )
    found = scan(Circle(), model, points=4001).fractions()
    exact = circle_fractions(
        friction=friction, sensor_resolution=degrees * DEGREE, location_error=location
    )
    assert found == pytest.approx(exact, abs=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("friction", [0.7, (0.5, 0.9)])
@pytest.mark.parametrize("location", [0.05, 0.2])
def test_the_closed_form_of_the_circle_agrees_with_random_errors(
    friction: Any, location: float
) -> None:
    """Fractions of perceived grasps that hold under all, some or none of many true errors."""
    model = GraspModel(friction=friction, sensor_resolution=0.4, location_error=location)
    turn = (np.arange(1500) + 0.5) * (2.0 * math.pi / 1500)
    points = np.stack([np.broadcast_to([1.0, 0.0], (1500, 2)), turned(np.array([1.0, 0.0]), turn)])
    contacts = np.moveaxis(points, 0, 1)
    held = true_grasps(contacts, -contacts, model, 800, np.random.default_rng(8))
    sampled = {"S": held.all(axis=1).mean(), "U": 1.0 - held.any(axis=1).mean()}
    exact = circle_fractions(friction=friction, sensor_resolution=0.4, location_error=location)
    assert exact["S"] <= sampled["S"] <= exact["S"] + 0.02  # sampling misses some that fail
    assert exact["U"] <= sampled["U"] <= exact["U"] + 0.02


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("location", [0.02, 0.2])
def test_fractions_of_polygons_agree_with_the_angles_along_them(seed: int, location: float) -> None:
    outline = [square(), Polyline(HOOK, fixed=0.7)][seed] if seed < 2 else random_outline(seed)
    count = 6000
    contacts = outline.contacts_at((np.arange(count) + 0.5) * outline.perimeter / count)
    fixed = outline.contacts_at([outline.fixed])
    worst, best = located_angles(fixed, contacts, 2.0 * location)
    angles = np.radians(np.arange(3.0, 180.0, 4.0))
    found = outline.angle_distribution(location_error=location)
    for exact, sampled in ((found.worst_below(angles), worst), (found.best_below(angles), best)):
        counted = (sampled[:, None] < angles).mean(axis=0)
        np.testing.assert_allclose(exact, counted, atol=4e-3)


@pytest.mark.slow
@given(frictions, resolutions, st.floats(0.0, 1.5), st.floats(-20.0, 20.0))
@few
def test_all_forms_of_a_square_have_the_same_fractions(
    friction: float, resolution: float, location: float, fixed: float
) -> None:
    options = {
        "friction": friction,
        "sensor_resolution": resolution,
        "location_error": location,
    }
    own = square().fractions(**options)
    assert square_fractions(**options) == own
    assert Polyline(SQUARE, fixed=1.0).fractions(**options) == pytest.approx(own, abs=1e-9)
    assert regular_polygon(4).fractions(**options) == pytest.approx(
        square(math.sqrt(0.5)).fractions(**options), abs=1e-9
    )
    corners = square().corners[1:]
    fine = [corners[0], (1.0, 0.3), (1.0, 0.3), *corners[1:], corners[0]]
    one, other = (Polyline(line, fixed=fixed) for line in (corners, fine))
    assert one.fractions(**options) == pytest.approx(other.fractions(**options), abs=1e-9)
    double = {**options, "location_error": 2.0 * location}
    assert square(2.0).fractions(**double) == pytest.approx(own, abs=1e-9)


@given(seeds, frictions, resolutions)
@few
def test_a_tiny_location_error_changes_next_to_nothing(
    seed: int, friction: float, resolution: float
) -> None:
    outline = random_outline(seed)
    options: dict[str, Any] = {"friction": friction, "sensor_resolution": resolution}
    exact, tiny = (outline.fractions(**options, location_error=error) for error in (0.0, 1e-10))
    beta, tilt = math.atan(friction), resolution / 2.0
    if min(abs(beta + tilt - 0.5 * math.pi), abs(beta - tilt)) > 1e-6:  # there whole edges change
        assert tiny == pytest.approx(exact, abs=1e-6)


@pytest.mark.slow
def test_polygons_of_many_sides_approach_the_circle() -> None:
    options = {"friction": 0.8, "sensor_resolution": 0.3, "location_error": 0.12}
    found = regular_polygon(400).fractions(**options)
    assert found == pytest.approx(circle_fractions(**options), abs=6e-3)


# Laws


@pytest.mark.slow
@given(
    seeds,
    frictions,
    resolutions,
    st.tuples(locations, locations),
    st.tuples(errors, errors),
    st.tuples(errors, errors),
)
@few
def test_more_uncertainty_never_makes_a_grasp_surer(
    seed: int,
    friction: float,
    resolution: float,
    location: tuple[float, float],
    normal: tuple[float, float],
    relative: tuple[float, float],
) -> None:
    shapes = [random_outline(seed), Circle(), square()]
    for shape in [*shapes, SphereAngles()]:
        less, more = (
            shape.angle_distribution(location_error=location_error).fractions(
                friction=friction,
                sensor_resolution=resolution,
                friction_error=part * friction,
                normal_error=normal_error,
            )
            for location_error, normal_error, part in zip(
                sorted(location), sorted(normal), sorted(relative), strict=True
            )
        )
        assert more["S"] <= less["S"] + 1e-9
        assert more["U"] <= less["U"] + 1e-9
        assert sum(more.values()) == pytest.approx(1.0, abs=1e-9)


def test_without_further_errors_everything_is_the_same() -> None:
    for seed in range(6):
        outline = random_outline(seed)
        own = scan(outline, GraspModel(), points=90)
        np.testing.assert_array_equal(own.located_angles[0], own.critical_angle)
        np.testing.assert_array_equal(own.located_angles[1], own.critical_angle_best)
        moved = outline.contacts_about_center([outline.fixed])
        worst, best = located_angles(moved, own.contacts)
        np.testing.assert_allclose(worst[1:], own.critical_angle[1:], atol=1e-9)
        np.testing.assert_allclose(best[1:], own.critical_angle_best[1:], atol=1e-9)


def test_an_interval_of_friction_takes_s_from_the_smallest_and_u_from_the_largest() -> None:
    for outline in (Circle(), square(), random_outline(3)):
        low, high = (
            outline.fractions(friction=friction, sensor_resolution=0.3) for friction in (0.4, 0.8)
        )
        found = outline.fractions(friction=(0.4, 0.8), sensor_resolution=0.3)
        assert (found["S"], found["U"]) == pytest.approx((low["S"], high["U"]), abs=1e-12)
        same = outline.fractions(friction=0.6, sensor_resolution=0.3, friction_error=0.2)
        assert same == pytest.approx(found, abs=1e-9)
        wider = outline.fractions(friction=0.6, sensor_resolution=0.3, normal_error=0.1)
        assert wider == pytest.approx(outline.fractions(friction=0.6, sensor_resolution=0.5))


def test_required_resolution_makes_that_fraction_stable() -> None:
    for shape in (Circle(2.0), square(2.0), SphereAngles(radius=2.0)):
        located = shape.angle_distribution(location_error=0.1)
        options = {"friction": 1.0, "friction_error": 0.1, "normal_error": 0.05}
        alpha = located.required_resolution(0.2, **options)
        assert 0.0 < alpha < shape.angle_distribution().required_resolution(0.2, **options)
        found = located.fractions(sensor_resolution=alpha, **options)
        assert found["S"] == pytest.approx(0.2, abs=1e-7)


def test_the_margin_is_what_remains_of_friction() -> None:
    model = MODELS[1]
    found = scan(square(), model, points=90)
    expected = math.atan(0.3) - 0.15 - found.located_angles[0]
    np.testing.assert_allclose(found.margin[1:], expected[1:], atol=1e-9)
    assert found.margin[0] == -math.inf
    np.testing.assert_array_equal(found.label == Label.S, found.margin > 0.0)


# The sphere


@pytest.mark.parametrize("location", [0.05, 0.3])
def test_the_sphere_agrees_with_random_contacts(location: float) -> None:
    count = 40_000
    rng = np.random.default_rng(7)
    points = rng.normal(size=(count, 2, 3))
    points /= np.linalg.norm(points, axis=-1, keepdims=True)
    line = points[:, 1] - points[:, 0]
    opening = np.linalg.norm(line, axis=1)
    critical = np.arccos(np.clip(-(points[:, 0] * line).sum(axis=1) / opening, -1.0, 1.0))
    worst = critical + np.arcsin(np.minimum(1.0, 2.0 * location / opening))
    angles = SphereAngles(location)
    for angle in np.radians([5.0, 20.0, 45.0, 80.0, 110.0, 150.0]):
        error = 4.0 * 0.5 / math.sqrt(count)
        assert angles.worst_below(angle) == pytest.approx((worst < angle).mean(), abs=error)
        assert angles.best_below(angle) == pytest.approx((critical < angle).mean(), abs=error)


@pytest.mark.parametrize("location", [0.0, 0.05, 0.4])
def test_the_quantile_of_the_sphere_and_the_circle_is_the_inverse(location: float) -> None:
    for shape in (SphereAngles(location, 2.0), Circle(2.0).angle_distribution()):
        for fraction in (0.0, 0.01, 0.3, 0.7):
            angle = shape.worst_quantile(fraction)
            assert float(shape.worst_below(angle)) == pytest.approx(fraction, abs=1e-9)


# Hulls, and refused settings


def test_hulls_with_an_interval_of_friction_give_the_exact_labels() -> None:
    model = GraspModel(friction=(0.4, 0.8), sensor_resolution=0.3, normal_error=0.1)
    for outline in (Circle(), square(), random_outline(1)):
        found = scan(outline, model, points=90)
        beta = np.arctan([0.4, 0.8])
        near = np.abs(found.critical_angle - (beta[0] - model.tilt)) < 1e-6
        near |= np.abs(found.critical_angle_best - (beta[1] + model.tilt)) < 1e-6
        np.testing.assert_array_equal(found.label_extremes[~near], found.label[~near])
        rows = found.weights > 0.0
        np.testing.assert_array_equal(found.label_four[rows & ~near], found.label[rows & ~near])
        assert (found.epsilon_min <= found.epsilon).all()
        assert (found.epsilon <= found.epsilon_max).all()
        nominal = scan(outline, replace(model, friction=0.6, friction_error=0.0), points=90)
        np.testing.assert_array_equal(nominal.epsilon, found.epsilon)
        np.testing.assert_array_equal(nominal.epsilon_extremes, found.epsilon_extremes)


def test_hulls_refuse_uncertain_locations() -> None:
    located = scan(Circle(), MODELS[0], points=16)
    assert located.epsilon_min.max() > 0.0
    for name in ("label_extremes", "label_four"):
        with pytest.raises(SettingError, match="set location_error to 0"):
            getattr(located, name)


@pytest.mark.parametrize(
    ("model", "message"),
    [
        (GraspModel(location_error="2mm"), "must be a number in the unit"),
        (GraspModel(fingers=3, location_error=0.1), "planar grasps have two fingers"),
    ],
)
def test_models_that_no_outline_takes(model: GraspModel, message: str) -> None:
    with pytest.raises(SettingError, match=message):
        scan(Circle(), model)


@pytest.mark.parametrize("error", [-0.1, math.nan, math.inf])
def test_location_errors_out_of_range(error: float) -> None:
    for shape in (Circle(), square(), SphereAngles()):
        with pytest.raises(SettingError, match="location error must be a finite length"):
            shape.angle_distribution(location_error=error)


def test_texts_and_radii_out_of_range() -> None:
    wrong: Any = "2mm"
    with pytest.raises(SettingError, match="must be a number in the unit of its radius"):
        circle_fractions(friction=1.0, sensor_resolution=0.1, location_error=wrong)
    for radius in (0.0, math.nan, math.inf):
        with pytest.raises(SettingError, match="radius of a sphere"):
            SphereAngles(radius=radius)


# The same grasps in space


def in_space(vectors: Floats) -> Floats:
    return np.concatenate([vectors, np.zeros((*vectors.shape[:-1], 1))], axis=-1)


@pytest.mark.parametrize("outline", [Circle(), square(), random_outline(1), random_outline(4)])
def test_labels_agree_with_those_of_contacts_in_space(outline: Outline) -> None:
    """In space the line may also leave the plane, so U can only be rarer there."""
    model = GraspModel(friction=0.7, sensor_resolution=0.3, location_error=0.1)
    found, pairs, normals = of_scan(outline, model, 200)
    label = found.label[found.weights > 0.0]
    space = classify(
        Contacts(in_space(pairs), in_space(normals), 0.7), 0.3, location_error=0.1
    ).label
    np.testing.assert_array_equal(label == Label.S, space == Label.S)
    assert (label == Label.U)[space == Label.U].all()
    if isinstance(outline, Circle):
        np.testing.assert_array_equal(label, space)


@pytest.mark.slow
def test_the_sphere_agrees_with_a_scan_of_one() -> None:
    mesh = load_mesh(shapes.sphere(5))
    radius = float(np.linalg.norm(mesh.vertices, axis=1).max())
    model = GraspModel(
        friction=(0.5, 0.7), sensor_resolution=0.2, location_error=0.1 * radius, normal_error=0.05
    )
    found = scan_surface(mesh, model, fixed=(0.0, 0.0, radius)).fractions()
    exact = SphereAngles(0.1).fractions(
        friction=(0.5, 0.7), sensor_resolution=0.2, normal_error=0.05
    )
    assert found == pytest.approx(exact, abs=0.015)
