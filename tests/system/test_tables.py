"""Tables that other programs wrote: delimiters, decimal commas, and files that are none."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp3d.system.tables import read_columns

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
        ("a\0,b\n", "no text in UTF-8"),
    ],
)
def test_what_is_no_table_is_refused(text: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        columns_of(text)
