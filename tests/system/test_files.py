"""Files of results: written as a whole, and names that every system has."""

import errno
import os
import unicodedata
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

import grasp3d
from grasp3d.errors import OutputError, SettingError, WarningError
from grasp3d.system.context import (
    available_processors,
    report_progress,
    running,
    thread_count,
    unreported,
    within,
)
from grasp3d.system.files import TEMPORARY_PREFIX, atomic_write
from grasp3d.system.names import LONGEST, name_key, safe_stem, short_hash
from tests.helpers import shapes

ANY = st.text(st.characters(codec=None, exclude_categories=[]), max_size=80)  # surrogates as well
WINDOWS = {"con", "prn", "aux", "nul", "conin$", "conout$"} | {
    f"{port}{number}" for port in ("com", "lpt") for number in "0123456789¹²³"
}


@given(
    st.one_of(ANY, st.text('.- <>:"/\\|?*\n\t\x7f\u0301eé', max_size=12), ANY.map(lambda t: t * 9))
)
@example("Com¹ .x")
@example("x" * 151)
@example("x" * 140 + ". . é.")
@example("<\u0338")
@example("a\u202etxt.b")
def test_any_name_becomes_safe_and_safe_names_do_not_change(name: str) -> None:
    safe = safe_stem(name)
    assert safe
    assert len(safe.encode("utf-8")) <= LONGEST  # and is Unicode
    assert safe == safe.strip(". ")
    assert not set(safe) & set('<>:"/\\|?*')
    assert all(unicodedata.category(c) not in {"Cc", "Cs", "Zl", "Zp"} for c in safe)
    assert len(safe.splitlines()) == 1
    assert safe.split(".")[0].rstrip(" ").casefold() not in WINDOWS
    assert unicodedata.is_normalized("NFC", safe)
    assert safe_stem(safe) == safe
    assert safe == name or safe.endswith(f"-{short_hash(name)}")


@given(ANY, ANY)
def test_different_names_stay_different(one: str, two: str) -> None:
    if safe_stem(one) == safe_stem(two):
        # The only exception: one name is the result of the other.
        assert one == two or one == safe_stem(two) or two == safe_stem(one)


@pytest.mark.parametrize(
    "name", ["mug", "a b", "ünï 物体 #1", "-rf", "[red]", "$x$ {a} %d", "CON_1"]
)
def test_safe_names_are_kept(name: str) -> None:
    assert safe_stem(name) == name


@pytest.mark.parametrize(
    ("name", "start"),
    [
        ("CON", "_CON-"), ("aux.v2", "_aux.v2-"), ("a/b\\c", "a_b_c-"), ("a\nb", "a_b-"),
        (".", "unnamed-"), (".hidden ", "hidden-"), (os.fsdecode(b"mug\xff"), "mug_-"),
        ("cafe\u0301", "café-"), ("x" * 300, "x" * 141 + "-"), ("物" * 60, "物" * 47 + "-"),
    ],
)  # fmt: skip
def test_unsafe_names_are_changed_as_little_as_possible(name: str, start: str) -> None:
    assert safe_stem(name) == start + short_hash(name)


def test_names_that_are_equal_on_some_file_systems_have_equal_keys() -> None:
    assert name_key("MUG") == name_key("mug")
    assert name_key("Cafe\u0301") == name_key("café")
    assert name_key("straße") == name_key("STRASSE")
    assert name_key("mug") != name_key("mug2")


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


def test_what_an_inner_statement_does_not_name_is_that_of_the_outer_one() -> None:
    outer, inner = list[float](), list[float]()
    with running(threads=3, progress=outer.append):
        with running(threads=2):
            report_progress(0.5)
            assert thread_count() == 2
        with running(progress=inner.append):
            report_progress(0.75)
            assert thread_count() == 3
    report_progress(1.0)
    assert (outer, inner) == ([0.5], [0.75])
    assert thread_count() == available_processors()


def test_parts_report_fractions_of_the_whole() -> None:
    fractions: list[float] = []
    with running(progress=fractions.append), within(0.5, 1.0):
        with within(0.0, 0.5):
            report_progress(0.5)
        with unreported():
            report_progress(0.0)
        report_progress(1.0)
    assert fractions == [0.625, 1.0]


def test_what_a_report_raises_ends_the_computation_and_its_context() -> None:
    def cancel(fraction: float) -> None:
        raise InterruptedError(str(fraction))

    with (
        pytest.raises(InterruptedError, match=r"0\.5"),
        running(threads=2, progress=cancel),
        within(0.0, 0.5),
    ):
        report_progress(1.0)
    report_progress(1.0)
    assert thread_count() == available_processors()


def test_another_thread_has_a_context_of_its_own() -> None:
    refuse = running(threads=3, progress=lambda _: pytest.fail("of this thread alone"))
    with refuse, ThreadPoolExecutor(1) as pool:
        pool.submit(report_progress, 1.0).result()
        assert pool.submit(thread_count).result() == available_processors()


@pytest.mark.parametrize("threads", [0, -2, 2.5, True, "4"])
def test_threads_are_a_whole_number_from_1_on(threads: Any) -> None:
    with (
        pytest.raises(SettingError, match="threads must be a whole number, at least 1"),
        running(threads=threads),
    ):
        pytest.fail("must not begin")


def test_warnings_are_errors_where_that_is_stated() -> None:
    load, open_box = grasp3d.Load(mass=200.0), shapes.box((0.04, 0.04, 0.04))
    mesh = grasp3d.load_mesh(open_box, unit="m", max_edge=0.02)
    (warning,) = grasp3d.label_surface(mesh, load=load).warnings
    assert "more than any material: are its mass" in warning
    sides = [[0.02, 0.0, 0.0], [-0.02, 0.0, 0.0]]
    assert grasp3d.evaluate_grasps(mesh, sides, load=load).warnings == (warning,)
    with running(strict=True), running(threads=2):
        for compute in (
            lambda: grasp3d.label_surface(mesh, load=load),
            lambda: grasp3d.evaluate_grasps(mesh, sides, load=load),
            lambda: grasp3d.label_surface((open_box[0], open_box[1][1:])),
        ):
            with pytest.raises(WarningError):
                compute()
        with running(strict=False):
            assert grasp3d.label_surface(mesh, load=load).warnings == (warning,)
