"""A real browser for tests; it may be missing on a developer's machine."""

import os
import shutil
from collections.abc import Iterator
from typing import Any

import pytest

CI = os.environ.get("CI") == "true"
NAMES = ("chromium", "chromium-browser", "google-chrome")
BROWSER = next(filter(None, map(shutil.which, NAMES)), None)
OPTIONS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
]


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Chromium, without a window."""
    if BROWSER is None:
        (pytest.fail if CI else pytest.skip)("needs Chromium")
    playwright = pytest.importorskip("playwright.sync_api", reason="needs playwright")
    with playwright.sync_playwright() as driver:
        launched = driver.chromium.launch(executable_path=BROWSER, args=OPTIONS)
        yield launched
        launched.close()


def quiet_page(browser: Any, width: int, errors: list[str]) -> Any:
    """Open a page that shows local files; errors in it are added to `errors`."""
    opened = browser.new_page(viewport={"width": width, "height": 900})
    opened.on("console", lambda one: errors.append(one.text) if one.type == "error" else None)
    opened.on("pageerror", lambda error: errors.append(str(error)))
    opened.on("dialog", lambda dialog: errors.append(f"dialog: {dialog.message}"))
    opened.on("requestfailed", lambda request: errors.append(f"failed: {request.url}"))
    opened.on(
        "request",
        lambda request: (
            None
            if request.url.startswith(("file:", "data:"))
            else errors.append(f"outside: {request.url}")
        ),
    )
    return opened
