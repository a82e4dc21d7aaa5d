"""The report's pages: the table of a library, and the page that shows its objects."""

import re
from collections.abc import Collection, Mapping
from datetime import UTC, datetime
from importlib.resources import files
from typing import Protocol

from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.report.library import library_data, object_list
from grasp3d.batch.report.packing import json_text
from grasp3d.batch.row import Row
from grasp3d.system.versions import package_version

FOLDER = "report/"
"""Of the report, below the output folder."""

COPIED = ("viewer.js", "viewer.css")
"""Files beside the pages; what the first page needs stands in it."""

_PLACE = re.compile(r"<!--(STYLE|SCRIPT|DATA)-->")


class Writable(Protocol):
    """A folder that files can be written to."""

    def write(self, name: str, data: bytes) -> None:
        """Write a file whole or not at all.

        Args:
            name: Below the folder.
            data: What it holds.
        """


def write_report(output: Writable, rows: Collection[Row], settings: BatchSettings) -> None:
    """Write the pages of a library; the scripts and pictures of its meshes lie there already.

    Args:
        output: Folder of the results; the pages go to `report` below it.
        rows: All meshes, in the order in which they are listed.
        settings: What they were labelled with.

    Raises:
        OutputError: A file cannot be written.
    """
    told = {
        "made": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "version": package_version(),
        **library_data(rows, settings),
    }
    parts = {"STYLE": _static("library.css"), "SCRIPT": _static("library.js")}
    _write(output, "index.html", _filled(_static("index.html"), {**parts, "DATA": json_text(told)}))
    objects = json_text(object_list(rows))
    _write(output, "object.html", _filled(_static("object.html"), {"DATA": objects}))
    for name in COPIED:
        _write(output, name, _static(name))


def _static(name: str) -> str:
    return files(__package__).joinpath("static", name).read_text(encoding="utf-8")


def _filled(page: str, parts: Mapping[str, str]) -> str:
    """Put each part in its place, in one pass: what a part holds is never taken for a place."""
    return _PLACE.sub(lambda place: parts[place[1]], page)


def _write(output: Writable, name: str, text: str) -> None:
    output.write(f"{FOLDER}{name}", text.encode("utf-8"))
