"""The public names of the package."""

import importlib
from pathlib import Path

import grasp3d


def public_names() -> dict[str, object]:
    """Every public name with its value, once each, by its shortest import."""
    folder = Path(grasp3d.__file__).parent
    packages = ["grasp3d", *(f"grasp3d.{one.parent.name}" for one in folder.glob("*/__init__.py"))]
    found: dict[str, object] = {}
    for package in map(importlib.import_module, packages):
        for name in getattr(package, "__all__", ()):
            value = getattr(package, name)
            if not any(value is other for other in found.values()):
                found[f"{package.__name__}.{name}"] = value
    return found
