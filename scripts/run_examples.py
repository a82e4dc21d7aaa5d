"""Run the examples in pages, blocks of Python and shell, and compare them with shown output.

The blocks of a page run in order, in one folder that contains `meshes/`, and share variables. A
block of `text` that follows, with at most one line such as "prints" between, is the expected
output, in which `...` matches anything. Numbers may differ by what another processor changes: two
units of the last digit shown. Whole numbers may differ by 1 % (so those below 100 may not), or by
one if a unit follows. `<!-- skip: next "the reason" -->` skips a block.

Shell blocks run in bash. Those with only `grasp3d` commands run in this process, as starting a new
one for each would take seconds, except on the page that users follow first.

    python scripts/run_examples.py [--write] [PAGE ...]

prints what differs, or writes the outputs into the pages, for intended changes of results.
"""

import argparse
import doctest
import io
import os
import re
import shlex
import shutil
import subprocess
import sys
import traceback
from collections.abc import Iterator
from contextlib import chdir, redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from decimal import Decimal, InvalidOperation
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest import SkipTest, mock

from sybil import Document, Example, Region
from sybil.evaluators.python import PythonEvaluator
from sybil.example import SybilFailure
from sybil.parsers.markdown import SkipParser
from sybil.parsers.markdown.lexers import FencedCodeBlockLexer
from sybil.region import Lexeme

from grasp3d import cli

ROOT = Path(__file__).resolve().parents[1]
LIBRARY = ROOT / "meshes"
GENERATED = {"_build", "commands", "files"}
"""Folders of generated pages."""
PAGES = (
    ROOT / "README.md",
    LIBRARY / "README.md",
    *(
        page
        for page in sorted((ROOT / "docs").rglob("*.md"))
        if not GENERATED & set(page.relative_to(ROOT).parts)
    ),
)

OUTPUT = re.compile(
    r"\n(?:\s*\n[^\n`#|<>]{1,80}\n)?\s*\n```text\n(?P<text>.*?)^```$", re.MULTILINE | re.DOTALL
)
OF_BASH = re.compile(r"[|&;<>$`(){}*?\[\]~#!]")
"""Characters that bash would expand, redirect or remove unless they are quoted."""
FLAGS = doctest.ELLIPSIS | doctest.REPORT_NDIFF
NUMBER = re.compile(
    r"(?<![\w.,])(?P<value>-?\d+(?:,\d{3})*(?:\.\d+)?(?:e[+-]?\d+)?)"
    r"(?P<unit>(?:°| ?(?:%|N|mm|cm|m|kg|g|distinct)(?!\w))?)(?![\w.,]?\d)"
)
"""A number that stands alone, and the unit after it; one of distinct grasps depends on rounding."""
MOST_SECONDS = 300.0
"""Time limit of a block in bash [s]; the test limits blocks in this process."""

ALL_IN_BASH = ROOT / "README.md"
"""The page whose commands are run exactly as users run them."""

ENVIRONMENT = {"COLUMNS": "80", "NO_COLOR": "1"}
"""Variables that make the output of commands independent of the terminal."""


@dataclass
class Block:
    """A block of a page."""

    source: Lexeme
    expected: re.Match[str] | None
    """Output of the block, if the page shows it."""
    printed: str = ""

    def difference(self) -> str | None:
        """Return what differs from the expected output, or None."""
        if self.expected is None:
            return None
        want, got = unpadded(self.expected["text"]), unpadded(self.printed)
        checker = doctest.OutputChecker()
        if checker.check_output(want, got, FLAGS):
            return None
        flags = FLAGS | doctest.DONT_ACCEPT_BLANKLINE
        if agree(want, got):
            return None
        lines = checker.output_difference(doctest.Example("", want), got, flags)
        return f"printed something else\n{lines}"


@dataclass
class Ran:
    """Results of the blocks of a page."""

    blocks: int = 0
    skipped: list[str] = field(default_factory=list)
    """Reasons for skipping blocks."""
    failures: list[str] = field(default_factory=list)


def read_page(path: Path) -> Document:
    """Read a page, whose examples are its blocks and its comments on skipping them."""
    return Document.parse(str(path), blocks_of, SkipParser())


def blocks_of(document: Document) -> Iterator[Region]:
    """Yield the blocks of a page that are run."""
    for language, evaluate in (("python", run_python), ("sh", run_shell)):
        for found in FencedCodeBlockLexer(language)(document):
            expected = OUTPUT.match(document.text, found.end)
            block = Block(found.lexemes["source"], expected)
            yield Region(found.start, expected.end() if expected else found.end, block, evaluate)


def run_page(document: Document) -> Ran:
    """Run the blocks of a page in this folder, up to a Python block that raises an exception."""
    ran = Ran()
    document.namespace["__name__"] = "page"
    for example in document.examples():
        where = f"{Path(example.path).name}:{example.line}"
        try:
            example.evaluate()
        except SkipTest as reason:
            ran.skipped.append(str(reason))
        except SybilFailure as failure:
            ran.failures.append(f"{where}: {failure.result}")
        except Exception:  # noqa: BLE001, whatever an example raises
            ran.failures.append(f"{where} raised\n{traceback.format_exc(limit=-3)}")
            break
        else:
            ran.blocks += isinstance(example.parsed, Block)
    return ran


def run_python(example: Example) -> str | None:
    """Run a block with the variables of the page; return what differs."""
    block: Block = example.parsed
    out = io.StringIO()
    code = Example(example.document, example.line, example.column, example.region, {})
    code.parsed, code.namespace = block.source, example.namespace
    with redirect_stdout(out):
        PythonEvaluator()(code)
    block.printed = out.getvalue()
    return block.difference()


def run_shell(example: Example) -> str | None:
    """Run a block like bash, up to the first command that fails; return what differs.

    A command may fail if the page shows its output, including standard error.
    """
    block: Block = example.parsed
    commands = [] if Path(example.path) == ALL_IN_BASH else commands_of(block.source)
    done = run_here(commands) if commands else run_in_bash(block.source)
    block.printed = done.stdout if done.returncode == 0 else done.stdout + done.stderr
    if done.returncode and block.expected is None:
        return f"ended with exit code {done.returncode} and printed\n{block.printed}"
    return block.difference()


def run_in_bash(source: str) -> subprocess.CompletedProcess[str]:
    """Run a script in a new process."""
    return subprocess.run(  # noqa: S603, pages of this project
        [shutil.which("bash") or "bash", "-e", "-c", source],
        check=False,
        capture_output=True,
        text=True,
        timeout=MOST_SECONDS,
        env={**os.environ, "PATH": path_with_commands(), **ENVIRONMENT},
    )


def commands_of(source: str) -> list[list[str]]:
    """Words of each command in a script of only `grasp3d` commands; empty if it needs bash."""
    lines = source.replace("\\\n", " ").splitlines()
    alone = all(re.match(r"grasp3d\b", line) for line in lines)
    return [shlex.split(line) for line in lines] if alone and not OF_BASH.search(source) else []


def run_here(commands: list[list[str]]) -> subprocess.CompletedProcess[str]:
    """Run `grasp3d` commands in this process, up to the first that fails."""
    out, err = (io.TextIOWrapper(io.BytesIO(), encoding="utf-8") for _ in range(2))
    code, environment = 0, mock.patch.dict(os.environ, ENVIRONMENT)
    with environment, redirect_stdout(out), redirect_stderr(err):
        for _, *words in commands:
            try:
                code = cli.main(words)
            except SystemExit as ended:  # usage errors
                code = ended.code if isinstance(ended.code, int) else int(ended.code is not None)
            if code:
                break
    return subprocess.CompletedProcess(commands, code, printed_to(out), printed_to(err))


def printed_to(stream: io.TextIOWrapper) -> str:
    """Return what was printed to a stream in memory."""
    stream.seek(0)
    return stream.read()


def path_with_commands() -> str:
    """Search path for programs, beginning with those of this environment."""
    return os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])


def agree(want: str, got: str) -> bool:
    """Whether two outputs agree, except for spaces and numbers within their tolerance."""
    parts, numbers, end = list[str](), list[re.Match[str]](), 0
    for number in NUMBER.finditer(want):
        parts += [_pattern(want[end : number.start()]), r"(\S+?)"]
        numbers.append(number)
        end = number.end("value")
    alike = re.fullmatch("".join([*parts, _pattern(want[end:])]), got, re.DOTALL)
    return alike is not None and all(
        is_near(number, other) for number, other in zip(numbers, alike.groups(), strict=True)
    )


def _pattern(text: str) -> str:
    """Pattern for text without numbers: `...` matches anything; runs of spaces may differ."""
    words = (re.sub(r"(?:\\ )+", r" +", re.escape(one)) for one in text.split("..."))
    return ".*?".join(words)


def is_near(number: re.Match[str], other: str) -> bool:
    """Whether another number is as near to a shown one as the shown digits allow."""
    try:
        want, got = (Decimal(one.replace(",", "")) for one in (number["value"], other))
    except InvalidOperation:
        return False
    exponent = want.as_tuple().exponent
    assert isinstance(exponent, int)
    if exponent < 0 or "e" in number["value"]:
        most = 2 * Decimal(1).scaleb(exponent)
    else:
        most = Decimal(1) if number["unit"] else abs(want) / 100
    return got.is_finite() and abs(got - want) <= most


def unpadded(text: str) -> str:
    """Strip spaces at the ends of lines, and end the text with one newline."""
    return "\n".join(line.rstrip() for line in text.strip("\n").splitlines()) + "\n"


def with_outputs(document: Document) -> str:
    """Text of a page with differing outputs replaced."""
    text = document.text
    for example in reversed(list(document.examples())):
        block = example.parsed
        if isinstance(block, Block) and block.expected and block.printed and block.difference():
            start, end = block.expected.span("text")
            text = text[:start] + unpadded(block.printed) + text[end:]
    return text


def main() -> int:
    """Run the examples of pages; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else "")
    parser.add_argument("pages", nargs="*", type=Path, default=PAGES)
    parser.add_argument("--write", action="store_true", help="write outputs into the pages")
    options = parser.parse_args()
    failures = 0
    for page in options.pages:
        document = read_page(page.resolve())
        with TemporaryDirectory() as folder, chdir(folder):
            shutil.copytree(LIBRARY, "meshes")
            ran = run_page(document)
        print(f"{page}: {ran.blocks} blocks ran, {len(ran.skipped)} skipped")
        print(*ran.failures, sep="\n", end="\n" if ran.failures else "")
        failures += len(ran.failures)
        if options.write:
            page.write_text(with_outputs(document), encoding="utf-8")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
