"""The picture of the layers on the page on developing is that of the tests."""

import re

from tests.test_layers import LAYERS, ROOT

TEXT = (ROOT / "docs" / "developing.md").read_text(encoding="utf-8")
LAYER = re.compile(r"^\w+(?:/|\.py)", re.MULTILINE)


def test_the_picture_has_the_layers_of_the_tests() -> None:
    """The highest first; packages have a slash, modules are files."""
    picture = TEXT.partition("<!-- layers -->")[2].split("```")[1].removeprefix("text\n")
    drawn = [set(LAYER.findall(layer)) for layer in picture.split("\n\n")]
    package = ROOT / "grasp3d"
    assert drawn == [
        {f"{name}/" if (package / name).is_dir() else f"{name}.py" for name in layer.split()}
        for layer in reversed(LAYERS)
    ]
    found = {f"{one.parent.name}/" for one in package.glob("*/__init__.py")}
    assert found == {one for one in set().union(*drawn) if one.endswith("/")}


def test_modules_and_scripts_that_the_page_names_exist() -> None:
    named = [one for one in re.findall(r"`((?:[\w.]+/)+[\w.]*)`", TEXT) if "NAME" not in one]
    assert len(named) > 20
    folders = (ROOT, ROOT / "grasp3d")
    assert [one for one in named if not any((root / one).exists() for root in folders)] == []
