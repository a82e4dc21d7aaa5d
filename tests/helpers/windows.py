"""A window on a screen that nobody sees, and real events for it."""

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

from grasp3d.rendering import WINDOW

PATIENCE = 90.0
"""Longest wait for anything [s]; machines are slow at times."""
SCREEN = (1280, 1024)

MISSING = [name for name in ("Xvfb", "xdotool") if shutil.which(name) is None]
needs_screen = pytest.mark.skipif(
    bool(MISSING) and os.environ.get("CI") != "true", reason=f"needs {', '.join(MISSING)}"
)
"""Where the project itself is tested, missing tools are a failure."""

Image8 = NDArray[np.uint8]


def wait_for(condition: Callable[[], Any], what: str) -> Any:
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        found = condition()
        if found:
            return found
        time.sleep(0.02)
    raise AssertionError(f"waited in vain: {what}")


@contextmanager
def screen() -> Iterator[str]:
    """A display of its own, whatever other displays there are."""
    reading, writing = os.pipe()
    size = f"{SCREEN[0]}x{SCREEN[1]}x24"
    server = subprocess.Popen(
        ["Xvfb", "-displayfd", str(writing), "-screen", "0", size, "-nolisten", "tcp"],  # noqa: S607
        pass_fds=[writing],
        stderr=subprocess.DEVNULL,
    )
    os.close(writing)
    try:
        with os.fdopen(reading) as told:
            yield f":{told.readline().strip()}"
    finally:
        server.terminate()
        server.wait()


@dataclass
class Window:
    """A viewer's window in a process of its own, which writes a line for each drawing."""

    process: subprocess.Popen[str]
    display: str
    lines: Path
    folder: Path

    @classmethod
    def open(cls, script: str, display: str, folder: Path) -> "Window":
        lines = folder / "lines.jsonl"
        lines.touch()
        folder = folder / "work"
        folder.mkdir()
        # Pictures drawn before, in this process, have chosen a window without a screen.
        kept = {name: value for name, value in os.environ.items() if name != WINDOW}
        process = subprocess.Popen(
            [sys.executable, "-c", script, str(lines)],
            env={**kept, "DISPLAY": display}, cwd=folder, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        )  # fmt: skip
        made = cls(process, display, lines, folder)
        made.until(lambda told: told["shares"], "labels")
        made.do("windowfocus", made.number)
        return made

    @property
    def number(self) -> str:
        return self.do("search", "--name", "^a window to test$").split()[0]

    @property
    def told(self) -> dict[str, Any]:
        """The last that was drawn."""
        whole = self.lines.read_text(encoding="utf-8").rpartition("\n")[0]
        return json.loads(whole.rpartition("\n")[2]) if whole else {"shares": {}}

    def until(self, condition: Callable[[dict[str, Any]], Any], what: str) -> dict[str, Any]:
        """Wait until what is drawn is as it should be."""

        def found() -> dict[str, Any] | None:
            told = self.told
            if self.process.poll() is not None:
                raise AssertionError(f"the window is gone: {self.process.communicate()}")
            return told if condition(told) else None

        return wait_for(found, f"{what}; {self.told}")

    def do(self, *words: object) -> str:
        return subprocess.run(
            ["xdotool", *map(str, words)],  # noqa: S607
            env={**os.environ, "DISPLAY": self.display},
            check=True, capture_output=True, text=True,
        ).stdout  # fmt: skip

    def key(self, *names: str) -> None:
        self.do("key", *names)

    def click(self, x: float, y: float, *, shift: bool = False) -> None:
        held = (["keydown", "shift"], ["keyup", "shift"]) if shift else ([], [])
        self.do("mousemove", round(x), round(y), *held[0], "click", 1, *held[1])

    def press(self, name: str) -> None:
        """Click a button of the panel."""
        left, top, right, bottom = self.told["spots"][name][0]
        self.click(0.5 * (left + right), 0.5 * (top + bottom))

    def drag(self, *places: tuple[float, float]) -> None:
        """Press at the first place, go through the others, release at the last."""
        words: list[object] = []
        for number, (start, end) in enumerate(pairwise(places)):
            words += ["mousemove", *map(round, start), *([] if number else ["mousedown", 1])]
            for step in range(1, 9):
                at = [round(a + (b - a) * step / 8.0) for a, b in zip(start, end, strict=True)]
                words += ["sleep", 0.01, "mousemove", *at]
        self.do(*words, "mouseup", 1)

    def slide(self, name: str, share: float) -> None:
        """Drag the thumb of a slider to a place on its track."""
        (_, top, _, bottom), (start, end) = self.told["spots"][name]
        y = 0.3 * top + 0.7 * bottom
        now = start + self.told["thumbs"][name] * (end - start)
        self.drag((now, y), (start + share * (end - start), y))

    def picture(self) -> Image8:
        """What is on the screen, shape (height, width, 3)."""
        window = dict(
            line.split("=") for line in self.do("getwindowgeometry", "--shell", self.number).split()
        )
        left, top, width, height = (int(window[name]) for name in ("X", "Y", "WIDTH", "HEIGHT"))
        image = ImageGrab.grab(xdisplay=self.display).convert("RGB")
        return np.array(image.crop((left, top, left + width, top + height)))

    def ask_to_close(self) -> None:
        """What the button of a window's frame does: WM_DELETE_WINDOW."""
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
        x.XSendEvent(display, ctypes.c_ulong(message[4]), 0, 0, ctypes.byref(message))
        x.XCloseDisplay(display)

    def ended(self) -> tuple[int, str, str]:
        """Wait for the end: the code, and what was printed."""
        out, err = self.process.communicate(timeout=PATIENCE)
        return self.process.returncode, out, err
