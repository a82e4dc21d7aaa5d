"""Warnings of files, of which those that say the same become one line."""

import re
from dataclasses import dataclass, field
from pathlib import Path

from grasp3d.system.counts import counted

MOST_NAMED = 5
"""Most files that a line names."""

_NUMBER = re.compile(r"\d[\d.,]*")


@dataclass
class FileWarnings:
    """Warnings of files.

    Example:
        >>> from grasp3d.validating.file_warnings import FileWarnings
        >>> warnings = FileWarnings()
        >>> for name in ("a.csv", "b.csv"):
        ...     warnings.add(name, "its mesh is open")
        >>> warnings.lines()
        ['its mesh is open (2 files: a.csv, b.csv)']
    """

    _said: dict[str, list[tuple[str, str]]] = field(default_factory=dict)

    def add(self, file: str, text: str, mesh: str = "") -> None:
        """Add a sentence on a file.

        Args:
            file: Its name.
            text: The sentence.
            mesh: Name of its mesh: sentences that differ by it, or by numbers, say the same.
        """
        own = text.replace(mesh, "") if mesh else text
        self._said.setdefault(_NUMBER.sub("#", own), []).append((file, text))

    def lines(self) -> list[str]:
        """A line for each sentence, with the files that it is of."""
        return [_line(said) for said in self._said.values()]


def _line(said: list[tuple[str, str]]) -> str:
    file, text = said[0]
    if len(said) == 1:
        return f"{file}: {text}"
    names = [Path(name).name for name, _ in said]
    named = ", ".join(names[:MOST_NAMED]) + (", ..." if len(names) > MOST_NAMED else "")
    alike = "" if len({text for _, text in said}) == 1 else "and the like in "
    return f"{text} ({alike}{counted(len(said), 'files')}: {named})"
