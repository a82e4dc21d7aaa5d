"""The version of the installed package."""

import re
from functools import cache


@cache
def package_version() -> str:
    """Return the version of the installed package; cached, since a look-up takes milliseconds."""
    from importlib.metadata import version  # which takes a tenth of a second to import

    return version("grasp3d")


def newer_version(version: object) -> str:
    """Why a file of that version of the package is refused; empty: it is not.

    Args:
        version: As the file states it. Versions that differ in the third number alone are read.

    Example:
        >>> from grasp3d.system.versions import newer_version
        >>> newer_version("99.0.0")[:51]
        'was written by grasp3d 99.0.0, which is newer than '
    """
    own = package_version()
    theirs, ours = (
        [int(one) for one in re.findall(r"\d{1,9}", str(text))[:2]] for text in (version, own)
    )
    if theirs <= ours:
        return ""
    stated = str(version)[:20]
    return f"was written by grasp3d {stated}, which is newer than this one, {own}; update it"
