"""Threads and progress of a call."""

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest

import grasp3d
from grasp3d.errors import SettingError, WarningError
from grasp3d.system.context import (
    available_processors,
    report_progress,
    running,
    thread_count,
    unreported,
    within,
)
from tests.helpers import shapes


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
