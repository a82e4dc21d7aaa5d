"""Checks of the messages that browsers send, before trame handles them."""

import inspect
import logging
import time
from collections.abc import Callable, Container
from typing import Any

from aiohttp import WSMessage, WSMsgType
from wslink.chunking import UnChunker

from grasp3d.errors import GraspError
from grasp3d.system.names import printable

LOG = logging.getLogger("grasp3d.viewer.web")
"""What the server reports."""

MAX_MESSAGE_BYTES = 1 << 20
"""Largest message from a browser; these are mouse events [bytes]."""

LONGEST_REASON = 200
"""Characters of a reason in the log."""

MOST_LINES, LOG_PERIOD = 30, 10.0
"""Number of lines that are logged in a period [s]; the others are only counted."""

VIEW = "view"
"""Name of the page's one picture."""

SYSTEM = "system"
"""Beginning of the identifiers of wslink's own messages."""


BUTTONS = tuple(
    f"{side}Button{what}" for side in ("Left", "Middle", "Right") for what in ("Press", "Release")
)
WHEELS = ("StartMouseWheel", "MouseWheel", "EndMouseWheel")
GESTURES = tuple(
    f"{when}{what}" for when in ("Start", "", "End") for what in ("Pinch", "Rotate", "Pan")
)
EVENTS = frozenset({"MouseMove", *BUTTONS, *WHEELS, *GESTURES})
"""Kinds of events that reach VTK."""
NUMBERS = (
    "x", "y", "w", "h", "ctrlKey", "altKey", "shiftKey", "metaKey", "spinY", "factor", "rotation",
)  # fmt: skip
MAX_TOUCHES = 10
MAX_NUMBER = 1e6


class MessageError(GraspError):
    """A browser has sent a message that no page of this server sends."""


class Terse(logging.Filter):
    """Makes every record one line, and passes few of them, so that no client fills a disk."""

    def __init__(self) -> None:
        super().__init__()
        self._began, self._count = -LOG_PERIOD, 0

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether a record is written; it says then how many were not."""
        error = record.exc_info[1] if record.exc_info else None
        text = " ".join(record.getMessage().split())
        record.msg, record.args = f"{text}: {one_line(error)}" if error else text, ()
        record.exc_info = record.exc_text = None
        now, left_out = time.monotonic(), self._count - MOST_LINES
        if now - self._began >= LOG_PERIOD:
            if left_out > 0:
                record.msg += f" (and {left_out:,} more lines before that were not written)"
            self._began, self._count = now, 0
        self._count += 1
        return self._count <= MOST_LINES


LOG.addFilter(Terse())


def check_message(message: WSMessage, methods: Container[str]) -> None:
    """Check that a message is a complete call of a known method.

    trame would otherwise reserve as much memory as a message promises, and print a traceback for
    what it cannot decode.

    Args:
        message: From a browser's socket.
        methods: Names of the known methods.

    Raises:
        MessageError: It is malformed.
    """
    if message.type is WSMsgType.ERROR:
        raise MessageError(one_line(message.data))
    if message.type is not WSMsgType.BINARY:
        raise MessageError(f"{message.type.name.lower()} instead of binary data")
    reader = UnChunker()
    reader.set_max_message_size(MAX_MESSAGE_BYTES)
    try:
        call = reader.process_chunk(message.data)
    except (ValueError, TypeError, RecursionError) as error:
        raise MessageError(one_line(error)) from error
    if not isinstance(call, dict):
        kind = "an incomplete message" if call is None else type(call).__name__
        raise MessageError(f"{kind} instead of a call")
    _check_call(call, methods)


def checked_event(event: dict[str, Any]) -> dict[str, Any]:
    """An event of the mouse or of fingers with every value that VTK reads, 0 if it was not given.

    VTK ends the process where a value is missing or of another type.

    Raises:
        MessageError: A value is not of its type.
    """
    touches, shift = event.get("positions", {}), event.get("translation", (0.0, 0.0))
    if not isinstance(touches, dict) or len(touches) > MAX_TOUCHES:
        raise MessageError("an event whose positions are not those of some fingers")
    if not isinstance(shift, list | tuple) or len(shift) != 2:
        raise MessageError("an event whose translation is not two numbers")
    return {
        "type": event["type"],
        **{name: _number(event.get(name, 0)) for name in NUMBERS},
        "translation": [_number(one) for one in shift],
        "positions": {
            str(finger): {axis: _number(at[axis]) for axis in "xy"}
            for finger, at in touches.items()
        },
    }


def guarded(function: Callable[..., Any], report: Callable[[str], None]) -> Callable[..., Any]:
    """A method that browsers call, whose exceptions are reported in one line instead of raised.

    Args:
        function: The method.
        report: Called with the reason.
    """

    async def awaited(result: Any) -> Any:
        try:
            return await result
        except Exception as error:  # noqa: BLE001
            report(one_line(error))

    def called(*args: Any, **kwargs: Any) -> Any:
        try:
            result = function(*args, **kwargs)
        except Exception as error:  # noqa: BLE001
            report(one_line(error))
            return None
        return awaited(result) if inspect.isawaitable(result) else result

    return called


def one_line(error: object) -> str:
    """An error as one short line."""
    name = f"{type(error).__name__}: " if isinstance(error, Exception) else ""
    return printable(" ".join(f"{name}{error}".split()))[:LONGEST_REASON]


def _number(value: object) -> float:
    if not isinstance(value, int | float) or not -MAX_NUMBER <= value <= MAX_NUMBER:
        raise MessageError(f"an event with {one_line(repr(value))} instead of a number")
    return value


def _check_call(call: dict[Any, Any], methods: Container[str]) -> None:
    name, number = call.get("method"), call.get("id")
    if not isinstance(name, str) or not isinstance(number, str):
        raise MessageError("a call without a method and an identifier")
    if name not in methods and not number.startswith(SYSTEM):
        raise MessageError(f"there is no method {name[:LONGEST_REASON]!r}")
    if not isinstance(call.get("args", []), list) or not isinstance(call.get("kwargs", {}), dict):
        raise MessageError(f"{name}: its arguments are neither a list nor a mapping")
    if name.startswith("trame.rca.") and VIEW not in call.get("args", [])[:1]:
        raise MessageError(f"{name}: there is no such picture")  # trame would print a line
