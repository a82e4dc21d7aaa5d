"""Text for people: safe and printable names of files, counts with their nouns, short messages."""

import hashlib
import re
import unicodedata
from collections.abc import Collection, Iterable
from difflib import get_close_matches
from pathlib import Path

LONGEST = 150
"""Longest name [bytes of UTF-8]; suffixes still fit in the 255 bytes of most file systems."""

DIGITS = 8
"""Hexadecimal digits of a name's hash."""

UNNAMED = "unnamed"

LONGEST_REASON = 200
"""Longest text of an error that another library has raised [characters]."""

_FORBIDDEN = frozenset('<>:"/\\|?*')
_JOINING = frozenset("\u00ad\u200c\u200d")
"""Soft hyphen, and the joiners, which Persian words and emoji need."""
_RESERVED = re.compile(
    r"(con|prn|aux|nul|conin\$|conout\$|(com|lpt)[0-9¹²³]) *(\.|$)", re.IGNORECASE
)


def safe_stem(name: str) -> str:
    """Return a name for a result that is valid on every file system.

    Letters of all languages, spaces and symbols are kept, in composed form. Characters that some
    file system forbids or interprets become `_`: separators, characters that Windows forbids or
    that are not shown, undecodable bytes; joiners and soft hyphens stay. Names that Windows
    reserves start with `_`. Dots and spaces at both ends are removed, and long names are shortened.
    A changed name ends in a hash of the original, so that different names stay different; a safe
    name is returned unchanged.

    Args:
        name: Name of the input, without folder and suffix.
    """
    stem = "".join(map(_safe, unicodedata.normalize("NFC", name))).strip(". ")
    if _RESERVED.match(stem):
        stem = f"_{stem}"
    stem = stem or UNNAMED
    if stem == name and len(stem.encode()) <= LONGEST:
        return stem
    short = stem.encode()[: LONGEST - DIGITS - 1].decode(errors="ignore")
    return f"{short.rstrip('. ')}-{short_hash(name)}"


def unknown(what: str, name: str, known: Collection[str], listed: Iterable[str] = ()) -> str:
    """Return the message that a name is unknown, with a similar one as a guess.

    Args:
        what: What the name would stand for, such as a key.
        name: The name.
        known: Known names.
        listed: The known names as the message lists them; empty: as they are.
    """
    near = get_close_matches(name, known, 1)
    guess = f" (did you mean {near[0]}?)" if near else ""
    return f"no {what} is called {name[:40]!r}{guess}; known: {', '.join([*listed] or known)}"


def unsupported(path: Path, formats: Iterable[str], what: str = "") -> str:
    """Return the message that a file's format is not supported.

    Args:
        path: The file, or its name.
        formats: The suffixes of supported formats.
        what: What the file contains: a table, a figure.
    """
    kind = f"{what} format" if what else "format"
    problem = f"unsupported {kind} {path.suffix}" if path.suffix else "has no suffix"
    return printable(f"{path}: {problem}: supported are {' '.join(formats)}")


def short_hash(text: str, digits: int = DIGITS) -> str:
    """Return the first hexadecimal digits of the SHA-256 of a text."""
    return hashlib.sha256(text.encode(errors="surrogatepass")).hexdigest()[:digits]


def name_key(name: str) -> str:
    """Return a key that is equal for names that differ in case, composition and joiners only."""
    visible = "".join(c for c in name if c not in _JOINING)  # some file systems ignore joiners
    folded = unicodedata.normalize("NFC", visible).casefold()
    return unicodedata.normalize("NFC", folded)


def printable(text: str) -> str:
    """Replace control characters, but not joiners, by escapes, so that the text is one line."""
    return "".join(c if c.isprintable() or c in _JOINING else repr(c)[1:-1] for c in text)


def as_unicode(text: str) -> str:
    """Replace undecodable bytes of a file name by hexadecimal escapes, since tables are Unicode."""
    if text.isascii():
        return text
    return text.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")


def _safe(character: str) -> str:
    """Return the character, or `_` if a name may not contain it."""
    is_shown = character.isprintable() or unicodedata.category(character) == "Zs"
    is_shown |= character in _JOINING
    return character if is_shown and character not in _FORBIDDEN else "_"


def describe_unexpected(error: BaseException) -> str:
    """Return a one-line message for an exception that should not occur."""
    description = " ".join(f"{type(error).__name__}: {error}".split())
    return f"unexpected {description}; please report this mesh"


def reason_of(error: BaseException) -> str:
    """Message of another library's error in one short line; its class if the message is empty."""
    return printable(" ".join(str(error).split())[:LONGEST_REASON]) or type(error).__name__


SINGULARS = {
    "bodies": "body", "meshes": "mesh", "sealed cavities": "sealed cavity", "vertices": "vertex",
}  # fmt: skip
"""Singulars by their plural, where they are not the plural without its s."""


def counted(count: int, things: str) -> str:
    """Return a count with its noun, which is given in the plural: `2 faces`, `1 face`."""
    return f"{count:,} {noun(count, things)}"


def noun(count: int, things: str) -> str:
    """The given plural, or its singular for a count of one."""
    return things if count != 1 else SINGULARS.get(things, things.removesuffix("s"))


def short_number(value: float) -> str:
    """Format a number to three digits, or to all before the point: `0.369`, `25`, `1,230`."""
    return f"{value:,.0f}" if 999.5 <= abs(value) < 1e9 else f"{value + 0.0:.3g}"  # 0, not -0
