"""Pages that are written before a site is built, in folders that hold nothing else."""

from pathlib import Path


def write_pages(folder: Path, pages: dict[str, str]) -> None:
    """Make the pages of a folder these; one that stays as it is keeps its date.

    Args:
        folder: Made if it is missing.
        pages: Text by the name of the file.
    """
    folder.mkdir(exist_ok=True)
    for path in folder.iterdir():
        if path.name not in pages:
            path.unlink()
    for name, text in pages.items():
        path = folder / name
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
