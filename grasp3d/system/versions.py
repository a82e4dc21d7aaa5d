"""Which grasp3d this is."""

from functools import cache
from importlib.metadata import version


@cache
def package_version() -> str:
    """Version of the package as it was installed; looked up once, since it takes milliseconds."""
    return version("grasp3d")
