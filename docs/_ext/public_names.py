"""Public names: a list of those of each package, a page for each, and links to them.

The names that packages export are public, those of modules that are no packages, and the classes
that their annotations name, such as the parts of a result.
"""

import ast
import importlib
import inspect
import pkgutil
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

from docutils import nodes
from generated_pages import replace_markers, write_pages
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.pycode import ModuleAnalyzer

import grasp3d

PAGE, FOLDER, MARKER = "reference/api", "names", r"<!-- names: ([\w ,]+) -->"
MODULES = ("errors", "datasets")
"""Modules beside the packages, whose own names are public."""
FURTHER = ("Circle", "Outline", "OutlineContacts", "PlanarScan", "Square", "scan", "close_jaws",
           "friction_interval", "mean_sweep", "preset_names", "reach_grasps", "validation_figure",
           "write_hand", "write_sweeps")  # fmt: skip
"""Names that no package exports, but that are called."""
HIDDEN = ("grasp3d._kernels", "grasp3d.arrays", "grasp3d.cli", "grasp3d.pictures", "grasp3d.viewer")
"""Where classes are parts of the program alone."""

_MEMBERS = {"attribute", "method", "property"}
_QUOTED = re.compile(r"(?<!`)`([A-Z]\w+)`")
_WORD = re.compile(r"[A-Za-z_]\w*")


@cache
def defined() -> dict[str, str]:
    """Full name of each class and function of the package, by its own name."""
    found: dict[str, str] = {}
    for info in pkgutil.walk_packages(grasp3d.__path__, "grasp3d."):
        if info.name.startswith(HIDDEN) or info.name.endswith("__main__"):
            continue
        module = importlib.import_module(info.name)
        for name, value in vars(module).items():
            if not name.startswith("_") and getattr(value, "__module__", "") == info.name:
                found.setdefault(name, f"{info.name}.{name}")
    return found


@cache
def exported() -> dict[str, str]:
    """Public names that packages and modules export, by the full name of what they are."""
    found: dict[str, str] = {}
    folder = Path(grasp3d.__file__).parent
    packages = (
        "grasp3d",
        *sorted(f"grasp3d.{one.parent.name}" for one in folder.glob("*/__init__.py")),
    )
    for package in map(importlib.import_module, packages):
        for name in getattr(package, "__all__", ()):
            if not inspect.ismodule(getattr(package, name)) and name != "__version__":
                found.setdefault(
                    defining_name(f"{package.__name__}.{name}"), f"{package.__name__}.{name}"
                )
    for short, name in defined().items():
        if name.split(".")[1] in MODULES or short in FURTHER:
            found.setdefault(name, name)
    return found


@cache
def public() -> dict[str, str]:
    """Names with a page, by the full name of what they are: with the classes they are made of."""
    found, new = dict(exported()), list(exported())
    while new:
        for short in set(_WORD.findall(" ".join(_named_by(resolve_name(new.pop()))))):
            full = defined().get(short)
            if full and full not in found and inspect.isclass(resolve_name(full)):
                found[full] = full
                new.append(full)
    return found


def _named_by(value: object) -> Iterator[str]:
    """The annotations of a function, or of a class and its members, and the names in its texts."""
    if inspect.isclass(value):
        for one in (base for base in value.__mro__ if base.__module__.startswith("grasp3d")):
            yield one.__name__
            yield from map(str, inspect.get_annotations(one).values())
            yield from _QUOTED.findall(inspect.getsource(one))
            for member in vars(one).values():
                yield from _named_by(getattr(member, "func", getattr(member, "fget", member)))
    elif inspect.isfunction(value):
        yield from map(str, value.__annotations__.values())


def listed(packages: str) -> str:
    """A summary of the names that are defined in packages, as a block of reStructuredText."""
    chosen = packages.replace(",", " ").split()
    names = [
        name for full, name in (public() if chosen == ["types"] else exported()).items()
        if (full not in exported() if chosen == ["types"] else full.split(".")[1] in chosen)
    ]  # fmt: skip
    names = sorted(names, key=lambda name: (name.count("."), name.rpartition(".")[2].lower()))
    if chosen == ["types"]:
        return ", ".join(f"{{py:obj}}`~{name}`" for name in names) + "."
    lines = "\n".join(f"   {name}" for name in names)
    return f"```{{eval-rst}}\n.. autosummary::\n   :nosignatures:\n\n{lines}\n```"


def page_of(name: str) -> str:
    """The page of a public name."""
    value, title = resolve_name(name), name.rpartition(".")[2]
    directive, options = "autofunction" if callable(value) else "autodata", ""
    if inspect.isclass(value):
        directive = "autoclass"
        if {defined().get(base.__name__) for base in value.__bases__} & set(public()):
            options = "   :show-inheritance:\n"
    return (
        f":orphan:\n\n{title}\n{'=' * len(title)}\n\n:doc:`/{PAGE}`\n\n"
        f".. {directive}:: {name}\n{options}"
    )


def write_all(app: Sphinx) -> None:
    """Write the page of each public name."""
    pages: dict[str, str] = {}
    taken: set[str] = set()  # in small letters, as some file systems do not tell them apart
    for name in sorted(public().values(), reverse=True):
        file = name if name.lower() not in taken else f"{name}-2"
        taken.add(file.lower())
        pages[f"{file}.rst"] = page_of(name)
    write_pages(Path(app.srcdir) / "reference" / FOLDER, pages)


def defining_name(name: str) -> str:
    """The full name of what a public name is, by the imports of its package.

    Raises:
        KeyError: The package does not import this name.
    """
    package, _, short = name.rpartition(".")
    folder = Path(grasp3d.__file__).parents[1].joinpath(*package.split("."))
    if not folder.is_dir():
        return name
    stub = folder / "__init__.pyi"
    tree = ast.parse((stub if stub.exists() else folder / "__init__.py").read_text("utf-8"))
    for node in tree.body:
        if isinstance(node, ast.ImportFrom):
            for one in node.names:
                if short == (one.asname or one.name):
                    start = f"{package}." if node.level else ""
                    return defining_name(f"{start}{node.module}.{one.name}")
    raise KeyError(name)


def document_data(
    _app: Sphinx, what: str, name: str, _value: object, _options: object, lines: list[str]
) -> None:
    """Take the text on a constant from the module that defines it."""
    if what == "data":
        module, _, short = defining_name(name).rpartition(".")
        lines[:] = ModuleAnalyzer.for_module(module).find_attr_docs()["", short]


def resolve(
    app: Sphinx, env: BuildEnvironment, node: pending_xref, content: nodes.TextElement
) -> nodes.Element | None:
    """Find a name where it is public: `grasp3d.contact.contacts.Contacts` as `grasp3d.Contacts`."""
    if node.get("refdomain") != "py":
        return None
    python, target = env.domains.python_domain, node["reftarget"]
    if node["reftype"] == "class":  # an annotation
        target = target.rpartition(".")[2]
    found = [
        name
        for name, entry in python.find_obj(env, "", "", target, None, searchmode=1)
        if "." in target or entry.objtype not in _MEMBERS  # the name of a parameter, perhaps
    ]
    if not found:
        return None
    name = min(found, key=len)
    return python.resolve_xref(env, node["refdoc"], app.builder, "obj", name, node, content)


def setup(app: Sphinx) -> dict[str, Any]:
    """Write the pages before they are read; resolve what the Python domain has not found."""
    app.connect("builder-inited", write_all)
    app.connect("missing-reference", resolve)
    app.connect("autodoc-process-docstring", document_data)
    replace_markers(app, PAGE, {MARKER: listed})
    return {"parallel_read_safe": True, "parallel_write_safe": True}
