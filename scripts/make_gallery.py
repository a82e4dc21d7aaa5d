"""Render the meshes of the library into one picture: each labelled, with its shares of S, M and U.

    python scripts/make_gallery.py [-o meshes/gallery.png] [FOLDER]

Friction and resolution are chosen so that most objects have places of all three kinds. Needs OpenGL
(EGL or a display).
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
from grasp3d.viewer.scene.lettering import BOLD, PLAIN
from grasp3d.viewer.scene.pictures import opened
from grasp3d.viewer.session.album import album_of
from grasp3d.viewer.view_settings import ViewSettings

LIBRARY = Path(__file__).parents[1] / "meshes"
SUFFIXES = {".stl", ".obj", ".ply", ".off", ".glb"}
MODEL = GraspModel(friction=0.2, sensor_resolution=math.radians(15.0))
COLUMNS = 6
CELL = (320, 280)
"""Pixels of a picture."""

WORDS, FOOT, EDGE = 66, 64, 16
"""Pixels below a picture, below all of them, and around."""

INK, QUIET = "#20262D", "#5B6470"
NAME, TEXT = ImageFont.truetype(str(BOLD), 18), ImageFont.truetype(str(PLAIN), 15)


@dataclass(frozen=True)
class Shown:
    """An object of the gallery."""

    name: str
    drawn: Image.Image
    shares: dict[str, float]


def shown(folder: Path) -> Iterator[Shown]:
    """Label and draw all meshes of a folder."""
    for path in sorted(folder.iterdir()):
        if path.suffix.lower() not in SUFFIXES:
            continue
        labels = label_surface(load_mesh(path, unit="m"), MODEL)
        settings = ViewSettings(width=CELL[0], height=CELL[1])
        with opened(album_of(labels), settings, ignore, legend=False) as studio:
            yield Shown(path.stem, Image.fromarray(studio.shot()), labels.fractions())
        print(path.name, *(f"{name} {share:.1%}" for name, share in labels.fractions().items()))


def centred(draw: ImageDraw.ImageDraw, middle: float, top: float, one: Shown) -> None:
    """Write a name and the shares below it, each after a square of its colour."""
    draw.text((middle, top + 10), one.name, INK, NAME, anchor="mm")
    parts = [f"{letter} {100.0 * share:.0f} %" for letter, share in one.shares.items()]
    gap, square = 16.0, 20.0
    widths = [square + TEXT.getlength(part) for part in parts]
    x = middle - 0.5 * (sum(widths) + gap * (len(parts) - 1))
    for part, width in zip(parts, widths, strict=True):
        entry(draw, x, top + 38, part, COLORS[Label[part[0]]])
        x += width + gap


def entry(
    draw: ImageDraw.ImageDraw, x: float, y: float, words: str, color: tuple[int, int, int]
) -> None:
    """A square of a colour, and words to its right."""
    draw.rectangle((x, y - 7, x + 13, y + 6), fill=color)
    draw.text((x + 20, y), words, INK, TEXT, anchor="lm")


def sheet(objects: list[Shown]) -> Image.Image:
    """Lay out all objects in rows, with one legend."""
    rows = math.ceil(len(objects) / COLUMNS)
    width, height = CELL[0], CELL[1] + WORDS
    made = Image.new("RGB", (COLUMNS * width + 2 * EDGE, rows * height + FOOT + EDGE), "white")
    draw = ImageDraw.Draw(made)
    for number, one in enumerate(objects):
        left, top = EDGE + number % COLUMNS * width, EDGE + number // COLUMNS * height
        made.paste(one.drawn, (left, top))
        centred(draw, left + 0.5 * width, top + CELL[1], one)
    x, y = 2.0 * EDGE, made.height - 0.5 * FOOT
    draw.line((EDGE, y - 26, made.width - EDGE, y - 26), fill="#DDE1E5", width=1)
    for label in sorted(Label, reverse=True):
        words = f"{label.name}: {MEANING['label'][label]}"
        entry(draw, x, y, words, COLORS[label])
        x += TEXT.getlength(words) + 60
    asked = (
        f"two fingers, friction μ {MODEL.friction:g}, "
        f"sensor resolution α {math.degrees(MODEL.sensor_resolution):g}°"
    )
    draw.text((made.width - 2 * EDGE, y), asked, QUIET, TEXT, anchor="rm")
    return made


def main() -> None:
    """Render the library and write the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, nargs="?", default=LIBRARY)
    parser.add_argument("-o", "--output", type=Path, default=LIBRARY / "gallery.png")
    options = parser.parse_args()
    made = sheet(list(shown(options.folder)))
    colors = made.quantize(256, dither=Image.Dither.NONE)
    colors.save(options.output, optimize=True)
    print(f"{options.output}: {options.output.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
