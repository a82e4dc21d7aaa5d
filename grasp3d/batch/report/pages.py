"""Writing the report's pages: the library page and the object page."""

import base64
import hashlib
import re
from collections.abc import Collection, Mapping
from datetime import UTC, datetime
from importlib.resources import files

from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.report.library import REPORT, library_data, object_list
from grasp3d.batch.report.packing import json_text
from grasp3d.batch.row import Row
from grasp3d.batch.storage.folder import Folder
from grasp3d.system.versions import package_version

COPIED = ("viewer.js", "viewer.css")
"""Files of the object page; the library page contains its scripts and styles."""

CHARSET = '<meta charset="utf-8">'
POLICY = (
    "default-src 'none'; script-src {scripts}; style-src 'self' file: 'unsafe-inline'; "
    "img-src 'self' file: data:; base-uri 'none'; form-action 'none'"
)
"""What a page may load: its own files, also from a disk, where no file is of the same origin."""

_PLACEHOLDER = re.compile(r"<!--(STYLE|SCRIPT|DATA)-->")


def write_report(output: Folder, rows: Collection[Row], settings: BatchSettings) -> None:
    """Write the pages of a library, whose objects' scripts and thumbnails are written already.

    Args:
        output: Folder of the results; the pages go to `report` below it.
        rows: All meshes, in the order of the table.
        settings: Settings of the labels.

    Raises:
        OutputError: A file cannot be written.
    """
    data = {
        "made": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "version": package_version(),
        **library_data(rows, settings),
    }
    parts = {"STYLE": _static("library.css"), "SCRIPT": _static("library.js")}
    hashed = base64.b64encode(hashlib.sha256(parts["SCRIPT"].encode("utf-8")).digest()).decode()
    parts["DATA"], objects = json_text(data), {"DATA": json_text(object_list(rows))}
    pages = {
        "index.html": _filled(_with_policy("index.html", f"'sha256-{hashed}'"), parts),
        "object.html": _filled(_with_policy("object.html", "'self' file:"), objects),
        **{name: _static(name) for name in COPIED},
    }
    for name, text in pages.items():
        output.write(f"{REPORT}{name}", text.encode("utf-8"))


def _static(name: str) -> str:
    return files(__package__).joinpath("static", name).read_text(encoding="utf-8")


def _with_policy(name: str, scripts: str) -> str:
    """A page that runs only some scripts."""
    policy = POLICY.format(scripts=scripts)
    meta = f'{CHARSET}\n<meta http-equiv="Content-Security-Policy" content="{policy}">'
    return _static(name).replace(CHARSET, meta, 1)


def _filled(page: str, parts: Mapping[str, str]) -> str:
    """Replace the placeholders of a page in one pass, so that none in a part is replaced."""
    return _PLACEHOLDER.sub(lambda match: parts[match[1]], page)
