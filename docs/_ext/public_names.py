"""Public names: a page for each, where their packages load them, and links to them."""

import ast
import inspect
import re
from pathlib import Path
from pkgutil import resolve_name

from command_pages import write_pages
from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.pycode import ModuleAnalyzer

import grasp3d

FOLDER = "names"
"""Folder of the pages, beside those that list the names."""

_MEMBERS = {"attribute", "method", "property"}
_LISTED = re.compile(r"^   (grasp3d\.[\w.]+)$", re.MULTILINE)


def names_on(page: Path) -> list[str]:
    """The public names that a page lists in its summaries."""
    return _LISTED.findall(page.read_text(encoding="utf-8"))


def page_of(name: str, listed_on: Path) -> str:
    """The page of a public name, with a link to the page that lists it."""
    value, title = resolve_name(name), name.rpartition(".")[2]
    if inspect.isclass(value):
        directive = "autoclass"
    else:
        directive = "autofunction" if callable(value) else "autodata"
    return (
        f":orphan:\n\n{title}\n{'=' * len(title)}\n\n:doc:`/api/{listed_on.stem}` of the "
        f":doc:`/api/index`\n\n.. {directive}:: {name}\n"
    )


def write_all(app: Sphinx) -> None:
    """Write the page of each name that is listed."""
    folder = Path(app.srcdir) / "api"
    listed = {name: page for page in sorted(folder.glob("*.md")) for name in names_on(page)}
    pages: dict[str, str] = {}
    taken: set[str] = set()  # in small letters, as some file systems do not tell them apart
    for name in sorted(listed, reverse=True):
        file = name if name.lower() not in taken else f"{name}-2"
        taken.add(file.lower())
        pages[f"{file}.rst"] = page_of(name, listed[name])
    write_pages(folder / FOLDER, pages)


def defining_module(name: str) -> str:
    """The module that defines a public name, by the imports of its package.

    Raises:
        KeyError: The package does not import this name.
    """
    package, _, short = name.rpartition(".")
    folder = Path(grasp3d.__file__).parents[1].joinpath(*package.split("."))
    if not folder.is_dir():
        return package
    stub = folder / "__init__.pyi"
    tree = ast.parse((stub if stub.exists() else folder / "__init__.py").read_text("utf-8"))
    for node in tree.body:
        if isinstance(node, ast.ImportFrom) and short in {
            one.asname or one.name for one in node.names
        }:
            return f"{package}.{node.module}" if node.level else str(node.module)
    raise KeyError(name)


def document_data(
    _app: Sphinx, what: str, name: str, _value: object, _options: object, lines: list[str]
) -> None:
    """Take the text on a constant from the module that defines it."""
    if what == "data":
        short = name.rpartition(".")[2]
        docs = ModuleAnalyzer.for_module(defining_module(name)).find_attr_docs()
        lines[:] = docs["", short]


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


def setup(app: Sphinx) -> dict[str, bool]:
    """Write the pages before they are read; resolve what the Python domain has not found."""
    app.connect("builder-inited", write_all)
    app.connect("missing-reference", resolve)
    app.connect("autodoc-process-docstring", document_data)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
