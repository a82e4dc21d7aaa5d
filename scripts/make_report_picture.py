"""Picture of a library's report: the library page, and an object page with a picked vertex.

    python scripts/make_report_picture.py -o docs/report.png [FOLDER]

Needs Chromium, and the package playwright of the extra `test`.
"""

import argparse
import shutil
import tempfile
from pathlib import Path

from PIL import Image
from playwright.sync_api import Browser, sync_playwright

from grasp3d import label_library

LIBRARY = Path(__file__).parents[1] / "meshes"
SHOWN = "spray"
CLICK = (0.44, 0.68)
"""Position of the click, as fractions of the view's width and height."""

OPTIONS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
FIRST, SECOND = (1300, 1230), (1300, 800)
"""Sizes of the windows [pixels]."""

WIDTH = 1000


def screenshots(browser: Browser, results: Path, folder: Path) -> list[Path]:
    """Take screenshots of both pages."""
    paths = [folder / "index.png", folder / "object.png"]
    page = browser.new_page(viewport={"width": FIRST[0], "height": FIRST[1]})
    page.goto((results / "report" / "index.html").as_uri())
    page.wait_for_timeout(1500)
    page.screenshot(path=paths[0])
    page = browser.new_page(viewport={"width": SECOND[0], "height": SECOND[1]})
    page.goto(f"{(results / 'report' / 'object.html').as_uri()}#{SHOWN}")
    page.wait_for_timeout(2500)
    box = page.locator("canvas").first.bounding_box()
    assert box is not None
    page.mouse.click(box["x"] + CLICK[0] * box["width"], box["y"] + CLICK[1] * box["height"])
    page.wait_for_timeout(800)
    page.screenshot(path=paths[1])
    return paths


def stacked(paths: list[Path]) -> Image.Image:
    """Put pictures one below the other."""
    pictures = [Image.open(path).convert("RGB") for path in paths]
    sheet = Image.new("RGB", (FIRST[0], sum(one.height for one in pictures) + 12), "white")
    top = 0
    for one in pictures:
        sheet.paste(one, (0, top))
        top += one.height + 12
    size = (WIDTH, round(sheet.height * WIDTH / sheet.width))
    return sheet.resize(size, Image.Resampling.LANCZOS)


def main() -> None:
    """Label a library, open its report and write the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("library", type=Path, nargs="?", default=LIBRARY)
    parser.add_argument("-o", "--output", type=Path, default=Path("report.png"))
    options = parser.parse_args()
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as driver:
        results = Path(folder, "results")
        label_library([options.library], results)
        with driver.chromium.launch(executable_path=browser, args=OPTIONS) as started:
            stacked(screenshots(started, results, Path(folder))).save(options.output, optimize=True)


if __name__ == "__main__":
    main()
