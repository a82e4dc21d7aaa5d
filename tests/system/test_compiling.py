"""Compilations are announced once, and counted."""

import pytest

from grasp3d.system.compiling import Compilations, announcement, logger


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
    line = announcement("one.kernel and what else is needed", stored=True)
    assert records == [(logger.name, "WARNING", line)]
    assert line.endswith("needed, once for this processor and version of Numba")


def test_several_kernels_are_announced_together(caplog: pytest.LogCaptureFixture) -> None:
    compilations = Compilations()
    compilations.begin("first.kernel", stored=True)
    caplog.clear()
    with compilations.several(["one.kernel", "another.kernel"], stored=True) as begin:
        begin("one.kernel")
        assert compilations.current == "one.kernel, 1 of 2"
        begin("another.kernel")
        assert compilations.current == "another.kernel, 2 of 2"
    assert compilations.current == ""
    assert compilations.kernels == ["first.kernel", "one.kernel", "another.kernel"]
    assert caplog.messages == [announcement("2 kernels", stored=True)]


def test_without_a_folder_every_process_compiles() -> None:
    line = announcement("1 kernel", stored=False)
    assert "in every process: no folder can be written" in line
    assert "NUMBA_CACHE_DIR" in line
