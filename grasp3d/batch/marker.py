"""The marker file of a store of results, and checks of folders without a marker."""

import json
from datetime import UTC, datetime

from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.folders import MARKER, STORED
from grasp3d.batch.identity import METHOD, settings_text
from grasp3d.batch.row import Row
from grasp3d.batch.storage import Folder
from grasp3d.errors import OutputError
from grasp3d.system.names import printable
from grasp3d.system.tables import unpack_records
from grasp3d.system.versions import package_version

FORMAT = 2
"""Version of the store's files; other versions of grasp3d may be unable to read them."""


def read_marker(output: Folder) -> tuple[bytes | None, bool]:
    """Read the marker of a store, or check that a folder without a marker can become a store.

    Args:
        output: Folder for the results.

    Returns:
        (the marker's content, None where there is none; whether it is valid).

    Raises:
        OutputError: Another version wrote the store, or the folder contains
            other files in the folders of a store.
    """
    try:
        data = output.read(MARKER)
    except FileNotFoundError:
        _check_free(output)
        return None, False
    try:
        marker = json.loads(data)
        version = int(marker["format"])
    except (KeyError, TypeError, ValueError):
        return data, False
    if version != FORMAT:
        age, remedy = ("a newer", "update grasp3d, or ") if version > FORMAT else ("an older", "")
        raise OutputError(
            f"{printable(output.url)}: is a store of {age} version of grasp3d "
            f"({printable(str(marker.get('version')))}); {remedy}name another folder"
        )
    return data, True


def marker_content(settings: BatchSettings) -> bytes:
    """Content of the marker of a store with these settings."""
    marker = {
        "format": FORMAT,
        "version": package_version(),
        "method": METHOD,
        "settings": json.loads(settings_text(settings)),
    }
    return (json.dumps(marker, indent=1) + "\n").encode()


def set_aside(output: Folder, name: str, data: bytes) -> str:
    """Move a damaged file to `damaged/`; returns its new name."""
    now = datetime.now(UTC).strftime("%Y%m%dT%H%M%S.%f")
    new_name = f"damaged/{now}-{name.replace('/', '-')}"
    output.write(new_name, data)
    output.remove(name)
    return new_name


def _check_free(output: Folder) -> None:
    """Refuse a folder without marker whose files a store would read or replace."""
    summary = output.names("summary")
    if summary and all(_is_summary(output, name) for name in summary):
        return  # the summary of a store without its marker
    for folder in STORED:
        for name in output.names(folder):
            raise OutputError(
                f"{printable(output.url)}: contains a folder {folder} that grasp3d has not written "
                f"({printable(name)}); name another folder"
            )


def _is_summary(output: Folder, name: str) -> bool:
    """Whether a file is part of a summary."""
    try:
        unpack_records(output.read(name), Row)
    except (ValueError, FileNotFoundError):
        return False
    return True
