"""A window on a virtual screen, and real events for it."""

import ctypes
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import ImageGrab
from scipy.ndimage import label

from grasp3d.pictures.opengl import WINDOW

TIMEOUT = 90.0
"""Longest wait for any condition [s]."""
SCREEN = (1280, 1024)

MISSING = [name for name in ("Xvfb", "xdotool") if shutil.which(name) is None]
needs_screen = pytest.mark.skipif(
    bool(MISSING) and os.environ.get("CI") != "true", reason=f"needs {', '.join(MISSING)}"
)
"""In continuous integration, missing programs are a failure."""

Image8 = NDArray[np.uint8]


def wait_for(condition: Callable[[], Any], what: str) -> Any:
    end = time.monotonic() + TIMEOUT
    while time.monotonic() < end:
        found = condition()
        if found:
            return found
        time.sleep(0.02)
    raise AssertionError(f"timeout while waiting for {what}")


@contextmanager
def screen() -> Iterator[str]:
    """A new virtual display."""
    reading, writing = os.pipe()
    size = f"{SCREEN[0]}x{SCREEN[1]}x24"
    server = subprocess.Popen(
        # Without -noreset the server restarts after the last window, and may refuse the next one.
        ["Xvfb", "-displayfd", str(writing), "-screen", "0", size, "-nolisten", "tcp", "-noreset"],  # noqa: S607
        pass_fds=[writing],
        stderr=subprocess.DEVNULL,
    )
    os.close(writing)
    try:
        with os.fdopen(reading) as stream:
            yield f":{stream.readline().strip()}"
    finally:
        server.terminate()
        server.wait()


@dataclass
class Window:
    """A viewer's window in a child process, which writes a line for each rendering."""

    process: subprocess.Popen[str]
    display: str
    lines: Path
    folder: Path

    @classmethod
    @contextmanager
    def open(cls, script: str, folder: Path) -> Iterator["Window"]:
        """Open a window alone on its screen: tests find it by name, and it has the mouse."""
        lines, work = folder / "lines.jsonl", folder / "work"
        lines.touch()
        work.mkdir()
        # Pictures rendered earlier in this process may have selected an off-screen window.
        kept = {name: value for name, value in os.environ.items() if name != WINDOW}
        with screen() as display:
            process = subprocess.Popen(
                [sys.executable, "-c", script, str(lines)],
                env={**kept, "DISPLAY": display}, cwd=work, text=True,
                stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            )  # fmt: skip
            made = cls(process, display, lines, work)
            try:
                made.until(lambda state: state["fractions"], "labels")
                wait_for(lambda: made.number, "a window with a title")
                made.do("windowfocus", made.number)
                yield made
            finally:
                process.kill()
                process.communicate()

    @property
    def number(self) -> str:
        """Number of the window with the tested title; '' until it exists."""
        words = ["search", "--name", "^a window to test$"]
        return self.do(*words, check=False).strip()  # fails if there is none

    @property
    def state(self) -> dict[str, Any]:
        """The state at the last rendering."""
        whole = self.lines.read_text(encoding="utf-8").rpartition("\n")[0]
        return json.loads(whole.rpartition("\n")[2]) if whole else {"fractions": {}}

    def until(self, condition: Callable[[dict[str, Any]], Any], what: str) -> dict[str, Any]:
        """Wait until the rendered state meets a condition."""

        def found() -> dict[str, Any] | None:
            state = self.state
            if self.process.poll() is not None:
                raise AssertionError(f"the window has been closed: {self.process.communicate()}")
            return state if condition(state) else None

        return wait_for(found, f"{what}; {self.state}")

    def do(self, *words: object, check: bool = True) -> str:
        return subprocess.run(
            ["xdotool", *map(str, words)],  # noqa: S607
            env={**os.environ, "DISPLAY": self.display},
            check=check, capture_output=True, text=True,
        ).stdout  # fmt: skip

    def key(self, *names: str) -> None:
        self.do("key", *names)

    def click(self, x: float, y: float) -> None:
        self.do("mousemove", round(x), round(y), "click", 1)

    def drag(self, *positions: tuple[float, float]) -> None:
        """Press at the first position, move through the others, release at the last."""
        words: list[object] = []
        for number, (start, end) in enumerate(pairwise(positions)):
            words += ["mousemove", *map(round, start), *([] if number else ["mousedown", 1])]
            for step in range(1, 9):
                at = [round(a + (b - a) * step / 8.0) for a, b in zip(start, end, strict=True)]
                words += ["sleep", 0.01, "mousemove", *at]
        self.do(*words, "mouseup", 1)

    def thumbs(self) -> list[tuple[float, float]]:
        """Centres of the sliders' thumbs, from the top."""
        image = self.picture().astype(int)
        blue = np.abs(image - (0x1F, 0x5F, 0xA8)).max(axis=2) < 8
        wide = blue & np.roll(blue, 4, axis=1)  # letters are not as wide
        regions, count = label(wide)
        found = [np.argwhere(regions == number + 1) for number in range(count)]
        middles = [one.mean(axis=0) for one in found if len(one) > 30]
        return [(float(x) - 2.0, float(y)) for y, x in middles]

    def slide(self, number: int, by: float) -> None:
        """Drag the thumb of a slider to the right [pixels]."""
        x, y = self.thumbs()[number]
        self.drag((x, y), (x + by, y))

    def picture(self) -> Image8:
        """Picture of the window on the screen, shape (height, width, 3)."""
        window = dict(
            line.split("=") for line in self.do("getwindowgeometry", "--shell", self.number).split()
        )
        left, top, width, height = (int(window[name]) for name in ("X", "Y", "WIDTH", "HEIGHT"))
        image = ImageGrab.grab(xdisplay=self.display).convert("RGB")
        return np.array(image.crop((left, top, left + width, top + height)))

    def close(self) -> None:
        """Send WM_DELETE_WINDOW, as the window's close button does."""
        x = ctypes.CDLL("libX11.so.6")
        x.XOpenDisplay.restype = ctypes.c_void_p
        display = ctypes.c_void_p(x.XOpenDisplay(self.display.encode()))
        x.XInternAtom.restype = ctypes.c_ulong
        names = (b"WM_PROTOCOLS", b"WM_DELETE_WINDOW")
        protocols, delete = (x.XInternAtom(display, name, 0) for name in names)
        message = (ctypes.c_ulong * 24)()  # an XEvent is as large as 24 longs
        message[0] = 33  # ClientMessage
        message[4], message[5], message[6] = int(self.number), protocols, 32
        message[7] = delete
        assert x.XSendEvent(display, ctypes.c_ulong(message[4]), 0, 0, ctypes.byref(message))
        x.XCloseDisplay(display)  # after all requests have been processed

    def ended(self) -> tuple[int, str, str]:
        """Wait for the end of the process; return exit code, and printed texts."""
        out, err = self.process.communicate(timeout=TIMEOUT)
        return self.process.returncode, out, err
