"""Render the meshes of the library into one picture: each labelled, with its area fractions.

    python scripts/make_gallery.py [-o meshes/gallery.png] [FOLDER]

Friction and resolution are chosen so that all three labels are on most objects. Needs OpenGL (EGL
or a display).
"""

import argparse
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

from grasp3d import GraspModel, label_surface, load_mesh
from grasp3d.stability.label import COLORS, MEANING, Label
from grasp3d.system.progress import ignore
from grasp3d.viewer.scene.overlays import BOLD, PLAIN
from grasp3d.viewer.scene.pictures import open_renderer
from grasp3d.viewer.session.collection import collection_of
from grasp3d.viewer.view_settings import ViewSettings

LIBRARY = Path(__file__).parents[1] / "meshes"
SUFFIXES = {".stl", ".obj", ".ply", ".off", ".glb"}
MODEL = GraspModel(friction=0.2, sensor_resolution=math.radians(15.0))
COLUMNS = 6
CELL = (320, 280)
"""Width and height of a picture [pixels]."""

CAPTION, LEGEND, EDGE = 66, 64, 16
"""Heights of a picture's caption and of the legend, and the margin around all [pixels]."""

INK, QUIET = "#20262D", "#5B6470"
NAME, TEXT = ImageFont.truetype(str(BOLD), 18), ImageFont.truetype(str(PLAIN), 15)


@dataclass(frozen=True)
class Entry:
    """An object of the gallery."""

    name: str
    picture: Image.Image
    fractions: dict[str, float]


def entries(folder: Path) -> Iterator[Entry]:
    """Label and render all meshes of a folder."""
    for path in sorted(folder.iterdir()):
        if path.suffix.lower() not in SUFFIXES:
            continue
        labels = label_surface(load_mesh(path, unit="m"), MODEL)
        settings = ViewSettings(width=CELL[0], height=CELL[1])
        with open_renderer(collection_of(labels), settings, ignore, legend=False) as renderer:
            yield Entry(path.stem, Image.fromarray(renderer.picture()), labels.fractions())
        print(path.name, *(f"{name} {value:.1%}" for name, value in labels.fractions().items()))


def draw_caption(draw: ImageDraw.ImageDraw, middle: float, top: float, one: Entry) -> None:
    """Write a name and the area fractions below it, each after a square of its colour."""
    draw.text((middle, top + 10), one.name, INK, NAME, anchor="mm")
    parts = [f"{letter} {100.0 * value:.0f} %" for letter, value in one.fractions.items()]
    gap, square = 16.0, 20.0
    widths = [square + TEXT.getlength(part) for part in parts]
    x = middle - 0.5 * (sum(widths) + gap * (len(parts) - 1))
    for part, width in zip(parts, widths, strict=True):
        draw_key(draw, x, top + 38, part, COLORS[Label[part[0]]])
        x += width + gap


def draw_key(
    draw: ImageDraw.ImageDraw, x: float, y: float, text: str, color: tuple[int, int, int]
) -> None:
    """Draw a square of a colour, and text to its right."""
    draw.rectangle((x, y - 7, x + 13, y + 6), fill=color)
    draw.text((x + 20, y), text, INK, TEXT, anchor="lm")


def gallery(objects: list[Entry]) -> Image.Image:
    """Lay out all objects in rows, with one legend."""
    rows = math.ceil(len(objects) / COLUMNS)
    width, height = CELL[0], CELL[1] + CAPTION
    image = Image.new("RGB", (COLUMNS * width + 2 * EDGE, rows * height + LEGEND + EDGE), "white")
    draw = ImageDraw.Draw(image)
    for number, one in enumerate(objects):
        left, top = EDGE + number % COLUMNS * width, EDGE + number // COLUMNS * height
        image.paste(one.picture, (left, top))
        draw_caption(draw, left + 0.5 * width, top + CELL[1], one)
    x, y = 2.0 * EDGE, image.height - 0.5 * LEGEND
    draw.line((EDGE, y - 26, image.width - EDGE, y - 26), fill="#DDE1E5", width=1)
    for label in sorted(Label, reverse=True):
        text = f"{label.name}: {MEANING['label'][label]}"
        draw_key(draw, x, y, text, COLORS[label])
        x += TEXT.getlength(text) + 60
    settings = (
        f"two fingers, friction μ {MODEL.friction:g}, "
        f"sensor resolution α {math.degrees(MODEL.sensor_resolution):g}°"
    )
    draw.text((image.width - 2 * EDGE, y), settings, QUIET, TEXT, anchor="rm")
    return image


def main() -> None:
    """Render the library and write the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, nargs="?", default=LIBRARY)
    parser.add_argument("-o", "--output", type=Path, default=LIBRARY / "gallery.png")
    options = parser.parse_args()
    image = gallery(list(entries(options.folder)))
    colors = image.quantize(256, dither=Image.Dither.NONE)
    colors.save(options.output, optimize=True)
    print(f"{options.output}: {options.output.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
