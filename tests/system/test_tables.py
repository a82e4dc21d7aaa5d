"""Tables that other programs wrote: delimiters, decimal commas, and files that are none."""

import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp3d.system.tables import SUFFIXES, column_names, read_columns, write_columns

NUMBERS = st.floats(allow_nan=False, allow_infinity=False)
TABLES = st.lists(st.tuples(NUMBERS, NUMBERS, st.integers(-9, 9)), min_size=1, max_size=5)


def columns_of(text: str) -> dict[str, list[object]]:
    """The columns of a table with this text."""
    with TemporaryDirectory() as folder:
        path = Path(folder, "table.csv")
        path.write_text(text, encoding="utf-8")
        return {name: values.tolist() for name, values in read_columns(path).items()}


@pytest.mark.slow
@settings(deadline=None)
@given(rows=TABLES)
def test_delimiters_and_decimal_commas_change_no_bit(rows: list[tuple[float, float, int]]) -> None:
    lines = [["a", "b", "n", "note; note"], *[[*map(repr, row), "x"] for row in rows]]
    found = columns_of("\n".join(",".join(f'"{cell}"' for cell in line) for line in lines))
    numbers = [np.array(found[name], dtype=np.float64).tobytes() for name in ("a", "b", "n")]
    assert numbers == [
        np.array(values, dtype=np.float64).tobytes() for values in zip(*rows, strict=True)
    ]
    for delimiter, decimal in (("\t", "."), (";", "."), (";", ",")):
        texts = [delimiter.join(line).replace(".", decimal) for line in lines]
        same = columns_of("\n".join([delimiter.join(("a", "b", "n", "note")), *texts[1:]]))
        values = [np.array(same[name], dtype=np.float64).tobytes() for name in ("a", "b", "n")]
        assert values == numbers


def test_decimal_points_and_commas_in_one_file_are_not_guessed() -> None:
    assert columns_of("a;b\n0,5;0.25\n") == {"a": ["0,5"], "b": [0.25]}
    assert columns_of("a;b\n0,5;x,y\n") == {"a": [0.5], "b": ["x,y"]}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "^the file is empty$"),
        ("\n \n", "^the file is empty$"),
        ("0,0,0.1\n1,2,3\n", "its first line must be names of columns; found 0 0 0.1"),
        ("0,5;0,5;1e-3\n", "its first line must be names of columns"),
        ("a,b\n1\n", "Expected 2 columns, got 1"),
        ("a\0,b\n", "not text in UTF-8"),
        ("a," * 2**19 + "b\n1,2", "its first line is longer than 1,048,576 bytes"),
        ("a,b,a\n1,2,3\n", "two columns are called 'a'"),
    ],
)
def test_what_is_no_table_is_refused(text: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        columns_of(text)


TEXTS = ["=1+2", "+3", "-4", "@a", "\tb", "\rc", "'=d", "'e", "", "-5", "plain", "a=b", "''@"]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_texts_and_names_are_kept_as_they_are(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"t{suffix}"
    write_columns(path, {"name": np.array(TEXTS), "=x": np.arange(len(TEXTS))}, settings={})
    assert read_columns(path)["name"].tolist() == TEXTS
    assert column_names(path) == ["name", "=x"]


def test_columns_of_lists_are_not_read_however_long_and_missing_texts_are_missing(
    tmp_path: Path,
) -> None:
    path, texts = tmp_path / "t.parquet", pa.array(["x", None, "y"]).dictionary_encode()
    columns = {"a.b": [1, None, 3], "c": texts, "l": pa.array([[0.0] * 50] * 3)}
    pq.write_table(pa.table({**columns, "s": [{"x": 1}] * 3}), path)
    found = read_columns(path)
    assert np.array_equal(found.pop("a.b"), [1.0, np.nan, 3.0], equal_nan=True)
    assert {name: values.tolist() for name, values in found.items()} == {
        "c": ["x", None, "y"],
        "l": ["list<element: double>"] * 3,
        "s": ["struct<x: int64>"] * 3,
    }


DAMAGED = """
import sys
from pathlib import Path
from grasp3d.system.tables import read_columns
path = Path(sys.argv[1])
data = path.read_bytes()
for at in range(len(data)):
    for flip in (1, 4):
        path.write_bytes(data[:at] + bytes([data[at] ^ flip]) + data[at + 1 :])
        try:
            read_columns(path)
        except (ValueError, OSError):
            pass
"""


@pytest.mark.slow
def test_damaged_bytes_do_not_end_the_process(tmp_path: Path) -> None:
    """pyarrow aborts where the metadata of a column is looked at, and its levels do not fit."""
    path = tmp_path / "t.parquet"
    pq.write_table(pa.table({"px": [0.0, 1.0, 2.0]}), path, store_schema=False)
    command = [sys.executable, "-c", DAMAGED, str(path)]
    assert subprocess.run(command, check=False).returncode == 0


ROWS = 16_384


def test_texts_of_many_parts_and_missing_ones_are_read(tmp_path: Path) -> None:
    unique = [None if k % 1000 == 7 else f"grasp {k}" for k in range(2 * ROWS + 5)]
    same = [None if k < ROWS else "long " * 10 for k in range(len(unique))]
    table = pa.table({"unique": unique, "same": pa.array(same).dictionary_encode(), "text": same})
    pq.write_table(table, tmp_path / "a.parquet", row_group_size=ROWS)
    found = read_columns(tmp_path / "a.parquet")
    assert found["unique"].tolist() == unique
    assert found["same"].tolist() == found["text"].tolist() == same
    assert len(set(map(id, found["text"]))) == 2  # equal texts take little memory
