"""The first page of the report: a table of all meshes, which a browser can sort and filter."""

import base64
import hashlib
from collections import Counter
from collections.abc import Collection, Sequence
from datetime import UTC, datetime
from functools import cache
from typing import Any
from urllib.parse import quote

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from upath import UPath

from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.row import COLUMNS, Outcome, Row, headed
from grasp3d.quality.loads import load_settings
from grasp3d.settings.grasp_model import SAFE_LABELS
from grasp3d.settings.parsing import plain_values
from grasp3d.stability.label import COLORS, MEANING, Label, hex_color
from grasp3d.system.documents import package_version
from grasp3d.system.names import counted, printable
from grasp3d.system.places import writing

REPORT = "report/index.html"
"""Path of the page below the output folder."""


SHOWN = (
    "mesh", "outcome", "error", "unit", "verdict", "verdict_text", "causes", "stable", "ambiguous",
    "no_grasp_found", "warnings", "page", "thumbnail", "surface",
    *(name for name, column in COLUMNS.items() if column.heading),
)  # fmt: skip
"""Columns of the rows that the page needs."""


def write_report(folder: UPath, rows: Collection[Row], settings: BatchSettings) -> None:
    """Write the first page of a library, once the pages of its meshes exist.

    Args:
        folder: Folder of the results; the page goes to `report` below it.
        rows: All meshes, with the columns `SHOWN`, in the order of the table.
        settings: Settings of the labels.

    Raises:
        OutputError: The page cannot be written.
    """
    columns, counts = headed(rows), Counter(row.outcome for row in rows)
    script, _, _ = environment().loader.get_source(environment(), "index.js")  # type: ignore[union-attr]
    page = environment().get_template("index.html").render(
        data=_data(list(rows), list(columns)),
        columns=columns.values(),
        counts=[(f"{counts[outcome]:,}", outcome) for outcome in Outcome],
        settings=_plain(settings),
        certainty=SAFE_LABELS if settings.model.location_error != 0.0 else "",
        script=Markup(script),  # noqa: S704, our own file
        hash=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
        meshes=counted(len(rows), "meshes"),
        made=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
    )  # fmt: skip
    with writing(folder / REPORT) as part:
        part.write_text(page, encoding="utf-8")


@cache
def environment() -> Environment:
    """Return the templates with their common values; each text is escaped, on one line."""
    found = Environment(
        loader=PackageLoader("grasp3d.batch", "report"), autoescape=True, finalize=_on_one_line,
        undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    found.globals |= {
        "address": address,
        "meaning": {label.name: MEANING["label"][label] for label in sorted(Label)[::-1]},
        "colors": {label.name: hex_color(COLORS[label]) for label in Label},
        "version": package_version(),
    }
    return found


def _on_one_line(value: object) -> object:
    """Return a value as the text of an element; markup stays as it is."""
    return value if isinstance(value, Markup) else printable(str(value))


def address(path: str, page: str = REPORT) -> str:
    """Address of a file below the output folder, from a page in it; empty if there is no file."""
    return f"{'../' * page.count('/')}{quote(path)}" if path else ""


def _data(rows: Sequence[Row], names: Sequence[str]) -> dict[str, Any]:
    """Return the data of the table, as lists with an entry for each mesh."""
    labelled = [row.outcome is Outcome.LABELLED for row in rows]
    reasons = (row.error or (row.verdict_text or "").partition(": ")[2] for row in rows)
    return {
        "mesh": [printable(row.mesh) for row in rows],
        "verdict": [row.verdict or row.outcome for row in rows],
        "why": [*map(printable, reasons)],
        "causes": [printable(row.causes or "") for row in rows],
        "parts": [[row.stable, row.ambiguous, row.no_grasp_found] for row in rows],
        "note": [printable(row.warnings) for row in rows],
        "cells": [
            [row.text(name) if found else "" for row, found in zip(rows, labelled, strict=True)]
            for name in names
        ],
        "files": [
            {
                name: address(path)
                for name, path in (
                    ("page", row.page), ("thumbnail", row.thumbnail),
                    ("labels", row.surface if row.surface.endswith(".ply") else ""),
                )
                if path
            }
            for row in rows
        ],
    }  # fmt: skip


def _plain(settings: BatchSettings) -> dict[str, str]:
    """Return the settings as in labelled files."""
    hands = ", ".join(hand.name for hand in settings.hands)
    reach = plain_values(settings.reach) | {"hand": hands} if hands else {}
    load = {} if settings.load is None else load_settings(settings.load)
    values: dict[str, Any] = {
        **plain_values(settings.model),
        **plain_values(settings.sampling),
        **reach,
        **load,
        **plain_values(settings.mesh),
    }
    return {name: str(value) for name, value in values.items()}
