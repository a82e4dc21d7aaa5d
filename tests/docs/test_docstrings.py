"""The examples in docstrings."""

import doctest
import importlib
import io
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from run_examples import FLAGS, LIBRARY, ROOT

from tests.helpers.public_names import public_names


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
