"""Mutated files of every format: an answer or an error of one line, soon."""

import time
from pathlib import Path

import pytest

from scripts import fuzz

COUNT = 40
"""Mutated files of each reader."""


@pytest.mark.slow
@pytest.mark.parametrize("name", fuzz.READERS)
def test_a_mutated_file_is_read_or_refused(name: str, tmp_path: Path) -> None:
    path = tmp_path / f"example{fuzz.READERS[name][0]}"
    fuzz.write_example(name, path)
    example = path.read_bytes()
    assert fuzz.READERS[name][1](path) is not None
    outcomes = list[str]()
    for number in range(COUNT):
        started = time.monotonic()
        outcomes.append(fuzz.outcome_of(name, path, [1, number], example))
        assert time.monotonic() - started < 40.0
    assert [outcome for outcome in outcomes if outcome.startswith("FAILED")] == []
    assert set(outcomes) != {"read"}  # otherwise nothing was damaged
