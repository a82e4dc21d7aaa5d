"""Make the picture of the viewer's page, with two resolutions compared and a vertex inspected.

    python scripts/make_viewer_picture.py -o docs/viewer.png

Needs Chromium, and the package playwright of the extra `test`.
"""

import argparse
import re
import subprocess
import sys
from pathlib import Path

from PIL import Image
from playwright.sync_api import Page, sync_playwright

OBJECT = Path(__file__).parents[1] / "meshes" / "spray.glb"
CLICK = (0.22, 0.66)
"""Position of the click on the surface, relative to the size of the scene."""

BROWSER = "/usr/bin/chromium"
OPTIONS = ["--no-sandbox", "--disable-gpu", "--disable-background-networking"]
WINDOW = (1280, 1010)
NO_DITHER = Image.Dither.NONE


def photograph(page: Page, address: str, path: Path) -> None:
    """Wait for the object, set up the view, and take the picture."""
    page.goto(address)
    page.locator("#fractions").wait_for(timeout=60_000)
    page.wait_for_timeout(1500)
    page.locator("#comparing").check()
    page.wait_for_timeout(1500)
    box = page.locator("#stage, .stage, main").first.bounding_box()
    assert box is not None
    page.mouse.click(box["x"] + CLICK[0] * box["width"], box["y"] + CLICK[1] * box["height"])
    page.locator("#reason").wait_for()
    page.locator("#progress").wait_for(state="detached", timeout=60_000)  # the wider search
    page.wait_for_timeout(1500)
    page.screenshot(path=path)


def main() -> None:
    """Parse the command line and make the picture."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("docs/viewer.png"))
    output = parser.parse_args().output
    command = [sys.executable, "-c", "import sys; from grasp3d.cli import main; sys.exit(main())"]
    view = [*command, "view", str(OBJECT), "--web", "--port", "0"]
    with subprocess.Popen(view, stdout=subprocess.PIPE, text=True) as server:  # noqa: S603
        assert server.stdout is not None
        found = re.match(r"(http:\S+) ", server.stdout.readline())
        assert found is not None
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=BROWSER, args=OPTIONS)
            page = browser.new_page(viewport={"width": WINDOW[0], "height": WINDOW[1]})
            photograph(page, found[1], output)
            browser.close()
        server.terminate()
    with Image.open(output) as picture:
        rgb = picture.convert("RGB")
        reduced = rgb.quantize(method=Image.Quantize.FASTOCTREE, dither=NO_DITHER)
    reduced.save(output, optimize=True)
    print(f"written: {output}, {output.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
