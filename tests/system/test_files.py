import errno
from pathlib import Path

import pytest

from grasp3d.errors import OutputError
from grasp3d.system.files import TEMPORARY_PREFIX, atomic_write


def _fill_the_disk(path: Path) -> None:
    with atomic_write(path) as outer, atomic_write(outer) as inner:
        inner.write_text("2", encoding="ascii")
        raise OSError(errno.ENOSPC, "No space left on device")


def test_a_temporary_file_is_written_to_directly(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    with atomic_write(path) as outer, atomic_write(outer) as inner:
        assert inner == outer
        inner.write_text("1", encoding="ascii")
        assert not path.exists()
    assert [file.name for file in tmp_path.iterdir()] == ["table.csv"]
    with pytest.raises(OutputError, match=r"part\.csv: cannot be written \(No space"):
        _fill_the_disk(path)
    assert path.read_text(encoding="ascii") == "1"
    assert [file.name for file in tmp_path.iterdir()] == ["table.csv"]


def test_a_file_whose_name_only_begins_as_a_temporary_one(tmp_path: Path) -> None:
    path = tmp_path / f"{TEMPORARY_PREFIX}mug.ply"
    with atomic_write(path) as temporary:
        assert temporary != path
        temporary.write_text("1", encoding="ascii")
    assert path.read_text(encoding="ascii") == "1"
