"""The built site: complete, without dead links, and without anything from a network."""

import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from lxml import html

from grasp3d.cli import KINDS
from grasp3d.cli.options import options_of
from tests.helpers.public_names import public_names

ROOT = Path(__file__).parents[2]
EXTERNAL = {"http", "https", "mailto"}
LOADED = {("script", "src"), ("link", "href"), ("img", "src"), ("source", "src"), ("iframe", "src")}
"""What a browser loads by itself."""

pytestmark = pytest.mark.slow


@cache
def parsed(page: Path) -> html.HtmlElement:
    return html.document_fromstring(page.read_bytes())


@cache
def anchors(page: Path) -> frozenset[str]:
    return frozenset(parsed(page).xpath("//@id | //a/@name"))


def pages(site: Path) -> list[Path]:
    return sorted(site.rglob("*.html"))


def links(page: Path) -> Iterator[tuple[str, str, str]]:
    """(element, attribute, address) of everything that a page refers to."""
    for element, attribute, address, _ in parsed(page).iterlinks():
        yield str(element.tag), str(attribute), address


def test_it_is_built_without_warnings(site: Path) -> None:
    assert site.with_suffix(".log").read_text() == "exit code 0"


def test_links_and_anchors_exist(site: Path) -> None:
    dead = []
    for page in pages(site):
        for _, _, address in links(page):
            parts = urlsplit(address)
            if parts.scheme in {*EXTERNAL, "data"}:
                assert " " not in address
                continue
            target = (page.parent / unquote(parts.path)).resolve() if parts.path else page
            known = target.is_file() and (
                not parts.fragment or target.suffix != ".html" or parts.fragment in anchors(target)
            )
            if not known:
                dead.append(f"{page.relative_to(site)}: {address}")
    assert len(pages(site)) > 200
    assert not dead


def test_nothing_is_loaded_from_a_network(site: Path) -> None:
    for page in pages(site):
        for element, attribute, address in links(page):
            if (element, attribute) in LOADED:
                assert urlsplit(address).scheme in {"", "data"}, (page, address)
                assert not address.startswith("//"), (page, address)
    for sheet in site.rglob("*.css"):
        text = sheet.read_text(encoding="utf-8")
        assert not re.search(r"url\(\s*[\"']?(https?:)?//|@import", text), sheet


def test_every_public_name_has_a_page_that_is_listed(site: Path) -> None:
    listed = {
        address.partition("#")[2]: address.partition("#")[0]
        for _, _, address in links(site / "reference" / "api.html")
        if address.startswith("names/")
    }
    for name in set(public_names()) - {"grasp3d.__version__", "grasp3d.planar"}:
        assert name in anchors(site / "reference" / listed[name]), name
    files = [path.name.lower() for path in (site / "reference" / "names").iterdir()]
    assert len(set(files)) == len(files) > 150


def test_every_command_and_option_is_on_its_page(site: Path) -> None:
    for name, kind in KINDS.items():
        known = anchors(site / "reference" / "commands" / f"{name}.html")
        options = [one for option in options_of(kind) for one in option.names if one[1] == "-"]
        assert "--quiet" in options or name == "design"
        for option in options:
            assert f"cmdoption-grasp3d-{name}-{option.lstrip('-')}" in known, (name, option)


@pytest.mark.parametrize(
    "name", ["README.md", "CONTRIBUTING.md", "CHANGELOG.md", "meshes/README.md"]
)
def test_links_of_pages_beside_the_site_exist(name: str) -> None:
    page = ROOT / name
    for address in re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8")):
        split = urlsplit(address)
        if split.scheme in EXTERNAL:
            continue
        target = (page.parent / unquote(split.path)).resolve() if split.path else page
        assert target.exists(), address
        if split.fragment:  # of a heading, as Git hosts make them
            titles = re.findall(r"^#+ (.+)$", target.read_text(encoding="utf-8"), re.MULTILINE)
            words = (re.sub(r"[^\w -]", "", one.lower()).replace(" ", "-") for one in titles)
            assert split.fragment in words, address
