"""The version of the installed package."""

from functools import cache


@cache
def package_version() -> str:
    """Return the version of the installed package; cached, since a look-up takes milliseconds."""
    from importlib.metadata import version  # which takes a tenth of a second to import

    return version("grasp3d")
