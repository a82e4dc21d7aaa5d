"""Heat maps of sweeps over two uncertainties, and stacked panels over others than resolution."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import QuadMesh
from matplotlib.contour import QuadContourSet
from matplotlib.figure import Figure
from matplotlib.text import Text

from grasp3d.plots.formats import save_as
from grasp3d.plots.fractions import sweep_figure
from grasp3d.plots.heat_maps import heat_map_figure
from grasp3d.stability.angle_distributions import SphereAngles
from grasp3d.sweeps import Sweep, sweep

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
    assert {"location error", "sphere\nnormal error [°]"} <= set(texts(figure))
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
    assert "location error" in found
    assert "friction 1, sensor resolution 11.46°" in found
    assert not any("coarsest sensor" in text for text in found)
