"""Results at the nominal, the smallest and the largest friction of contacts."""

from collections.abc import Callable
from typing import NamedTuple, TypeVar

from grasp3d.contact.contacts import Contacts
from grasp3d.system.progress import Progress, ignore, within

Tilt = TypeVar("Tilt")
Result = TypeVar("Result")


class FrictionCases(NamedTuple):
    """The same contacts at three frictions."""

    nominal: Contacts
    weakest: Contacts
    """With the smallest friction."""
    strongest: Contacts
    """With the largest friction."""


def over_friction(
    evaluated: Callable[[Contacts, Tilt | float, Progress], Result],
    cases: FrictionCases,
    tilt: Tilt,
    progress: Progress,
) -> tuple[Result, Result, Result]:
    """Results at the nominal, the smallest and the largest friction.

    Args:
        evaluated: Its result for contacts, the largest tilt of their normals, and a callback.
        cases: The contacts.
        tilt: Largest tilt at the smallest and at the largest friction; nominal normals are exact.
        progress: Called with the fraction of the work done, from 0 to 1.
    """
    return (
        evaluated(cases.nominal, 0.0, ignore),
        evaluated(cases.weakest, tilt, within(progress, 0.0, 0.5)),
        evaluated(cases.strongest, tilt, within(progress, 0.5, 1.0)),
    )
