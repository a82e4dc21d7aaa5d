"""The examples of README and documentation: every block runs and prints what the page shows."""

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from run_examples import (
    LIBRARY,
    PAGES,
    Block,
    agree,
    commands_of,
    read_page,
    run_here,
    run_in_bash,
    run_page,
    with_outputs,
)
from sybil import Document
from sybil.parsers.markdown.lexers import FencedCodeBlockLexer

SHOWN = {"text", "bibtex", "json", "toml", "yaml", "markdown", "dockerfile"}
"""Languages of blocks that are not run."""


def has_blocks(page: Path) -> bool:
    return any(isinstance(one.parsed, Block) for one in read_page(page).examples())


@pytest.mark.slow
@pytest.mark.parametrize(
    "page", list(filter(has_blocks, PAGES)), ids=lambda page: "-".join(page.parts[-2:])
)
def test_blocks_print_what_the_page_shows(
    page: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    record_property: Callable[[str, object], None],
) -> None:
    shutil.copytree(LIBRARY, tmp_path / "meshes")
    monkeypatch.chdir(tmp_path)
    ran = run_page(read_page(page))
    record_property("blocks", ran.blocks)
    record_property("skipped", ran.skipped)
    if ran.failures:
        pytest.fail("\n".join(ran.failures), pytrace=False)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: "-".join(page.parts[-2:]))
def test_blocks_that_are_not_run_are_no_examples(page: Path) -> None:
    """Those in `bash` are scripts for a cluster."""
    document = Document(page.read_text(encoding="utf-8"), str(page))
    for block in FencedCodeBlockLexer(r"[^\n{]*")(document):
        language, source = block.lexemes["language"], block.lexemes["source"]
        script = language == "bash" and source.startswith("#!")
        assert language in {"python", "sh"} | SHOWN or script, document.line_column(block.start)


def page_with(folder: Path, text: str) -> Document:
    page = folder / "page.md"
    page.write_text(text, encoding="utf-8")
    return read_page(page)


def test_blocks_that_fail_or_print_something_else_are_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    text = "```{}\n{}\n```\n\nprints\n\n```text\none\ntwo\n```\n"
    for language, source in (("python", 'print("one\\nthree")'), ("sh", "echo one; echo three")):
        ran = run_page(page_with(tmp_path, text.format(language, source)))
        assert ran.blocks == 0
        assert re.search(
            r"page\.md:1: .*\n +one\n +- two\n +\+ three\n", ran.failures[0], re.DOTALL
        )
    failing = "```sh\necho missing >&2; false; echo more\n```\n"
    assert "missing" in run_page(page_with(tmp_path, failing)).failures[0]
    shown = f"{failing}\n```text\nmissing\n```\n"
    assert not run_page(page_with(tmp_path, shown)).failures
    raising = "```python\n1 / 0\n```\n\n```python\nprint()\n```\n"
    ran = run_page(page_with(tmp_path, raising))
    assert (ran.blocks, "ZeroDivisionError" in ran.failures[0]) == (0, True)


@pytest.mark.parametrize(
    ("shown", "printed", "alike"),
    [
        ("S 36.4 %, 92.1 N", "S 36.3 %,  92.0 N", True),
        ("S 36.4 %, 92.1 N", "S 36.1 %, 92.1 N", False),
        ("U of 36.4 %", "S of 36.4 %", False),
        ("3,603,830 candidates", "3,598,112 candidates", True),
        ("3,603,830 candidates", "3,563,112 candidates", False),
        ("19 grasps, ±45°", "19 grasps, ±46°", True),
        ("19 grasps", "20 grasps", False),
        ("27 grasps", "26 grasps", False),
        ("27 distinct grasps", "26 distinct grasps", True),
        ("27 distinct grasps", "25 distinct grasps", False),
        ("[-0.027 1.5e-07]", "[-0.026 1.7e-07]", True),
        ("[-0.027 1.5e-07]", "[0.027 1.5e-07]", False),
        ("took ... s of 5.20 s", "took 0.1 s of 5.22 s", True),
        ("mug2 (v1.0)", "mug3 (v1.0)", False),
        ("0.5", "nan", False),
    ],
)
def test_numbers_agree_within_their_last_digits(shown: str, printed: str, alike: bool) -> None:
    assert agree(shown, printed) is alike


def test_scripts_of_nothing_but_commands_need_no_bash() -> None:
    words = ["grasp3d", "label", "my mug.glb", "--task", "weight, 1"]
    script = "grasp3d label 'my mug.glb' \\\n    --task \"weight, 1\"\n"
    assert commands_of(f"{script}grasp3d --version\n") == [words, ["grasp3d", "--version"]]
    for of_bash in ("ls", "grasp3d --version; ls", "grasp3d check a | wc", "grasp3d check $mesh",
                    "grasp3d check *", "grasp3d check >a", "A=1 grasp3d check", "grasp3d  # no",
                    "grasp3ds", "\n"):  # fmt: skip
        assert commands_of(f"{script}{of_bash}\n") == []


@pytest.mark.slow
def test_commands_print_the_same_here_as_in_bash(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for script in (
        "grasp3d --version\ngrasp3d design --fingertip-radius 1cm --receptive-field 4mm",
        "grasp3d --version\ngrasp3d check none.stl\ngrasp3d --version",
        "grasp3d label --frictoin 0.5\ngrasp3d --version",
    ):
        here, in_bash = run_here(commands_of(script)), run_in_bash(script)
        assert (here.returncode, here.stdout, here.stderr) == (
            in_bash.returncode, in_bash.stdout, in_bash.stderr,
        )  # fmt: skip


def test_blocks_go_on_from_each_other_and_their_outputs_can_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    text = (
        '```python\nfrom pathlib import Path\nPath("file").write_text("here 12.5 s")\n```\n'
        '<!-- skip: next "needs a window" -->\n\n```sh\nfalse\n```\n'
        "```sh\ncat file\n```\n\n```text\nhere ... s\n```\n"
        '```python\nprint(Path("file").name)\n```\n\n```text\nold\n```\n'
    )
    document = page_with(tmp_path, text)
    ran = run_page(document)
    assert (ran.blocks, ran.skipped, len(ran.failures)) == (2, ["needs a window"], 1)
    assert with_outputs(document) == text.replace("old", "file")
