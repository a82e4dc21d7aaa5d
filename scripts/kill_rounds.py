"""Kill a batch and resume it, again and again: `python scripts/kill_rounds.py [--rounds 100]`.

Each round starts `grasp3d batch` on a few meshes, ends it at a random moment with KILL, TERM or INT
to the parent process, to one of its children or to its whole group, and resumes it. What the
resumed run leaves must equal what an undisturbed one leaves, except for times, and nothing may stay
in temporary folders or run on. Ends with 1 otherwise.
"""

import argparse
import contextlib
import hashlib
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from itertools import product
from pathlib import Path

import psutil
import trimesh

from grasp3d.batch import read_summary
from grasp3d.batch.row import TIMINGS

SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
TARGETS = ("parent", "child", "group")
BATCH = "import sys; from grasp3d.cli import main; sys.exit(main())"
SHAPES = {
    "ball": trimesh.creation.icosphere(2, 0.03), "box": trimesh.creation.box([0.08, 0.05, 0.03]),
    "rod": trimesh.creation.cylinder(0.02, 0.1), "ring": trimesh.creation.annulus(0.02, 0.03, 0.02),
    "cap": trimesh.creation.capsule(0.05, 0.02), "cone": trimesh.creation.cone(0.03, 0.06),
}  # fmt: skip


def started(inputs: Path, output: Path, temporary: Path) -> subprocess.Popen[bytes]:
    """Start a batch in a group of its own."""
    options = ("--unit", "m", "--rays", "8", "--workers", "2", "--quiet")
    return subprocess.Popen(  # noqa: S603
        [sys.executable, "-c", BATCH, "batch", str(inputs), "-o", str(output), *options],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
        env={**os.environ, "TMPDIR": str(temporary)},
    )


def finished(inputs: Path, output: Path, temporary: Path) -> str:
    """Run a batch to its end; what it complains of."""
    process = started(inputs, output, temporary)
    _, errors = process.communicate(timeout=300)
    return "" if process.returncode == 0 else errors.decode(errors="replace")


def contents(output: Path) -> dict[str, str]:
    """What is in the results, without times: rows, and hashes of files."""
    rows = {row.mesh: str({k: v for k, v in vars(row).items() if k not in TIMINGS})
            for row in read_summary(output)}  # fmt: skip
    files = {
        str(path.relative_to(output)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in output.rglob("*")
        if path.is_file() and path.relative_to(output).parts[0] in {"labels", "fields"}
    }
    others = {path.relative_to(output).parts[0]: "" for path in output.rglob("*") if path.is_file()}
    return {**rows, **files, **others}


def kill(process: subprocess.Popen[bytes], number: int, target: str, choose: random.Random) -> None:
    """Send a signal to the parent, to one of its children, or to the group."""
    with contextlib.suppress(ProcessLookupError, psutil.NoSuchProcess):
        if target == "group":
            os.killpg(process.pid, number)
        elif target == "parent":
            process.send_signal(number)
        else:
            children = psutil.Process(process.pid).children(recursive=True)
            if children:
                choose.choice(children).send_signal(number)


def left_over(process: subprocess.Popen[bytes]) -> list[str]:
    """Processes of the group that run on some seconds after it was killed."""
    end = time.monotonic() + 10.0
    while True:
        alive = [
            str(one.info["cmdline"])
            for one in psutil.process_iter(["cmdline", "status"])
            if one.info["status"] != psutil.STATUS_ZOMBIE and _session(one.pid) == process.pid
        ]
        if not alive or time.monotonic() > end:
            return alive
        time.sleep(0.1)


def _session(number: int) -> int:
    with contextlib.suppress(ProcessLookupError, PermissionError):
        return os.getsid(number)
    return 0


def main() -> None:
    """Run the rounds."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rounds", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    choose, faults = random.Random(options.seed), 0  # noqa: S311
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        inputs, temporary = folder / "in", folder / "tmp"
        inputs.mkdir()
        temporary.mkdir()
        for name, shape in SHAPES.items():
            shape.export(inputs / f"{name}.stl")
        finished(inputs, folder / "warm", temporary)
        began = time.monotonic()
        problem = finished(inputs, folder / "whole", temporary)
        whole, duration = contents(folder / "whole"), time.monotonic() - began
        print(f"an undisturbed run takes {duration:.1f} s{problem}", flush=True)
        ways = list(product(SIGNALS, TARGETS))
        for number in range(options.rounds):
            signal_number, target = ways[number % len(ways)]
            output = folder / f"out{number}"
            process = started(inputs, output, temporary)
            time.sleep(choose.uniform(0.1, duration))
            kill(process, signal_number, target, choose)
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.communicate(timeout=60)
            running = left_over(process)
            problem = finished(inputs, output, temporary)
            resumed = contents(output)
            differing = [name for name in whole.keys() | resumed.keys()
                         if whole.get(name) != resumed.get(name)]  # fmt: skip
            remains = [path.name for path in temporary.iterdir()]
            seen = {"message": problem, "differing": differing, "left": remains, "alive": running}
            faults += any(seen.values())
            if any(seen.values()):
                name = f"round {number}, {signal.Signals(signal_number).name} to the {target}"
                print(f"{name}: {seen}", flush=True)
            elif number % 10 == 9:
                print(f"{number + 1} rounds, {faults} faults", flush=True)
    print(f"{faults} of {options.rounds} rounds left a difference, a file or a process")
    raise SystemExit(bool(faults))


if __name__ == "__main__":
    main()
