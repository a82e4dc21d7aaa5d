"""Units in which an object is plausible, and lengths that are not, or cannot be meant."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import get_args

from grasp3d.errors import SettingError
from grasp3d.mesh.object_mesh import ObjectMesh
from grasp3d.settings.lengths import (
    METRES,
    AnyLength,
    LengthSettings,
    Measure,
    Unit,
    describe_length,
    length_in_unit,
)

PLAUSIBLE = (0.002, 2.0)
"""Sizes of objects that a hand can hold [m]."""

POSSIBLE = (2e-6, 2e3)
"""Sizes beyond which a wrong unit is no explanation [m]: the units differ by up to 1000."""

USUAL = (0.01, 0.5)
"""Sizes of most such objects [m]."""

PREFERRED: tuple[Unit, ...] = ("m", "mm")
"""Units of robotics and of CAD. No object has a usual size in both."""

DENSEST = 25e3
"""Density above those of all materials [kg/m^3]: osmium has 22,600."""

LIGHTEST = 1.0, 0.02
"""Density [kg/m^3] below those of foams, and mass per area [kg/m^2] below those of thin shells."""

SMALLEST, LARGEST = 0.1, 10.0
"""Sizes that a gripper may be meant for: in sizes of its pads, and in strokes."""

_ROUNDING = 1e-9


@dataclass(frozen=True)
class UnitGuess:
    """Likely unit of a mesh's coordinates."""

    unit: Unit | None
    """The likely unit; None if none is plausible, or several are equally so."""
    reason: str
    """Reason, in one sentence."""


def guess_unit(size: float) -> UnitGuess:
    """Guess the unit of a mesh that states none; the guess is reported and never applied.

    Args:
        size: Largest extent of the object, in the unknown unit.
    """
    usual = _fitting(size, USUAL)
    likely = tuple(unit for unit in PREFERRED if unit in usual)
    if not likely:
        plausible = _fitting(size, PLAUSIBLE)
        likely = tuple(unit for unit in plausible if unit in usual or unit in PREFERRED)
    unit, units, remark = None, get_args(Unit), "; no hand holds any of these"
    if len(likely) > 1:
        units, remark = likely, "; these are equally plausible"
    elif likely:
        unit, units, remark = likely[0], tuple(dict.fromkeys((*likely, *PREFERRED))), ""
    sizes = ", ".join(f"{length_text(size * METRES[one])} if {one}" for one in units)
    return UnitGuess(unit, f"largest extent {size:.4g}: {sizes}{remark}")


def unit_warning(size: float, unit: Unit) -> str:
    """Warning that a stated unit is implausible; empty where it is plausible.

    Args:
        size: Size of the object, in that unit.
        unit: The unit that the file or the user states.
    """
    if unit in _fitting(size, PLAUSIBLE):
        return ""
    text = f"the object is {length_text(size * METRES[unit])} large if its unit is {unit}"
    guess = guess_unit(size).unit
    better = _fitting(size, PLAUSIBLE) if guess is None else (guess,)
    if not better:
        return f"{text}; no unit (m, cm, mm, in) makes it one that a hand may hold"
    sizes = _listed([length_text(size * METRES[other]) for other in better])
    return f"{text}: is the unit right? If its unit were {_listed(better)} it would be {sizes}"


def impossible_size(size: float, unit: Unit | None) -> str:
    """Warning that an object cannot have a size; empty where it can.

    Args:
        size: Size of the object, in its unit.
        unit: The unit; None: not stated.
    """
    least, most = POSSIBLE
    if any(least <= size * METRES[one] <= most for one in ((unit,) if unit else get_args(Unit))):
        return ""
    text = length_text(size * METRES[unit]) if unit else f"{size:.2g} in any unit"
    return (
        f"the object is {text} large: no object to grasp is; is the transform of a part or a "
        "vertex of the file wrong?"
    )


@dataclass(frozen=True)
class Purpose:
    """What an object is to be used for, by which its size is judged."""

    mass: float | None = None
    """[kg]; None: not known."""
    has_density: bool = False
    """Whether the mass follows from a density, and so from the unit."""
    pad: float = 0.0
    """Side of a square as large as a pad of the gripper [m]; 0: there is none."""
    stroke: float = math.inf
    """Stroke of the gripper [m]; inf: there is none."""

    def problems(self, mesh: ObjectMesh, unit: Unit) -> Iterator[str]:
        """What is implausible about an object if its coordinates are in a unit."""
        metres, mass, known = METRES[unit], self.mass, not math.isnan(mesh.volume)
        size = mesh.size * metres
        if mass is not None:
            # An open surface has no volume, but encloses none that is larger than the ball.
            volume = mesh.volume * metres**3 if known else math.pi / 6.0 * size**3
            density, text = mass / volume, f"with {mass:.4g} kg it has"
            if density > DENSEST:
                yield f"{text} {float(f'{density:.2g}'):,.0f} kg/m^3, more than any material"
            cover = mass / (mesh.area * metres**2)
            if known and density < LIGHTEST[0] and cover < LIGHTEST[1]:
                yield f"{text} {density:.2g} kg/m^3 and {cover:.2g} kg/m^2, less than foam or foil"
        if size < SMALLEST * self.pad:
            yield f"a pad of the gripper, {length_text(self.pad)}, is over ten times larger"
        if size > LARGEST * self.stroke:
            yield f"it is larger than ten strokes of the gripper, {length_text(self.stroke)} each"


def object_warnings(mesh: ObjectMesh, purpose: Purpose) -> tuple[str, ...]:
    """Warnings of a mesh, the one on its size with what is implausible for a purpose, too.

    Args:
        mesh: The object; without a unit nothing further is known of its size.
        purpose: Its mass, and the gripper.
    """
    warnings, unit = mesh.report.warnings, mesh.unit
    if unit is None or impossible_size(mesh.size, unit):
        return warnings
    problems = list(purpose.problems(mesh, unit))
    if not problems:
        return warnings
    own = unit_warning(mesh.size, unit)
    others = (text for text in warnings if text != own)
    remedy = "; ".join(_remedies(mesh, unit, purpose)) or "is its unit right (--unit)?"
    text = f"the object is {length_text(mesh.size * METRES[unit])} large: {', and '.join(problems)}"
    return (*others, f"{text}: {remedy}")


def _remedies(mesh: ObjectMesh, unit: Unit, purpose: Purpose) -> Iterator[str]:
    """Other units, of the coordinates or of the mass, with which an object is plausible."""
    given = purpose.mass
    if purpose.has_density:
        return
    fitting = [one for one in _fitting(mesh.size, USUAL) if not any(purpose.problems(mesh, one))]
    if fitting:
        other = min(fitting, key=lambda one: (one not in PREFERRED, one))
        size = length_text(mesh.size * METRES[other])
        yield f"with --unit {other} it is {size}"
    if given is None or unit not in _fitting(mesh.size, PLAUSIBLE):
        return
    if not any(replace(purpose, mass=1e-3 * given).problems(mesh, unit)):
        yield f"if its mass is {given:.4g} g, give --mass {given:.4g}g"


def length_text(metres: float) -> str:
    """Write a length to two digits, in metres, centimetres or millimetres."""
    for unit in ("m", "cm", "mm"):
        rounded = float(f"{metres / METRES[unit]:.2g}")
        if rounded >= 1.0:
            break
    return f"{rounded:g} {unit}"


def _fitting(size: float, limits: tuple[float, float]) -> tuple[Unit, ...]:
    """Units in which a size is within limits [m]."""
    least, most = limits[0] * (1.0 - _ROUNDING), limits[1] * (1.0 + _ROUNDING)
    return tuple(unit for unit in get_args(Unit) if least <= size * METRES[unit] <= most)


def _listed(words: Sequence[str]) -> str:
    return " or ".join(filter(None, [", ".join(words[:-1]), words[-1]]))


@dataclass(frozen=True)
class PlausibleRange:
    """Range of a length, as fractions of the object's size."""

    least: float
    """A smaller length cannot be meant."""
    small: float
    """A smaller length is probably in another unit."""
    most: float
    """A larger length cannot be meant."""
    usual: float
    """An ordinary length, by which the unit is guessed."""
    example: str
    """A length with a unit, for errors."""


LIMIT = PlausibleRange(1.0 / 500.0, 0.01, 100.0, usual=0.5, example="80mm")
PART = PlausibleRange(0.0, 0.01, 1.0, usual=0.05, example="5mm")
RANGES = {
    "min_opening": PART,
    "max_opening": LIMIT,
    "min_separation": PART,
    "torsion_radius": PART,
    "location_error": PlausibleRange(0.0, 0.0, 1.0, usual=0.02, example="2mm"),
    "max_distance": PlausibleRange(0.0, 0.0, 1.0, usual=0.02, example="2mm"),
}
"""Ranges by the name of the setting; others may have any length."""

LIKELY = 20.0
"""Factor from an ordinary length up to which a unit is likely."""


def length_warnings(
    lengths: Mapping[str, float | None], size: float, unit: Unit | None
) -> tuple[str, ...]:
    """Return a message for each length that is probably not in the mesh's unit.

    Args:
        lengths: Lengths in the mesh's unit, by the name of the setting.
        size: Diameter of the object, in the mesh's unit.
        unit: The mesh's unit; None: not known.
    """
    own = f" {unit}" if unit else ""
    stated = f"in {unit}" if unit else "in the mesh's unit, which is not stated"
    return tuple(
        f"{name} is {length:.4g}{own}, {_times(length / size)} the object's size, {size:.4g}{own}: "
        f"is it in another unit? Lengths without a unit are {stated}"
        for name, length, limits in _given(lengths)
        if not limits.small <= length / size <= limits.most
    )


def check_lengths(
    lengths: Mapping[str, AnyLength | None], size: float, unit: Unit | None, source: str
) -> None:
    """Refuse a length that cannot be meant for an object of this size.

    Args:
        lengths: Lengths by the name of the setting: numbers in the mesh's unit, or as they were
            given, with a unit, which then is in the message.
        size: Diameter of the object, in the mesh's unit.
        unit: The mesh's unit; None: not known.
        source: Name of the mesh.

    Raises:
        SettingError: There is such a length; the message names the unit that is likely. Or a length
            has a unit, but the mesh has none.
    """
    numbers = {
        name: length_in_unit(name, length, unit, source=source) for name, length in lengths.items()
    }
    for name, length, limits in _given(numbers):
        if limits.least <= length / size <= limits.most:
            continue
        own = f" {unit}" if unit else ""
        entry = lengths[name]
        text = describe_length(entry) if isinstance(entry, Measure) else f"{length:.4g}{own}"
        remedy = _remedy(name, entry or length, size, unit, limits)
        raise SettingError(
            f"{name} is {text}, {_times(length / size)} the size of {source}, "
            f"{size:.4g}{own}: {remedy}, or accept it with --force "
            "(in Python force=True)"
        )


def refuse_lengths(
    mesh: ObjectMesh, *settings: LengthSettings | None, **lengths: AnyLength | None
) -> None:
    """Refuse lengths that cannot be meant for a mesh. See `check_lengths`.

    Args:
        mesh: The object; lengths of its options are checked as well.
        settings: Settings as they were given.
        lengths: Further lengths, as in `check_lengths`.

    Raises:
        SettingError: There is such a length.
    """
    given = mesh.options.lengths() | lengths
    for one in filter(None, settings):
        given |= one.lengths()
    check_lengths(given, mesh.size, mesh.unit, mesh.report.source)


def _given(lengths: Mapping[str, float | None]) -> Iterator[tuple[str, float, PlausibleRange]]:
    """Name, length and plausible range of the lengths that are set and have one."""
    for name, limits in RANGES.items():
        length = lengths.get(name)
        if length and 0.0 < length < math.inf:
            yield name, length, limits


def _remedy(
    name: str, length: AnyLength, size: float, unit: Unit | None, limits: PlausibleRange
) -> str:
    """What to write instead: the length in another unit, or the unit of the mesh."""
    own = isinstance(length, Measure)
    number = f"{length.number:.15g}" if isinstance(length, Measure) else f"{length:g}"
    usual, option = limits.usual * size, f"--{name.replace('_', '-')}"
    of_mesh = guess_unit(size).unit
    if of_mesh is not None and (unit is None or unit_warning(size, unit)):
        if isinstance(length, Measure) and _is_likely(length.in_unit(of_mesh), usual):
            return f"if the mesh is in {of_mesh}, not in {unit}, give --unit {of_mesh}"
        likely = None if own else _likely_unit(float(number), usual, of_mesh)
        if likely is not None:
            return (
                f"if the mesh is in {of_mesh} and the length in {likely}, give --unit {of_mesh} "
                f"and {option} {number}{likely}"
            )
    likely = None if unit is None else _likely_unit(float(number), usual, unit)
    if likely is not None:
        return f"if it is in {likely}, give {option} {number}{likely}"
    if own:
        return "check its number and its unit, and that of the mesh (--unit)"
    return f"give it with its unit, such as {limits.example}"


def _is_likely(length: float, usual: float) -> bool:
    return 1.0 / LIKELY <= length / usual <= LIKELY


def _likely_unit(length: float, usual: float, unit: Unit) -> Unit | None:
    """The unit in which a length is nearest to the usual length; None: none is near."""
    ratios = {other: length * METRES[other] / (usual * METRES[unit]) for other in METRES}
    nearest = min(ratios, key=lambda other: abs(math.log(ratios[other])))
    return nearest if _is_likely(ratios[nearest], 1.0) else None


def _times(ratio: float) -> str:
    if ratio >= 100.0:
        return f"{ratio:,.0f} times"
    return f"{ratio:.3g} times" if ratio > 1.0 else f"1/{1.0 / ratio:,.0f} of"
