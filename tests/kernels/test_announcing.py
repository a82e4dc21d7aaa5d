from types import SimpleNamespace
from typing import Any

import pytest

from grasp3d._kernels.compiling import announcing
from grasp3d._kernels.compiling.announcing import Announcer, Phase

PACKAGE = "grasp3d._kernels"


def compiled(name: str, package: str = PACKAGE) -> Any:
    """What Numba reports when it compiles a kernel, given as MODULE.FUNCTION."""
    module, _, function = name.partition(".")
    kernel = SimpleNamespace(
        __module__=f"{package}.{module}", __qualname__=function, __name__=function
    )
    return SimpleNamespace(data={"dispatcher": SimpleNamespace(py_func=kernel)})


def compile_all(announcer: Announcer, *names: str, package: str = PACKAGE) -> None:
    """Report compilations one after the other."""
    for name in names:
        announcer.on_start(compiled(name, package))
        announcer.on_end(compiled(name, package))


def test_each_phase_is_announced_once(caplog: pytest.LogCaptureFixture) -> None:
    announcer = Announcer(PACKAGE)
    compile_all(
        announcer,
        "antipodal_directions.seed_rays",
        "ray_tracing.write_rays",
        "wrench_problem.epsilons",
        "antipodal_directions.seed_rays",
    )
    assert [phase.work for phase in announcer.compiled] == ["searches by rays", "epsilon"]
    first, second = caplog.messages
    for line, phase in ((first, announcing.RAYS), (second, announcing.EPSILON)):
        work = f"{phase.work}, about {phase.seconds} s"
        assert line.startswith(f"grasp3d: compiling kernels for {work}, once per ")
    # At a level that Python prints to standard error where no logging is configured.
    assert {(one.name, one.levelname) for one in caplog.records} == {
        ("grasp3d.compiling", "WARNING")
    }


def test_kernels_that_others_call_and_other_packages_are_not_announced(
    caplog: pytest.LogCaptureFixture,
) -> None:
    announcer = Announcer(PACKAGE)
    compile_all(announcer, "ray_tracing.write_rays", package="another._kernels")
    announcer.on_start(compiled("surface_walks.walk"))
    compile_all(announcer, "ray_tracing.write_rays")
    announcer.on_end(compiled("surface_walks.walk"))
    assert (announcer.compiled, caplog.messages) == ([], [])


def test_what_takes_a_moment_is_not_announced(caplog: pytest.LogCaptureFixture) -> None:
    announcer = Announcer(PACKAGE)
    compile_all(announcer, "scanning.scan")
    assert (announcer.compiled, caplog.messages) == ([announcing.SCANS], [])


def test_a_run_ends_at_the_first_kernel_that_is_not_compiled(
    caplog: pytest.LogCaptureFixture,
) -> None:
    announcer = announcing.announcer
    done: list[str] = []

    def run() -> None:
        done.append("begun")
        try:
            announcer.on_start(compiled("ray_tracing.write_rays"))
        finally:  # Numba reports the end of a failed compilation too
            announcer.on_end(compiled("ray_tracing.write_rays"))
        done.append("ended")

    assert not announcing.all_compiled(run)
    assert done == ["begun"]
    assert announcing.all_compiled(lambda: None)
    assert caplog.messages == []


def test_the_time_is_that_of_what_is_not_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    stored = {announcing.MESHES, announcing.TWO_FINGERS}
    monkeypatch.setattr(Phase, "compiled", property(lambda phase: phase in stored))
    assert announcing.seconds_missing(0) == 0
    two, three = announcing.seconds_missing(2), announcing.seconds_missing(3)
    phases = (
        announcing.PATCHES, announcing.RAYS, announcing.LOCATIONS, announcing.WRENCHES,
        announcing.EPSILON_OF_PAIRS, announcing.EPSILON, announcing.EPSILON_OF_ANY_RANK,
        announcing.PICTURES,
    )  # fmt: skip
    left = sum(phase.seconds for phase in phases)
    assert two == left + announcing.SCANS.seconds
    assert three == left + announcing.THREE_FINGERS.seconds
    assert announcing.seconds_missing(5) == three + announcing.MORE_FINGERS.seconds
    held = announcing.seconds_missing(2, gripper=True, forces=True)
    more = announcing.GRIPPERS, announcing.CLOSING, announcing.FORCES
    assert held == two + sum(phase.seconds for phase in more)
    assert announcing.seconds_missing(0, forces=True) == 0


def test_without_a_folder_every_process_compiles(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(announcing, "cache_folder", lambda: None)
    line = announcing.announcement("two fingers", 10)
    assert "in every process: no folder can be written" in line
    assert "NUMBA_CACHE_DIR" in line
    assert not announcing.MESHES.compiled
