"""The site in a real browser, opened from its folder."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from lxml import html

from tests.helpers.browsers import quiet_page

WIDTHS = (1280, 390)
"""Of a screen, and of a telephone."""

pytestmark = pytest.mark.slow


@pytest.fixture
def page(browser: Any) -> Iterator[Any]:
    """An empty page; what goes wrong in it fails the test."""
    errors: list[str] = []
    opened = quiet_page(browser, WIDTHS[0], errors)
    yield opened
    opened.close()
    assert not errors


# The width of the page beyond that of the window, whether it is too long, blocks of code that
# scroll, where only outputs on a narrow page may, and pictures that are too small to read. A figure
# is drawn for 700 pixels.
MEASURE = """() => [
  document.documentElement.scrollWidth - innerWidth,
  document.documentElement.scrollHeight > 13000,
  [...document.querySelectorAll('.highlight pre')]
    .filter(one => innerWidth > 1000 || !one.closest('.highlight-text'))
    .filter(one => one.scrollWidth > one.clientWidth).map(one => one.innerText),
  [...document.querySelectorAll('article p > img:only-child')]
    .filter(one => one.clientWidth < Math.min(one.naturalWidth, 700)).map(one => one.src),
]"""


@pytest.mark.parametrize("width", WIDTHS)
def test_pages_fit_and_can_be_read(site: Path, page: Any, width: int) -> None:
    """Of pages without pictures only the text is loaded, into a page of the same layout."""
    page.set_viewport_size({"width": width, "height": 900})
    page.goto((site / "reference" / "commands.html").as_uri())
    wrong = {}
    for file in sorted(site.rglob("*.html")):
        text = html.fromstring(file.read_bytes()).find(".//article")
        if text is None or text.find(".//img") is not None:
            page.goto(file.as_uri())
        else:
            shown = html.tostring(text, encoding="unicode")
            page.locator("article").evaluate("(one, text) => { one.outerHTML = text }", shown)
        found = page.evaluate(MEASURE)
        if found != [0, False, [], []]:
            wrong[file.relative_to(site)] = found
    assert not wrong


SEARCHES = {
    "install": "install.html",
    "label_surface": "reference/names/grasp3d.label_surface.html",
    "load mesh": "reference/names/grasp3d.load_mesh.html",
    "payload": "reference/names/grasp3d.payload.html",
    "best grasps": "reference/names/grasp3d.best_grasps.html",
    "gripper": "guide/grippers.html",
    "units": "guide/meshes.html",
    "batch": "reference/commands/batch.html",
    "urdf": "guide/grippers.html",
    "formats": "reference/formats.html",
}
"""What users search, and the page that answers."""


def first_hit(site: Path, page: Any, words: str) -> Any:
    """The link of the first result, once there are all, for they appear one after the other."""
    page.goto(f"{(site / 'search.html').as_uri()}?q={words.replace(' ', '+')}")
    page.locator("#search-results .search-summary", has_text="found").wait_for()
    return page.locator("#search-results li a").first


def test_the_page_that_answers_a_search_is_found_first(site: Path, page: Any) -> None:
    found = {}
    for words in SEARCHES:
        address = str(first_hit(site, page, words).get_attribute("href"))
        found[words] = address.partition("?")[0].partition("#")[0]
    assert found == SEARCHES


def test_formulas_have_a_size(site: Path, page: Any) -> None:
    page.goto((site / "theory/thresholds.html").as_uri())
    fraction = page.locator("math mfrac").first
    fraction.scroll_into_view_if_needed()
    box = fraction.bounding_box()
    text = page.locator("article p").first.evaluate(
        "one => parseFloat(getComputedStyle(one).fontSize)"
    )
    assert box["height"] > 1.5 * text
    assert box["width"] < 200
