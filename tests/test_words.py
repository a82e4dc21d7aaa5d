"""The words of this project: those left out are nowhere but where a reason is given."""

from pathlib import Path

import check_words
import pytest


@pytest.mark.slow
def test_words_left_out_have_a_reason_where_they_stay(capsys: pytest.CaptureFixture[str]) -> None:
    assert check_words.main() == 0, capsys.readouterr().out


@pytest.mark.parametrize(
    "line", ["the place of a finger", "find_spots()", "class CrewMember", "it is told"]
)
def test_words_are_found_in_prose_and_names(
    line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "README.md").write_text(line)
    monkeypatch.setattr(check_words, "ROOT", tmp_path)
    assert check_words.main() == 1
