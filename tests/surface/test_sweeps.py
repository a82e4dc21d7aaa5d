import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp3d import GraspModel
from grasp3d.errors import SearchCoverageError, SettingError
from grasp3d.planar import Circle, Square
from grasp3d.stability.angle_distributions import AngleDistribution, SampledAngles, SphereAngles
from grasp3d.surface.sweeps import mean_sweep, sweep, write_sweeps
from tests.stability.test_angle_distributions import sampled

frictions = st.lists(st.floats(0.05, 3.0), min_size=1, max_size=4)
resolutions = st.lists(st.floats(0.0, 3.0), min_size=1, max_size=6)
SPHERE = sweep(
    SphereAngles(), friction=[0.2, 1.0], sensor_resolution=np.radians([0.0, 22.6, 60.0]),
    name="sphere", mode="scan",
)  # fmt: skip


def every() -> st.SearchStrategy[AngleDistribution]:
    closed: list[AngleDistribution] = [SphereAngles(), Circle(), Square()]
    return st.one_of(sampled(), st.sampled_from(closed))


@pytest.mark.slow
@given(every(), frictions, resolutions)
def test_each_entry_of_the_grid_agrees_with_the_distribution(
    angles: AngleDistribution, friction: list[float], resolution: list[float]
) -> None:
    swept = sweep(angles, friction=friction, sensor_resolution=resolution)
    assert swept.friction.tolist() == sorted(set(friction))
    assert swept.sensor_resolution.tolist() == sorted(set(resolution))
    for row, mu in enumerate(swept.friction):
        for column, alpha in enumerate(swept.sensor_resolution):
            alone = angles.fractions(friction=float(mu), sensor_resolution=float(alpha))
            swept_values = (swept.stable, swept.ambiguous, swept.unstable)
            found = [values[row, column] for values in swept_values]
            assert found == pytest.approx(list(alone.values()), abs=1e-12)  # arctan of arrays
    for fraction in (0.3, 1.0):
        needed = [angles.required_resolution(fraction, friction=float(mu)) for mu in swept.friction]
        assert swept.required_resolution(fraction) == pytest.approx(needed, abs=1e-12)


@pytest.mark.slow
@settings(deadline=None, max_examples=40)
@given(st.lists(every(), min_size=1, max_size=4), frictions, resolutions)
def test_the_mean_gives_every_surface_the_same_weight(
    parts: list[AngleDistribution], friction: list[float], resolution: list[float]
) -> None:
    sweeps = [sweep(part, friction=friction, sensor_resolution=resolution) for part in parts]
    mean = mean_sweep(sweeps, name="mean")
    for field in ("stable", "ambiguous", "unstable", "accuracy_ceiling"):
        expected = np.mean([getattr(one, field) for one in sweeps], axis=0)
        assert getattr(mean, field) == pytest.approx(expected, abs=1e-12)
    needed = mean.required_resolution(0.5)
    each = np.array([one.required_resolution(0.5) for one in sweeps])
    assert (needed <= each.max(axis=0) + 1e-9).all()
    assert (needed >= each.min(axis=0) - 1e-9).all()


def test_the_mean_needs_the_same_grid() -> None:
    other = sweep(SphereAngles(), friction=0.3, sensor_resolution=0.1, name="odd", mode="scan")
    with pytest.raises(SettingError, match="'odd' differs from 'sphere'"):
        mean_sweep([SPHERE, other])
    with pytest.raises(SettingError, match="at least one"):
        mean_sweep([])


def test_a_grid_beyond_what_was_searched_is_refused() -> None:
    model = GraspModel(friction=0.5, sensor_resolution=0.2)
    narrow = model.friction_angle + model.tilt
    angles = SampledAngles(np.array([0.1]), np.array([0.1]), np.array([1.0]), limit=narrow)
    assert sweep(angles, friction=[0.1, 0.5], sensor_resolution=[0.0, 0.2]).stable.shape == (2, 2)
    with pytest.raises(SearchCoverageError, match="searched only up to 32"):
        sweep(angles, friction=[0.1, 0.5], sensor_resolution=[0.0, 0.3])


def test_parquet_contains_the_fractions_the_failures_and_the_settings(tmp_path: Path) -> None:
    path = tmp_path / "sweep.parquet"
    circle = sweep(Circle(), friction=0.5, sensor_resolution=0.1, name="circle", mode="scan")
    write_sweeps(
        path, [SPHERE, circle], fractions=(0.2, 0.125), failures={"bad.stl": "no triangles"},
        settings={"rays": 64},
    )  # fmt: skip
    table = pq.read_table(path)
    assert json.loads(table.schema.metadata[b"grasp3d"]) == {"rays": 64}
    *rows, failed = table.to_pylist()
    assert [row["name"] for row in rows] == ["sphere"] * 6 + ["circle"]
    for row, (index, stable) in zip(rows, np.ndenumerate(SPHERE.stable), strict=False):
        friction, resolution = SPHERE.friction[index[0]], SPHERE.sensor_resolution[index[1]]
        assert (row["friction"], row["sensor_resolution"]) == (friction, resolution)
        assert (row["stable"], row["ambiguous"]) == (stable, SPHERE.ambiguous[index])
        assert (row["unstable"], row["mode"], row["error"]) == (SPHERE.unstable[index], "scan", "")
        assert row["accuracy_ceiling"] == SPHERE.accuracy_ceiling[index]
        assert row["required_resolution_12.5"] == SPHERE.required_resolution(0.125)[index[0]]
    assert (failed.pop("name"), failed.pop("error")) == ("bad.stl", "no triangles")
    assert set(failed.values()) == {None}


def test_the_mean_is_limited_to_what_every_surface_was_searched_for() -> None:
    one, whole = np.array([0.1]), np.array([1.0])
    far, near = (
        sweep(SampledAngles(one, one, whole, limit=limit), friction=0.2, sensor_resolution=0.1)
        for limit in (1.0, 0.3)
    )
    for pair in ([far, near], [near, far]):
        mean = mean_sweep(pair)
        assert mean.distribution.limit == 0.3
        with pytest.raises(SearchCoverageError):
            sweep(mean.distribution, friction=0.5, sensor_resolution=0.1)
