"""Files of figures."""

from pathlib import Path
from xml.etree import ElementTree as ET

import matplotlib as mpl
from matplotlib.figure import Figure
from PIL import Image

from grasp3d import Label
from grasp3d.pictures.figures import (
    DPI,
    LABEL_COLORS,
    LINES,
    label_patches,
    new_figure,
    save_as,
    styled,
)


def example() -> Figure:
    figure = new_figure(3.5, 2.0)
    axes = figure.add_subplot()
    axes.plot([0.0, 1.0], [0.2, 0.8], **LINES[1])
    axes.fill_between([0.0, 1.0], [0.0, 0.1], color=LABEL_COLORS[Label.S])
    axes.set(xlabel=r"$\alpha$ [°]", title="both")
    figure.legend(handles=label_patches(), loc="outside lower center")
    return figure


def save(path: Path) -> tuple[Path, Path]:
    """Write the example as .svg and .png."""
    files = path.with_suffix(".svg"), path.with_suffix(".png")
    figure = styled(example)()
    for file in files:
        save_as(figure, file)
    return files


def test_figures_are_the_same_bytes_every_time(tmp_path: Path) -> None:
    first = save(tmp_path / "first")
    mpl.rcParams["font.size"] = 23.0  # settings of other code in the process
    mpl.rcParams["svg.hashsalt"] = "other"
    try:
        second = save(tmp_path / "second")
    finally:
        mpl.rcdefaults()
    for one, other in zip(first, second, strict=True):
        assert one.read_bytes() == other.read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "first.png", "first.svg", "second.png", "second.svg",
    ]  # fmt: skip


def test_vector_graphics_are_xml_and_pictures_have_their_size(tmp_path: Path) -> None:
    vector, picture = save(tmp_path / "figure")
    root = ET.parse(vector).getroot()  # noqa: S314, our own file
    assert root.tag == "{http://www.w3.org/2000/svg}svg"
    assert not list(root.iter("{http://www.w3.org/2000/svg}text"))  # text is drawn as outlines
    assert "<!-- both -->" in vector.read_text()
    assert "dc:date" not in vector.read_text()
    with Image.open(picture) as image:
        assert image.size == (round(3.5 * DPI), round(2.0 * DPI))
        assert LABEL_COLORS[Label.S] in {
            "#{:02X}{:02X}{:02X}".format(*color[:3])
            for _, color in image.convert("RGB").getcolors(1 << 20) or []
        }
