"""Fields of settings: they parse texts when settings are created, and format values for files."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from types import NoneType
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Self, TypeVar, get_args, get_type_hints

from grasp3d.errors import SettingError

ValueT = TypeVar("ValueT")
GivenT = TypeVar("GivenT")
SettingsT = TypeVar("SettingsT")

IN_PYTHON = object()
"""Note on the type of a field for which commands have no option; only Python sets it."""


class ParsedField(ABC, Generic[ValueT, GivenT]):
    """A field of settings that takes more types than it holds, such as a text.

    The field stores no values: settings keep them as any dataclass does, and the field parses what
    they are given at their creation. Type checkers read both types from the field.
    """

    def __init__(self, default: ValueT) -> None:
        self._default = default

    def __get__(self, _instance: object | None, _owner: type) -> ValueT:
        return self._default

    if TYPE_CHECKING:

        def __set__(self, _instance: object, value: GivenT) -> None: ...

    @abstractmethod
    def parse(self, name: str, value: Any) -> ValueT:
        """Parse a given value, which may be of the stored type already.

        Args:
            name: Name of the setting, for the error message.
            value: The given value.

        Raises:
            SettingError: The value is invalid.
        """

    def plain(self, value: Any) -> Any:
        """Value in files: a number, None, or a text that `parse` reads."""
        return value if value is None else float(value) if isinstance(value, float) else str(value)


class Settings:
    """Base of settings, which are frozen dataclasses; fields of type `ParsedField` parse values."""

    parsed_fields: ClassVar[Mapping[str, ParsedField[Any, Any]]] = {}
    """The fields of type `ParsedField`, by name."""
    lone: ClassVar[str] = ""
    """Name of the field that a lone number or text sets; empty: there is no such field."""

    def __init_subclass__(cls) -> None:
        own = {name: one for name, one in cls.__dict__.items() if isinstance(one, ParsedField)}
        cls.parsed_fields = {**cls.parsed_fields, **own}

    @classmethod
    def given(cls, name: str, value: Any) -> Self | None:
        """Return settings from settings, their plain form, or None.

        Args:
            name: Name of the settings, for the error message.
            value: Settings; a dict of fields; or the value of the `lone` field, if there is one.

        Raises:
            SettingError: The value is none of these, or a field is unknown or outside its range.

        Example:
            >>> import grasp3d
            >>> grasp3d.Load.given("load", "500 g").mass
            0.5
            >>> grasp3d.GraspModel.given("model", {"friction": 0.4}).friction
            0.4
        """
        if value is None or isinstance(value, cls):
            return value
        if isinstance(value, Mapping):
            names = [one.name for one in fields(cls)]  # type: ignore[arg-type]
            if unknown := [key for key in value if key not in names]:
                raise SettingError(f"{name} has no {unknown[0]!r}; known: {', '.join(names)}")
            return cls(**value)
        if cls.lone and isinstance(value, str | int | float):
            return cls(**{cls.lone: value})
        lone = f", its {cls.lone}" if cls.lone else ""
        raise SettingError(
            f"{name} must be {cls.__name__}(...), a dict of its fields{lone}; got {value!r}"
        )

    def __post_init__(self) -> None:
        for name, field in self.parsed_fields.items():
            raw = getattr(self, name)
            value = field.parse(name, raw)
            if value is not raw:
                object.__setattr__(self, name, value)


def plain_values(settings: Any) -> dict[str, Any]:
    """Return the values of settings as files have them, by field name.

    Args:
        settings: A dataclass.

    Returns:
        The values; intervals, points and tasks as texts, and nested settings as such a dictionary.
        `settings_of_texts` reads them.

    Example:
        >>> import grasp3d
        >>> from grasp3d.settings.parsing import plain_values
        >>> values = plain_values(grasp3d.GraspModel(torsion_radius="5mm", friction=(0.4, 0.6)))
        >>> values["torsion_radius"], values["friction"]
        (0.005, '0.4..0.6')
    """
    kinds = getattr(settings, "parsed_fields", {})
    values = {one.name: getattr(settings, one.name) for one in fields(settings)}
    return {
        name: kinds[name].plain(value) if name in kinds else plain(value)
        for name, value in values.items()
    }


def settings_of_texts(kind: type[SettingsT], texts: Mapping[str, str]) -> SettingsT:
    """Create settings from texts in a file; fields that it lacks have their defaults.

    Args:
        kind: The class of the settings.
        texts: `str` of values as `plain_values` returns them; other names are ignored.

    Raises:
        ValueError: A text is not a number where a number is needed.
        SettingError: A value is outside its range.

    Example:
        >>> import grasp3d
        >>> from grasp3d.settings.parsing import settings_of_texts
        >>> found = settings_of_texts(grasp3d.GraspModel, {"fingers": "3", "edges": "8"})
        >>> found == grasp3d.GraspModel(fingers=3)
        True
    """
    hints, parsed = get_type_hints(kind), getattr(kind, "parsed_fields", {})
    names = [one.name for one in fields(kind) if one.name in texts]  # type: ignore[arg-type]
    values = {
        name: _value(texts[name], str | None if name in parsed else hints[name]) for name in names
    }
    return kind(**values)


def plain(value: Any) -> Any:
    """Return one value as files have it."""
    if isinstance(value, tuple | list):
        return type(value)(plain(one) for one in value)
    return plain_values(value) if is_dataclass(value) else value


def _value(text: str, hint: Any) -> Any:
    """Convert a text to the type of a field."""
    kinds = get_args(hint) or (hint,)
    if text == "None" and NoneType in kinds:
        return None
    return int(text) if int in kinds else float(text) if float in kinds else text
