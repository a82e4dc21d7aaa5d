"""The version of the installed package."""

from functools import cache
from importlib.metadata import version


@cache
def package_version() -> str:
    """Return the version of the installed package; cached, since a look-up takes milliseconds."""
    return version("grasp3d")
