"""Names of files: of results, so that every file system takes them, and as they are shown."""

import hashlib
import re
import unicodedata

LONGEST = 150
"""Bytes of a name in UTF-8; what is added behind it still fits in the 255 of most file systems."""

DIGITS = 8
"""Hexadecimal digits of a name's hash."""

UNNAMED = "unnamed"

_FORBIDDEN = frozenset('<>:"/\\|?*')
_NO_CHARACTERS = frozenset({"Cc", "Cs", "Zl", "Zp"})
"""Categories of control characters, bytes that are no Unicode, and ends of lines."""
_TURNING = frozenset({"LRE", "RLE", "LRO", "RLO", "PDF", "LRI", "RLI", "FSI", "PDI"})
"""Marks that turn the direction of writing, so that a name shows as another one."""
_RESERVED = re.compile(
    r"(con|prn|aux|nul|conin\$|conout\$|(com|lpt)[0-9¹²³]) *(\.|$)", re.IGNORECASE
)


def safe_stem(name: str) -> str:
    """Say what a result may be called after an input.

    Letters of all languages, spaces and signs are kept, in composed form. What some file system
    forbids or reads as something else becomes `_`: separators, control characters, signs that
    Windows forbids, its reserved names, bytes that are no Unicode; dots and spaces at the ends are
    left out, and long names are cut. A name that was changed ends in a hash of the whole, so that
    different names stay different; one that is safe stays as it is.

    Args:
        name: Of the input, without folder and suffix.
    """
    stem = "".join(map(_safe, unicodedata.normalize("NFC", name))).strip(". ")
    if _RESERVED.match(stem):
        stem = f"_{stem}"
    stem = stem or UNNAMED
    if stem == name and len(stem.encode()) <= LONGEST:
        return stem
    short = stem.encode()[: LONGEST - DIGITS - 1].decode(errors="ignore")
    return f"{short.rstrip('. ')}-{short_hash(name)}"


def short_hash(text: str, digits: int = DIGITS) -> str:
    """First hexadecimal digits of the SHA-256 of any text."""
    return hashlib.sha256(text.encode(errors="surrogatepass")).hexdigest()[:digits]


def name_key(name: str) -> str:
    """What a file system that ignores case and composition takes for the same name."""
    folded = unicodedata.normalize("NFC", name).casefold()
    return unicodedata.normalize("NFC", folded)


def printable(text: str) -> str:
    """Write out the characters that a terminal would act on, so that the text is one line."""
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


def as_unicode(text: str) -> str:
    """Write out in hexadecimal the bytes of a file name that are no Unicode, as tables need it."""
    if text.isascii():
        return text
    return text.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")


def _safe(character: str) -> str:
    """The character, or `_` where it may not stand in a name."""
    unsafe = (
        character in _FORBIDDEN
        or unicodedata.category(character) in _NO_CHARACTERS
        or unicodedata.bidirectional(character) in _TURNING
    )
    return "_" if unsafe else character
