"""Overlapping receptive fields: finer than one field.

Sensing elements a pitch p apart, each of which reports whether the contact is within its own field
of length l, distinguish contacts by *which* of them report. Along a line, fields begin every p and
end every p, so the reports change at two combs of spacing p, shifted by l modulo p. At most n
fields cover a point, n - 1 being the whole part of l / p. Contacts where n fields report lie within
l - (n - 1) p of each other, and those between, where n - 1 report, within n p - l. The longer of
the two is the length within which contacts are not distinguished: p / 2 at best, for
l = p (n - 1/2), and p at worst, for l = p (n - 1).

The model: fields with sharp ends, equal lengths and pitches, yes or no from each, one direction on
the tip. Elements that report how strongly they are touched can be finer than this; noise and uneven
pitch make them coarser.
"""

import math

from grasp3d.errors import SettingError

ROUNDING = 1e-9
"""Fraction of a pitch by which a length may miss a whole number of pitches and count as one."""


def overlapping_field(receptive_field: float, pitch: float) -> float:
    """Length within which overlapping receptive fields do not distinguish contacts.

    It is the `receptive_field` of the `Sensor` that they are equal to.

    Args:
        receptive_field: Length l of the field of each sensing element, above 0.
        pitch: Distance p between the middles of neighbouring fields, above 0; at most the length of
            the fields, since there are gaps between them otherwise.

    Returns:
        max(l - (n - 1) p, n p - l), n - 1 being the whole part of l / p; from p / 2 to p.

    Raises:
        SettingError: A value is outside its range.

    Example:
        Fields of 6 mm every 4 mm are as good as fields of 2 mm side by side:

        >>> from grasp3d.contact import overlapping_field
        >>> overlapping_field(6.0, 4.0), overlapping_field(4.0, 4.0)
        (2.0, 4.0)
    """
    if not 0.0 < receptive_field < math.inf:
        raise SettingError(
            f"receptive field must be a finite length above 0; got {receptive_field:g}"
        )
    if not 0.0 < pitch <= receptive_field:
        raise SettingError(
            "pitch must be above 0 and at most the receptive field, or contacts between the fields "
            f"are not felt; got {pitch:g} for fields of {receptive_field:g}"
        )
    whole = math.floor(receptive_field / pitch + ROUNDING)
    rest = max(0.0, receptive_field - whole * pitch)  # 0: fields end where others begin
    return max(rest, pitch - rest)
