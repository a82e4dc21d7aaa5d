"""The examples in docstrings."""

import doctest
import importlib
import io
import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from run_examples import FLAGS, LIBRARY, ROOT

from tests.helpers.public_names import public_names
from tests.test_layers import LAYERS


def modules_with_examples() -> Iterator[str]:
    for path in sorted((ROOT / "grasp3d").rglob("*.py")):
        if ">>> " in path.read_text(encoding="utf-8"):
            yield ".".join(path.relative_to(ROOT).with_suffix("").parts)


@pytest.mark.slow
@pytest.mark.parametrize("name", list(modules_with_examples()))
def test_examples_of_docstrings_print_what_they_show(
    name: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    record_property: Callable[[str, object], None],
) -> None:
    shutil.copytree(LIBRARY, tmp_path / "meshes")
    monkeypatch.chdir(tmp_path)
    found = doctest.DocTestFinder().find(importlib.import_module(name), globs={})
    examples = [one for one in found if one.examples]
    assert examples
    report = io.StringIO()
    for example in examples:
        doctest.DocTestRunner(optionflags=FLAGS).run(example, out=report.write)
    record_property("blocks", len(examples))
    assert not report.getvalue(), report.getvalue()


@pytest.mark.slow
def test_the_names_used_most_have_examples() -> None:
    texts = {name: getattr(value, "__doc__", None) or "" for name, value in public_names().items()}
    assert sum(">>> " in text for text in texts.values()) >= 20


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
