"""The site in a real browser, opened from its folder."""

import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

CI = os.environ.get("CI") == "true"
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
BROWSER = next(filter(None, map(shutil.which, BROWSERS)), None)
WIDTHS = (1280, 390)

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    if BROWSER is None:
        (pytest.fail if CI else pytest.skip)("needs Chromium")
    playwright = pytest.importorskip("playwright.sync_api", reason="needs playwright")
    with playwright.sync_playwright() as driver:
        launched = driver.chromium.launch(
            executable_path=BROWSER, args=["--no-sandbox", "--disable-gpu"]
        )
        yield launched
        launched.close()


@pytest.fixture(params=WIDTHS)
def page(browser: Any, request: pytest.FixtureRequest) -> Iterator[Any]:
    """An empty page; what goes wrong in it fails the test."""
    errors: list[str] = []
    opened = browser.new_page(viewport={"width": request.param, "height": 900})
    opened.on("console", lambda one: errors.append(one.text) if one.type == "error" else None)
    opened.on("pageerror", lambda error: errors.append(str(error)))
    opened.on("requestfailed", lambda request: errors.append(f"failed: {request.url}"))
    opened.on(
        "request",
        lambda request: (
            None
            if request.url.startswith(("file:", "data:"))
            else errors.append(f"outside: {request.url}")
        ),
    )
    yield opened
    opened.close()
    assert not errors


def test_no_page_is_wider_than_the_window(site: Path, page: Any) -> None:
    wide = []
    for file in sorted(site.rglob("*.html")):
        page.goto(file.as_uri())
        width, shown = page.evaluate("[document.documentElement.scrollWidth, innerWidth]")
        if width > shown:
            wide.append((str(file.relative_to(site)), width))
    assert not wide


def test_search_finds_a_page_without_a_server(site: Path, page: Any) -> None:
    page.goto(f"{(site / 'search.html').as_uri()}?q=force+closure")
    results = page.locator("#search-results li a")
    results.nth(3).wait_for()  # they appear one after the other
    results.first.click()
    page.wait_for_url(lambda address: "search.html" not in address)
    assert "closure" in page.locator("article").inner_text().lower()


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
