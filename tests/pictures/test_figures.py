"""Figures: their files, and that of a sweep with its curves and layout."""

from pathlib import Path
from xml.etree import ElementTree as ET

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.text import Text
from PIL import Image

from grasp3d import Label
from grasp3d.pictures.figures import (
    DPI,
    LABEL_COLORS,
    LINES,
    draw_ceiling,
    label_patches,
    new_figure,
    save_as,
    stack_fractions,
    styled,
    sweep_figure,
)
from grasp3d.stability.angle_distributions import SampledAngles, SphereAngles
from grasp3d.surface.sweeps import Sweep, mean_sweep, sweep

DEGREES = np.linspace(0.0, 60.0, 25)


def example() -> Figure:
    figure = new_figure(3.5, 2.0)
    axes = figure.add_subplot()
    axes.plot([0.0, 1.0], [0.2, 0.8], **LINES[1])
    axes.fill_between([0.0, 1.0], [0.0, 0.1], color=LABEL_COLORS[Label.S])
    axes.set(xlabel=r"$\alpha$ [°]", title="both")
    figure.legend(handles=label_patches(), loc="outside lower center")
    return figure


def test_figures_are_the_same_bytes_every_time(tmp_path: Path) -> None:
    figure, names = styled(example)(), ("figure.svg", "figure.png", "figure.pdf")
    for name in names:
        save_as(figure, tmp_path / name)
    first = [(tmp_path / name).read_bytes() for name in names]
    mpl.rcParams["font.size"] = 23.0  # settings of other code in the process
    mpl.rcParams["svg.hashsalt"] = "other"
    try:
        again = styled(example)()
        for name in names:
            save_as(again, tmp_path / name)
    finally:
        mpl.rcdefaults()
    assert first == [(tmp_path / name).read_bytes() for name in names]
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names)
    assert first[2].startswith(b"%PDF")
    root = ET.fromstring(first[0])  # noqa: S314, our own file
    assert root.tag == "{http://www.w3.org/2000/svg}svg"
    assert not list(root.iter("{http://www.w3.org/2000/svg}text"))  # text is drawn as outlines
    assert b"<!-- both -->" in first[0]
    assert b"dc:date" not in first[0]
    with Image.open(tmp_path / "figure.png") as image:
        assert image.size == (round(3.5 * DPI), round(2.0 * DPI))
        colors = {color for _, color in image.convert("RGB").getcolors(1 << 20) or []}
    assert tuple(bytes.fromhex(LABEL_COLORS[Label.S][1:])) in colors


def spheres(name: str = "sphere", friction: tuple[float, ...] = (0.2, 0.5, 1.0)) -> Sweep:
    resolutions = np.radians(DEGREES)
    return sweep(
        SphereAngles(), friction=friction, sensor_resolution=resolutions, name=name, mode="scan"
    )


def surface(name: str, seed: int) -> Sweep:
    angles = np.sort(np.random.default_rng(seed).uniform(0.0, 0.6, 500))
    found, resolutions = SampledAngles(angles + 0.05, angles, np.full(500, 1.0 / 500)), DEGREES
    return sweep(
        found, friction=(0.2, 0.5, 1.0), sensor_resolution=np.radians(resolutions), name=name
    )


def texts(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.findobj(Text) if text.get_text()]


def test_the_areas_are_the_fractions() -> None:
    swept = spheres()
    axes = new_figure().subplots()
    stack_fractions(axes, swept, 1)
    areas = {}
    for collection in axes.collections:
        assert isinstance(collection, PolyCollection)
        x, y = np.asarray(collection.get_paths()[0].vertices).T
        color = "#" + "".join(f"{round(255 * c):02X}" for c in collection.get_facecolor()[0][:3])
        areas[color] = 0.5 * abs(np.dot(x, np.roll(y, 1)) - np.dot(y, np.roll(x, 1)))
    heights = {Label.S: swept.stable, Label.M: swept.ambiguous, Label.U: swept.unstable}
    assert len(areas) == 3
    for label, height in heights.items():
        expected = np.trapezoid(100.0 * height[1], DEGREES)
        assert areas[LABEL_COLORS[label]] == pytest.approx(expected, rel=1e-9)


def test_the_marks_are_where_stability_falls_to_the_fraction() -> None:
    swept = surface("blob", 1)
    axes = new_figure().subplots()
    stack_fractions(axes, swept, 1, fractions=(0.5, 0.3, 0.95))  # 95 % are never S
    dots = [line for line in axes.get_lines() if line.get_marker() == "o"]
    required = np.degrees([swept.required_resolution(value)[1] for value in (0.5, 0.3)])
    found = [np.asarray(dot.get_xydata())[0] for dot in dots]
    assert np.stack(found) == pytest.approx(np.stack([required, [50.0, 30.0]], axis=1))
    assert f"{required[0]:.0f}°" in [text.get_text() for text in axes.texts]


def test_the_ceiling_has_a_line_for_each_friction_and_each_sweep() -> None:
    figure = new_figure()
    one, several, many = figure.subplots(1, 3)
    draw_ceiling(one, [spheres()])
    draw_ceiling(several, [spheres(friction=(1.0,)), spheres("ball", (1.0,))])
    draw_ceiling(many, [spheres(), spheres("ball")])
    assert [line.get_label() for line in one.get_lines()] == ["μ = 0.2", "μ = 0.5", "μ = 1"]
    assert [line.get_label() for line in several.get_lines()] == ["sphere", "ball"]
    assert [line.get_label() for line in many.get_lines()][-1] == "ball, μ = 1"
    assert one.get_lines()[1].get_ydata() == pytest.approx(100.0 * spheres().accuracy_ceiling[1])


def test_nothing_is_cut_off_and_no_panels_overlap() -> None:
    meshes = [surface(f"mesh_{seed}.ply", seed) for seed in range(3)]
    mean = mean_sweep(meshes, name="a rather long name of a folder (mean of 3)")
    figure = sweep_figure([spheres(), mean], members=meshes, fractions=(0.5, 0.9))
    figure.draw_without_rendering()
    page = figure.bbox.padded(1.0)
    boxes = [axes.get_tightbbox() for axes in figure.axes] + [figure.legends[0].get_window_extent()]
    for number, box in enumerate(boxes):
        assert page.x0 <= box.x0 < box.x1 <= page.x1
        assert page.y0 <= box.y0 < box.y1 <= page.y1
        for other in boxes[:number]:
            apart_x = box.x0 >= other.x1 - 1 or other.x0 >= box.x1 - 1
            apart_y = box.y0 >= other.y1 - 1 or other.y0 >= box.y1 - 1
            assert apart_x or apart_y
    assert {"S of each mesh", "U  no grasp found (on sphere: surely unstable)"} <= {*texts(figure)}
    for one, text in ((spheres(), "U  surely unstable"), (meshes[0], "U  no grasp found")):
        assert text in texts(sweep_figure([one]))


def test_names_may_have_any_characters(tmp_path: Path) -> None:
    figure = sweep_figure([surface("5 $ and 6 $ 漢字 \udcff", 3)], fractions=(0.5,))
    for suffix in ("svg", "png", "pdf"):
        save_as(figure, tmp_path / f"a.{suffix}")
