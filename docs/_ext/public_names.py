"""Public names, which their packages load when they are first used."""

import ast
from pathlib import Path

from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.pycode import ModuleAnalyzer

import grasp3d

_MEMBERS = {"attribute", "method", "property"}


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
    """Resolve what the Python domain has not found."""
    app.connect("missing-reference", resolve)
    app.connect("autodoc-process-docstring", document_data)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
