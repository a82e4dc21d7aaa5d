"""Heat maps of sweeps over two uncertainties, and stacked panels over others than resolution."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.collections import QuadMesh
from matplotlib.contour import QuadContourSet
from matplotlib.figure import Figure
from matplotlib.text import Text

from grasp3d.planar import Circle, square
from grasp3d.plots.figures import save_as
from grasp3d.plots.fractions import axis_title, sweep_figure
from grasp3d.plots.heat_maps import heat_map_figure
from grasp3d.stability.angle_distributions import SampledAngles, SphereAngles
from grasp3d.surface.sweeps import Sweep, sweep
from grasp3d.surface.sweeps.axes import axis_values
from tests.helpers.figures import check_texts

LOCATIONS = np.linspace(0.0, 0.3, 7)
NORMALS = np.radians(np.arange(0.0, 21.0, 4.0))


def errors(name: str = "sphere") -> Sweep:
    return sweep(
        SphereAngles(), friction=1.0, sensor_resolution=0.2, normal_error=NORMALS,
        location_error=LOCATIONS, name=name, mode="scan",
    )  # fmt: skip


def maps(figure: Figure) -> list[QuadMesh]:
    return [one for axes in figure.axes for one in axes.collections if isinstance(one, QuadMesh)]


def texts(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.findobj(Text) if text.get_text()]


def test_maps_have_the_fractions_and_the_required_resolution() -> None:
    swept = errors()
    figure = heat_map_figure([swept], fractions=[0.2])
    values = [np.asarray(one.get_array()) for one in maps(figure)[:3]]
    drawn = dict(zip(("S", "M", "alpha"), values, strict=True))
    assert drawn["S"] == pytest.approx(100.0 * swept.stable)
    assert drawn["M"] == pytest.approx(100.0 * swept.ambiguous)
    assert drawn["alpha"] == pytest.approx(np.degrees(swept.required_resolution(0.2)))
    first = figure.axes[0]
    assert first.get_xlim() == pytest.approx((0.0, 0.3))
    assert first.get_ylim() == pytest.approx((0.0, 20.0))  # degrees
    assert {"location error [radii]", "sphere\nnormal error [°]"} <= set(texts(figure))
    assert "friction 1, sensor resolution 11.46°" in texts(figure)


def test_a_line_is_drawn_where_the_surface_is_that_stable() -> None:
    swept = errors()
    figure = heat_map_figure([swept], fractions=[0.2, 0.99])  # 99 % are S nowhere
    lines = [one for one in figure.axes[0].collections if isinstance(one, QuadContourSet)]
    assert [list(one.levels) for one in lines] == [[20.0]]
    (path,) = lines[0].get_paths()
    for location, degrees in np.asarray(path.vertices):
        at = sweep(
            SphereAngles(), friction=1.0, sensor_resolution=0.2,
            normal_error=np.radians(degrees), location_error=location,
        )  # fmt: skip
        assert at.stable.item() == pytest.approx(0.2, abs=0.005)


def legends(figure: Figure) -> list[str]:
    return [text.get_text() for legend in figure.legends for text in legend.get_texts()]


@pytest.mark.slow
def test_what_is_not_possible_is_hatched_and_named() -> None:
    swept = errors()
    figure = heat_map_figure([swept], fractions=[0.2])
    needed = swept.required_resolution(0.2)
    hidden = [np.ma.getmaskarray(np.ma.asarray(one.get_array())) for one in maps(figure)[:3]]
    assert (needed == 0.0).any()
    np.testing.assert_array_equal(hidden[2], needed == 0.0)
    assert not hidden[0].any()
    assert not hidden[1].any()
    assert [bool(axes.patch.get_hatch()) for axes in figure.axes[:3]] == [False, False, True]
    assert legends(figure) == [r"$\alpha$: no sensor is fine enough"]
    check_texts(figure)


@pytest.mark.slow
def test_a_map_without_any_value_has_no_scale() -> None:
    swept = sweep(
        SphereAngles(), friction=0.3, sensor_resolution=1.0, normal_error=NORMALS,
        location_error=LOCATIONS, mode="scan",
    )  # fmt: skip
    assert not swept.stable.any()
    figure = heat_map_figure([swept], fractions=[0.9])
    check_texts(figure)
    assert legends(figure) == [r"S: none; $\alpha$: no sensor is fine enough"]
    assert [axes.get_visible() for axes in figure.axes[3:]] == [True, True, False]  # S up to 10 %


def test_nothing_is_hatched_where_everything_is_possible() -> None:
    swept = sweep(
        SphereAngles(), friction=1.0, sensor_resolution=0.1, normal_error=NORMALS[:2],
        location_error=LOCATIONS[:2], mode="scan",
    )  # fmt: skip
    figure = heat_map_figure([swept], fractions=[0.2])
    assert not legends(figure)
    assert not any(axes.patch.get_hatch() for axes in figure.axes)


def test_numbers_without_a_unit_are_multiples_of_the_shape_or_in_the_unit_of_the_mesh() -> None:
    values: dict[str, Any] = {
        "friction": 1.0,
        "sensor_resolution": 0.2,
        "normal_error": NORMALS[:2],
    }
    sampled = SampledAngles(*np.array([[0.1, 0.2], [0.1, 0.2], [1.0, 1.0]]))
    sources: dict[str, Any] = {
        "radii": Circle(), "half sides": square(), "unit of the shape": Circle(30.0),
        "mesh unit": sampled,
    }  # fmt: skip
    for unit, source in sources.items():
        found = sweep(source, **values)
        assert axis_title("location_error", [found]) == f"location error [{unit}]"
    both = [sweep(one, **values) for one in (Circle(), square(), Circle())]
    assert axis_title("location_error", both) == "location error [radii or half sides]"
    axes = axis_values(friction_error=0.0, location_error="2 mm", **values)
    found = replace(sweep(sampled, **values), axes=axes)
    assert axis_title("location_error", [found, found]) == "location error [mm]"


def test_over_the_resolution_there_is_no_map_of_the_required_one() -> None:
    swept = sweep(
        SphereAngles(), friction=0.5, sensor_resolution=np.linspace(0.0, 1.0, 5),
        location_error=[0.0, 0.1],
    )  # fmt: skip
    figure = heat_map_figure([swept], fractions=[0.1])
    assert [axes.get_title() for axes in figure.axes[:2]] == [
        "surely stable (S) [%]",
        "ambiguous (M) [%]",
    ]
    assert len(maps(figure)) == 4  # with their colour bars


@pytest.mark.slow
def test_the_maps_of_several_sweeps_share_their_colours_and_are_saved(tmp_path: Path) -> None:
    small = sweep(
        SphereAngles(radius=0.2), friction=1.0, sensor_resolution=0.2, normal_error=NORMALS,
        location_error=LOCATIONS, name="small", mode="scan",
    )  # fmt: skip
    figure = heat_map_figure([errors(), small], fractions=[0.2])
    limits = [one.get_clim() for one in maps(figure)]
    assert limits.count((0.0, 50.0)) >= 2
    for name in ("out.png", "out.svg"):
        written = set()
        for _ in range(2):
            save_as(heat_map_figure([small], fractions=[0.2]), tmp_path / name)
            written.add((tmp_path / name).read_bytes())
        (data,) = written
        assert len(data) > 5_000


@pytest.mark.slow
def test_panels_are_stacked_over_any_uncertainty() -> None:
    swept = sweep(
        SphereAngles(), friction=1.0, sensor_resolution=0.2, normal_error=NORMALS[:3],
        location_error=LOCATIONS, name="sphere", mode="scan",
    )  # fmt: skip
    figure = sweep_figure([swept], fractions=[0.2])
    titles = [axes.get_title() for axes in figure.axes]
    assert titles[:3] == [f"normal error = {degrees}°" for degrees in (0, 4, 8)]
    assert figure.axes[0].get_xlim() == pytest.approx((0.0, 0.3))
    found = texts(figure)
    assert "location error [radii]" in found
    assert "friction 1, sensor resolution 11.46°" in found
    assert not any("coarsest sensor" in text for text in found)
