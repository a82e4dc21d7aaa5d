"""Compilations are announced once, counted, and refused on request."""

import pytest

from grasp3d.system.compiling import Compilations, NotCompiledError, announcement, logger


def test_the_first_kernel_is_announced_and_all_are_counted(
    caplog: pytest.LogCaptureFixture,
) -> None:
    compilations = Compilations()
    for kernel in ("one.kernel", "another.kernel"):
        compilations.begin(kernel, stored=True)
        assert compilations.current == kernel
        compilations.end()
    assert (compilations.kernels, compilations.current) == (["one.kernel", "another.kernel"], "")
    # At a level that Python prints to standard error where no logging is configured.
    records = [(one.name, one.levelname, one.getMessage()) for one in caplog.records]
    assert records == [(logger.name, "WARNING", announcement(stored=True))]
    assert "once per installation (grasp3d warmup does it ahead)" in announcement(stored=True)


def test_without_a_folder_every_process_compiles() -> None:
    line = announcement(stored=False)
    assert "in every process: no folder can be written" in line
    assert "NUMBA_CACHE_DIR" in line


def test_refused_compilations_are_neither_announced_nor_counted(
    caplog: pytest.LogCaptureFixture,
) -> None:
    compilations = Compilations()
    with compilations.refused(), pytest.raises(NotCompiledError, match=r"one\.kernel"):
        compilations.begin("one.kernel", stored=True)
    assert (compilations.kernels, caplog.messages) == ([], [])
    compilations.begin("one.kernel", stored=True)
    assert compilations.kernels == ["one.kernel"]
