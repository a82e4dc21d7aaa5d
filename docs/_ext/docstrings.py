"""Docstrings and annotations of this package in the form that autodoc expects."""

from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.directives import ObjectDescription
from sphinx.domains.python import PyAttribute, PyProperty

_ARRAY = "~numpy.ndarray[tuple[~typing.Any, ...], ~numpy.dtype["
_SHORT_ARRAY = "~numpy.typing.NDArray["


def shorten(annotation: str) -> str:
    """An annotation with arrays in the form in which they are written.

    A default that is made anew each time is no text that Sphinx can parse: it is shown as dots.
    """
    parts = annotation.replace("<factory>", "...").split(_ARRAY)
    return _SHORT_ARRAY.join([parts[0], *(part.replace("]]", "]", 1) for part in parts[1:])])


def shorten_signature(
    _app: Sphinx,
    _what: str,
    _name: str,
    _value: object,
    _options: Any,
    given: str | None,
    back: str | None,
) -> tuple[str | None, str | None]:
    """Shorten the annotations of a signature and of what it returns."""
    return given and shorten(given), back and shorten(back)


def keep_colons(
    _app: Sphinx, what: str, _name: str, _value: object, _options: Any, lines: list[str]
) -> None:
    """Keep what is before a colon in the text on a value: napoleon takes it for the type.

    An empty comment as the first line prevents that.
    """
    if what in {"attribute", "data", "property"}:
        lines[:0] = ["..", ""]
    elif "Returns:" in lines:
        first = lines.index("Returns:") + 1
        lines[first:first] = ["    ..", ""]


class ShortAnnotation(ObjectDescription[tuple[str, str]]):
    """A value whose annotation is shortened."""

    def run(self) -> list[nodes.Node]:
        """Shorten the annotation, then go on as before."""
        if "type" in self.options:
            self.options["type"] = shorten(self.options["type"])
        return super().run()


class Attribute(ShortAnnotation, PyAttribute):
    """An attribute with a short annotation."""


class Property(ShortAnnotation, PyProperty):
    """A property with a short annotation."""


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect with autodoc, before napoleon."""
    app.connect("autodoc-process-docstring", keep_colons, priority=400)
    app.connect("autodoc-process-signature", shorten_signature)
    app.add_directive_to_domain("py", "attribute", Attribute, override=True)
    app.add_directive_to_domain("py", "property", Property, override=True)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
