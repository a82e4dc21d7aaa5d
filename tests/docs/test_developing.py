"""The picture of the layers on the page on developing is that of the tests."""

import re
from pathlib import Path

from tests.test_layers import LAYERS, ROOT

PAGE = ROOT / "docs" / "developing.md"


def drawn_layers() -> list[set[str]]:
    """Packages and modules of each layer in the picture, the highest first."""
    picture = PAGE.read_text(encoding="utf-8").partition("<!-- layers -->")[2].split("```")[1]
    return [
        set(re.findall(r"^(\w+)(?:/|\.py)", layer, re.MULTILINE))
        for layer in picture.removeprefix("text\n").split("\n\n")
    ]


def test_the_picture_has_the_layers_of_the_tests() -> None:
    assert drawn_layers() == [set(layer.split()) for layer in reversed(LAYERS)]


def test_packages_have_a_slash_in_the_picture_and_modules_are_files() -> None:
    picture = PAGE.read_text(encoding="utf-8").partition("<!-- layers -->")[2].split("```")[1]
    drawn = re.findall(r"^\w+(?:/|\.py)", picture, re.MULTILINE)
    package = ROOT / "grasp3d"
    found = {f"{one.parent.name}/" for one in package.glob("*/__init__.py")}
    assert found == {one for one in drawn if one.endswith("/")}
    assert [one for one in drawn if not one.endswith("/") and not (package / one).is_file()] == []


def test_modules_and_scripts_that_the_page_names_exist() -> None:
    text = PAGE.read_text(encoding="utf-8")
    named = re.findall(r"`((?:[\w.]+/)+[\w.]*)`", text)
    assert len(named) > 20
    missing = [
        name
        for name in named
        if "NAME" not in name
        and not any(Path(folder, name).exists() for folder in (ROOT, ROOT / "grasp3d"))
    ]
    assert missing == []
