"""Formulas as MathML, which browsers draw by themselves: no script and no network."""

import re
from typing import Literal

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.util.math import get_node_equation_number
from sphinx.writers.html5 import HTML5Translator

_RAISED = "<mo>&#x0002A;</mo>"
_FUNCTION = re.compile(r'<mo>(?P<name>[a-z]{2,})</mo>(?P<bracket>(?=<mo stretchy="false">))?')
_LIMITS = re.compile(r"\\(?:min|max|inf|sup)(?=_)")


def mathml(tex: str, display: Literal["inline", "block"] = "inline") -> str:
    """A formula as MathML, with the spaces that TeX leaves around the names of functions."""
    if display == "block":
        tex = _LIMITS.sub(r"\g<0>\\limits", tex)
    text = convert(tex, display=display).replace(_RAISED, "<mo>\N{ASTERISK OPERATOR}</mo>")
    return _FUNCTION.sub(_spaced, text)


def _spaced(name: re.Match[str]) -> str:
    after = "0.17em" if name["bracket"] is None else "0"
    return f'<mo form="prefix" lspace="0.1em" rspace="{after}">{name["name"]}</mo>'


def inline(translator: HTML5Translator, node: nodes.math) -> None:
    """Write a formula within a line."""
    translator.body.append(mathml(node.astext()))
    raise nodes.SkipNode


def block(translator: HTML5Translator, node: nodes.math_block) -> None:
    """Write a formula of its own, with its number if it has one."""
    translator.body.append(translator.starttag(node, "div", CLASS="formula"))
    translator.body.append(mathml(node.astext(), "block"))
    if node["number"]:
        number = get_node_equation_number(translator, node)
        translator.body.append(f'<span class="eqno">({number})')
        translator.add_permalink_ref(node, "Link to this equation")
        translator.body.append("</span>")
    translator.body.append("</div>\n")
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Make `html_math_renderer = "mathml"` known."""
    app.add_html_math_renderer("mathml", (inline, None), (block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
