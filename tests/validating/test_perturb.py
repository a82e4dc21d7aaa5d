import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from grasp3d import GraspModel, Label, MeshOptions, MultifingerSampling, label_surface
from grasp3d.errors import MeshError, SettingError
from grasp3d.mesh.noisy_copies import MovableSurface, movable_surface
from grasp3d.validating.perturbing import NoiseSettings, Perturbation, perturb_surface
from grasp3d.validating.perturbing.perturb import angles_on, noisy_copies, turned_normals
from tests.helpers import shapes

OPTIONS = MeshOptions(unit="cm", max_edge=9.0)
FEW = NoiseSettings(noise=0.01, copies=6)


@cache
def clean() -> MovableSurface:
    """An egg-like body, without creases."""
    points, faces = shapes.lopsided(3)
    return movable_surface((points, faces), OPTIONS)


@cache
def found() -> Perturbation:
    return perturb_surface(clean(), noise=FEW)


@pytest.mark.slow
def test_fractions_of_every_vertex_add_up() -> None:
    one = found()
    np.testing.assert_allclose(one.stable + one.ambiguous + one.unstable, 1.0, atol=1e-12)
    assert (one.critical_angle_low <= one.critical_angle_high).all()
    assert one.settings.noise == 0.01
    assert not one.estimated
    assert all(array.shape == (len(one.mesh.vertices),) for array in one.columns().values())


@pytest.mark.slow
def test_they_count_the_labels_of_the_copies() -> None:
    copies = list(noisy_copies(clean(), 0.01, 0.0, 0, 6))
    labels = [label_surface(copy) for copy in copies]
    stable = np.mean([one.label == Label.S for one in labels], axis=0)
    np.testing.assert_array_equal(found().stable, stable)
    largest = np.max([one.critical_angle for one in labels], axis=0)
    np.testing.assert_allclose(
        found().critical_angle_high, largest, rtol=1e-6
    )  # 95 % of six is all


@pytest.mark.slow
def test_the_number_of_threads_and_of_copies_changes_no_copy() -> None:
    again = perturb_surface(clean(), noise=FEW)
    np.testing.assert_array_equal(again.stable, found().stable)
    assert again.advice == found().advice
    one = next(noisy_copies(clean(), 0.01, 0.02, 7, 1))
    two = next(noisy_copies(clean(), 0.01, 0.02, 7, 5))
    np.testing.assert_array_equal(one.vertices, two.vertices)
    other = next(noisy_copies(clean(), 0.01, 0.02, 8, 1))
    assert (one.vertices != other.vertices).any()


def test_hardly_any_noise_changes_nothing() -> None:
    quiet = perturb_surface(clean(), noise=NoiseSettings(noise=1e-9, copies=2))
    np.testing.assert_array_equal(quiet.stable, quiet.labels.label == Label.S)
    held = quiet.labels.label == Label.S
    assert (quiet.kept[held] == 1.0).all()
    assert quiet.advice.measured_turn < 1e-5
    assert quiet.advice.stable_fraction == pytest.approx(quiet.labels.fractions()["S"], abs=0.01)
    assert quiet.confirmed_fraction == pytest.approx(1.0, abs=1e-3)


@pytest.mark.slow
def test_more_noise_turns_normals_and_needs_more() -> None:
    errors = [
        perturb_surface(clean(), noise=NoiseSettings(noise=noise, copies=4)).advice.normal_error
        for noise in (0.001, 0.004, 0.016)
    ]
    assert errors == sorted(errors)
    assert errors[0] < errors[2] / 4.0


@pytest.mark.slow
def test_correlated_noise_turns_normals_less() -> None:
    white, alike = (
        perturb_surface(clean(), noise=replace(FEW, correlation=length, copies=3))
        for length in (0.0, 0.5)
    )
    assert alike.advice.measured_turn < 0.75 * white.advice.measured_turn
    assert np.median(alike.shift) == pytest.approx(np.median(white.shift), rel=0.5)


@pytest.mark.slow
def test_the_advised_errors_are_checked_with_new_labels() -> None:
    one = found()
    assert math.isfinite(one.advice.normal_error)
    labels = label_surface(one.mesh, one.model)
    areas, stable = one.mesh.vertex_areas, labels.label == Label.S
    assert areas[stable].sum() / areas.sum() == pytest.approx(one.advice.stable_fraction, abs=2e-3)
    failing = areas[stable & (one.stable < 0.95)].sum() / areas[stable].sum()
    assert failing == pytest.approx(one.advice.unconfirmed_fraction, abs=2e-3)
    assert failing <= 0.012
    assert one.advice.passed
    assert one.model.normal_error >= one.advice.measured_turn
    assert one.model.location_error >= one.shift_across > 0.0


def test_normals_that_turn_are_measured_at_smooth_vertices_and_creases() -> None:
    box = movable_surface(shapes.box(), MeshOptions(max_edge=0.5))
    turn = np.array(
        [[math.cos(0.1), -math.sin(0.1), 0.0], [math.sin(0.1), math.cos(0.1), 0.0], [0.0, 0.0, 1.0]]
    )
    copy = box.moved(box.points @ turn.T - box.points)
    angles = turned_normals(box.mesh, copy)
    # About the axis of rotation two faces do not turn, and sets at corners turn by less.
    on_top = (np.abs(box.mesh.normals[:, 2]) > 1.0 - 1e-9) & (box.mesh.normal_sets.counts == 1)
    assert angles[on_top].max() < 1e-9
    sides = (np.abs(box.mesh.normals[:, 2]) < 1e-9) & (box.mesh.normal_sets.counts == 1)
    np.testing.assert_allclose(angles[sides], 0.1, atol=1e-9)
    assert angles.max() < 0.1 + 1e-9


def test_grasps_are_evaluated_at_the_same_surface_points() -> None:
    labels = label_surface(clean().mesh)
    np.testing.assert_allclose(angles_on(clean().mesh, labels), labels.critical_angle, atol=1e-9)
    # A body that is stretched by 1 % everywhere has the same normals and lines.
    larger = clean().moved(0.01 * clean().points)
    np.testing.assert_allclose(angles_on(larger, labels), labels.critical_angle, atol=1e-9)


@pytest.mark.slow
def test_on_a_scan_of_known_noise_the_errors_make_labels_right() -> None:
    """Truth: the grasps that the labels of the scan name, on the body without noise."""
    points, faces = shapes.lopsided(3)
    body = movable_surface((points, faces), replace(OPTIONS, patch_radius=0.25))
    errors = np.random.default_rng(11).normal(0.0, 0.006, len(points))
    read = body.moved(errors[:, None] * body.normals)
    one = perturb_surface(
        (read.vertices, read.faces), noise=NoiseSettings(copies=12), options=body.mesh.options
    )
    assert one.estimated
    assert one.settings.noise == pytest.approx(0.006, rel=0.2)
    areas, limit = body.mesh.vertex_areas, GraspModel().effective_friction_angle

    def right(labels: object) -> float:
        stable = labels.label == Label.S  # type: ignore[attr-defined]
        true = angles_on(body.mesh, labels) < limit  # type: ignore[arg-type]
        return float(areas[stable & true].sum() / areas[stable].sum())

    advised = label_surface(one.mesh, one.model)
    assert right(advised) > 0.995 > right(one.labels)


@pytest.mark.slow
def test_three_fingers() -> None:
    ball = movable_surface(shapes.sphere(2), OPTIONS)
    one = perturb_surface(
        ball, GraspModel(fingers=3), sampling=MultifingerSampling(candidates=16),
        noise=NoiseSettings(noise=0.005, copies=3),
    )  # fmt: skip
    assert one.shift_across > 0.0
    assert one.stable.shape == (162,)


def test_lengths_of_no_use_are_refused() -> None:
    ball = shapes.sphere(1)
    with pytest.raises(SettingError, match=r"noise is 0.5, but the size .* at most 0.2"):
        perturb_surface(ball, noise=NoiseSettings(noise=0.5))
    with pytest.raises(MeshError, match="--noise"):
        perturb_surface(shapes.box(), options=MeshOptions(max_edge=0.5))


@pytest.mark.parametrize(
    "model",
    [
        GraspModel(method="extremes"),
        GraspModel(location_error=0.1),
        GraspModel(per_finger="normal_error=5;"),
    ],
)
def test_models_without_thresholds_are_refused(model: GraspModel) -> None:
    with pytest.raises(SettingError, match="noisy copies"):
        perturb_surface(clean(), model, noise=FEW)
