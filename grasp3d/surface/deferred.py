"""Attributes that are computed once, when they are first read."""

import threading
from collections.abc import Callable
from functools import cached_property
from typing import Any, TypeVar
from weakref import WeakKeyDictionary

T = TypeVar("T")


class Deferred(cached_property[T]):
    """An attribute that is computed when it is first read.

    Several threads that read the attribute of one instance compute it once. The value is in the
    instance's dictionary, under the name of the attribute: it is read as fast as any attribute, and
    pickled with the instance.
    """

    def __init__(self, function: Callable[[Any], T]) -> None:
        super().__init__(function)
        self._locks: WeakKeyDictionary[Any, threading.Lock] = WeakKeyDictionary()
        self._making = threading.Lock()

    def __get__(self, instance: Any, owner: type[Any] | None = None) -> Any:
        """The value, computed if it is not known; of a class the descriptor itself."""
        if instance is None:
            return self
        values, name = vars(instance), self.attrname or ""
        with self._making:
            lock = self._locks.setdefault(instance, threading.Lock())
        with lock:
            if name not in values:
                values[name] = self.func(instance)
        return values[name]

    def computed(self, instance: object) -> T | None:
        """The value if it is known already, else None."""
        value: T | None = vars(instance).get(self.attrname or "")
        return value

    def know(self, instance: object, value: T) -> None:
        """Set the value, which is known already, instead of computing it.

        Args:
            instance: What has the attribute.
            value: Its value.
        """
        vars(instance)[self.attrname or ""] = value
