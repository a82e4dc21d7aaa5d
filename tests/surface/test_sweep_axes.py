"""Sweeps over other uncertainties than friction and sensor resolution."""

import math
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp3d import GraspModel
from grasp3d.errors import SearchCoverageError, SettingError
from grasp3d.planar import Circle
from grasp3d.settings.lengths import Measure
from grasp3d.stability.angle_distributions import AngleDistribution, SampledAngles, SphereAngles
from grasp3d.surface.sweeps import Sweep, mean_sweep, sweep, write_sweeps
from grasp3d.surface.sweeps.axes import NAMES, AxisName, axis_values, describe_value

SEVERAL: dict[AxisName, list[float]] = {
    "friction": [0.4, 0.8],
    "friction_error": [0.0, 0.1, 0.3],
    "normal_error": [0.0, 0.05],
    "location_error": [0.0, 0.02, 0.2],
    "sensor_resolution": [0.0, 0.3],
}
ONE = {name: values[0] for name, values in SEVERAL.items()}
PAIRS = list(combinations(NAMES, 2))


class Grasps:
    """A surface of a few grasps of two fingers, whose location error turns their lines."""

    def __init__(self, angles: list[float], opening: float = 1.0) -> None:
        self._angles, self._opening = np.array(angles), opening
        self.asked: list[Any] = []

    def angle_distribution(self, *, location_error: Any) -> SampledAngles:
        self.asked.append(location_error)
        number = float(str(location_error).split()[0])
        turn = math.asin(min(1.0, 2.0 * number / self._opening))
        count = len(self._angles)
        return SampledAngles(self._angles + turn, self._angles, np.full(count, 1.0 / count))


def expected(angles: AngleDistribution, model: GraspModel) -> dict[str, float]:
    """Fractions by the definition of the labels: S by the smallest friction, U by the largest."""
    stable = float(angles.worst_below(model.effective_friction_angle))
    unstable = 1.0 - float(angles.best_below(model.unstable_from))
    return {"stable": stable, "ambiguous": 1.0 - stable - unstable, "unstable": unstable}


@pytest.mark.parametrize("pair", PAIRS)
def test_every_two_uncertainties_can_be_the_axes(pair: tuple[AxisName, AxisName]) -> None:
    values: dict[str, Any] = ONE | {name: SEVERAL[name] for name in pair}
    swept = sweep(SphereAngles(), **values)
    assert (swept.rows, swept.columns) == pair
    assert swept.stable.shape == tuple(len(SEVERAL[name]) for name in pair)
    for row, first in enumerate(SEVERAL[pair[0]]):
        for column, second in enumerate(SEVERAL[pair[1]]):
            here: dict[Any, Any] = ONE | {pair[0]: first, pair[1]: second}
            known = expected(SphereAngles(here["location_error"]), GraspModel(**here))
            for field, value in known.items():
                assert getattr(swept, field)[row, column] == pytest.approx(value, abs=1e-14)


@given(
    st.lists(st.floats(-0.2, 1.2), min_size=1, max_size=20),
    st.lists(st.floats(0.0, 0.4), min_size=1, max_size=4),
    st.lists(st.floats(0.0, 0.6), min_size=1, max_size=4),
)
def test_more_uncertainty_never_makes_more_of_a_surface_certain(
    angles: list[float], locations: list[float], normals: list[float]
) -> None:
    swept = sweep(
        Grasps(angles),
        friction=0.7,
        sensor_resolution=0.2,
        friction_error=0.05,
        normal_error=normals,
        location_error=locations,
    )
    by = {name: 1 if swept.columns == name else 0 for name in ("normal_error", "location_error")}
    for axis in by.values():
        assert (np.diff(swept.stable, axis=axis) <= 0.0).all()
        assert (np.diff(swept.unstable, axis=axis) <= 0.0).all()
        assert (np.diff(swept.ambiguous, axis=axis) >= -1e-12).all()


@pytest.mark.parametrize("pair", [pair for pair in PAIRS if "sensor_resolution" not in pair])
def test_just_below_the_required_resolution_the_fraction_is_stable(
    pair: tuple[AxisName, AxisName],
) -> None:
    values: dict[str, Any] = ONE | {name: SEVERAL[name] for name in pair}
    required = sweep(Circle(), **values).required_resolution(0.2)
    assert required.shape == tuple(len(SEVERAL[name]) for name in pair)
    for (row, column), alpha in np.ndenumerate(required):
        here: dict[Any, Any] = ONE | {pair[0]: SEVERAL[pair[0]][row]}
        here |= {pair[1]: SEVERAL[pair[1]][column]}
        fine = sweep(Circle(), **here | {"sensor_resolution": max(0.0, alpha - 1e-6)})
        coarse = sweep(Circle(), **here | {"sensor_resolution": alpha + 1e-6})
        assert coarse.stable.item() < 0.2
        assert (fine.stable.item() >= 0.2) == (alpha > 0.0)


def test_the_required_resolution_by_row_counts_the_other_errors() -> None:
    given: dict[str, Any] = {"friction": 0.5, "friction_error": [0.0, 0.1], "normal_error": 0.02}
    swept = sweep(Grasps([0.1, 0.2]), sensor_resolution=[0.0, 0.1], location_error=0.05, **given)
    turn = math.asin(0.1)
    assert swept.required_resolution(1.0) == pytest.approx(
        [2.0 * (math.atan(friction) - 0.2 - turn - 0.02) for friction in (0.5, 0.4)]
    )


def test_locations_with_a_unit_reach_the_labels() -> None:
    grasps, lengths = Grasps([0.1]), list[float | str](["0.2 cm", 0.0, "1mm", "2 mm"])
    swept = sweep(grasps, friction=0.5, sensor_resolution=0.1, location_error=lengths)
    assert grasps.asked == [0.0, Measure(0.1, "cm"), Measure(0.2, "cm")]
    assert (swept.unit, swept.location_error.tolist()) == ("cm", [0.0, 0.1, 0.2])
    assert describe_value("location_error", 0.1, swept.unit) == "0.1 cm"


def test_critical_angles_alone_are_for_one_location_error() -> None:
    angles = SampledAngles(np.array([0.1]), np.array([0.1]), np.array([1.0]))
    assert sweep(angles, friction=0.5, sensor_resolution=0.1).location_error.tolist() == [0.0]
    with pytest.raises(SettingError, match="give the labels instead"):
        sweep(angles, friction=0.5, sensor_resolution=0.1, location_error=[0.0, 0.1])
    of_its_own = sweep(SphereAngles(0.1), friction=0.5, sensor_resolution=0.1)
    assert of_its_own.location_error.tolist() == [0.1]
    assert of_its_own.stable < sweep(SphereAngles(), friction=0.5, sensor_resolution=0.1).stable


def test_the_search_must_cover_the_largest_friction_and_all_tilts() -> None:
    angles = SampledAngles(np.array([0.1]), np.array([0.1]), np.array([1.0]), limit=0.6)
    sweep(angles, friction=0.5, sensor_resolution=0.2)
    with pytest.raises(SearchCoverageError):
        sweep(angles, friction=0.5, sensor_resolution=0.2, friction_error=0.2)
    with pytest.raises(SearchCoverageError):
        sweep(angles, friction=0.5, sensor_resolution=0.2, normal_error=0.1)


def test_bad_values_are_refused() -> None:
    good: dict[str, Any] = {"friction": 0.5, "sensor_resolution": 0.1}
    cases: list[tuple[dict[str, Any], str]] = [
        ({"friction": [0.2, 0.5], "friction_error": [0.1, 0.3]}, "below the friction, 0.2"),
        ({"normal_error": math.pi / 2.0}, "below 90 degrees"),
        ({"normal_error": [[0.0], ["a"]]}, "must be a number"),
        ({"location_error": -1.0}, "location error must be at least 0"),
        ({"location_error": math.inf}, "must be a finite number"),
        ({"location_error": "2 furlongs"}, "must be a length"),
        ({"location_error": ["1 mm", 2.0]}, "must all have a unit, or none"),
        ({"location_error": []}, "no location error to sweep over"),
        ({"location_error": "1 mm"}, "shape without a unit"),
        (
            {"friction": [1, 2], "normal_error": [0, 0.1], "location_error": [0, 1]},
            "two axes, but 3 settings have several values: friction, normal_error, location_error",
        ),
    ]
    for values, message in cases:
        with pytest.raises(SettingError, match=message):
            sweep(SphereAngles(), **good | values)


def swept(source: Any, **more: Any) -> Sweep:
    given: dict[str, Any] = {
        "friction": 0.5,
        "sensor_resolution": 0.1,
        "location_error": [0.0, 0.1],
    }
    return sweep(source, **given | more)


def test_the_mean_has_a_distribution_for_each_location_error() -> None:
    one, other = swept(Grasps([0.1])), swept(Grasps([0.2, 0.4], 0.5))
    mean = mean_sweep([one, other], name="mean")
    assert mean.stable == pytest.approx((one.stable + other.stable) / 2.0)
    assert len(mean.distributions) == 2
    assert mean.required_resolution(0.5).shape == (1, 2)
    for more in ({"location_error": [0.0, 0.2]}, {"normal_error": 0.1}):
        with pytest.raises(SettingError, match="the mean needs sweeps of the same"):
            mean_sweep([one, swept(Grasps([0.1]), **more)])
    with pytest.raises(SettingError, match="the mean needs sweeps of the same"):
        mean_sweep([one, swept(Grasps([0.1]), location_error=["0 mm", "0.1 mm"])])


def test_the_table_has_all_uncertainties(tmp_path: Path) -> None:
    found = swept(Grasps([0.1, 0.4]), location_error=["1 mm", "0.1 mm"], friction=[0.4, 0.5])
    write_sweeps(tmp_path / "out.parquet", [found], fractions=[0.5])
    rows = pq.read_table(tmp_path / "out.parquet").to_pylist()
    at = [(row["friction"], row["location_error"], row["unit"]) for row in rows]
    assert at == [(mu, delta, "mm") for mu in (0.4, 0.5) for delta in (0.1, 1.0)]
    required = found.required_resolution(0.5)
    for row, value in zip(rows, required.ravel(), strict=True):
        assert row["required_resolution_50"] == value


def test_what_is_fixed_is_described() -> None:
    given: dict[str, Any] = ONE | {"friction": [0.3, 0.5]}
    assert axis_values(**given).fixed_text == ""
    assert axis_values(**given).is_default
    given |= {"location_error": "1.5mm", "normal_error": math.radians(2.0)}
    assert axis_values(**given).fixed_text == "normal error 2°, location error 1.5 mm"
    assert not axis_values(**given).is_default
    given |= {"friction": 0.5, "location_error": [0, 1], "sensor_resolution": math.radians(22.6)}
    fixed = "friction 0.5, normal error 2°, sensor resolution 22.6°"
    given |= {"friction_error": [0.0, 0.1]}
    assert axis_values(**given).fixed_text == fixed
