"""Checks of the messages that browsers send, before trame handles them."""

import inspect
from collections.abc import Callable, Container
from typing import Any

from aiohttp import WSMessage, WSMsgType
from wslink.chunking import UnChunker

from grasp3d.errors import GraspError
from grasp3d.system.names import printable

MAX_MESSAGE_BYTES = 1 << 20
"""Largest message from a browser; these are mouse events [bytes]."""

LONGEST_REASON = 200
"""Characters of a reason in the log."""

SYSTEM = "system"
"""Beginning of the identifiers of wslink's own messages."""


class MessageError(GraspError):
    """A browser has sent a message that no page of this server sends."""


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


def _check_call(call: dict[Any, Any], methods: Container[str]) -> None:
    name, number = call.get("method"), call.get("id")
    if not isinstance(name, str) or not isinstance(number, str):
        raise MessageError("a call without a method and an identifier")
    if name not in methods and not number.startswith(SYSTEM):
        raise MessageError(f"there is no method {name[:LONGEST_REASON]!r}")
    if not isinstance(call.get("args", []), list) or not isinstance(call.get("kwargs", {}), dict):
        raise MessageError(f"{name}: its arguments are neither a list nor a mapping")
