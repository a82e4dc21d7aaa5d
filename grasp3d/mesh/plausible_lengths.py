"""Lengths that are not plausible for an object, and objects for what they are meant for."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from grasp3d.errors import SettingError
from grasp3d.mesh.object_mesh import ObjectMesh
from grasp3d.mesh.plausible_units import (
    PLAUSIBLE,
    PREFERRED,
    USUAL,
    fitting_units,
    guess_unit,
    impossible_size,
    length_text,
    unit_warning,
)
from grasp3d.mesh.refinement import DEFAULT_EDGE
from grasp3d.settings.units import METRES, LengthSettings, Metres, Unit, describe_length

DENSEST = 25e3
"""Density above those of all materials [kg/m^3]: osmium has 22,600."""

LIGHTEST = 1.0, 0.02
"""Density [kg/m^3] below those of foams, and mass per area [kg/m^2] below those of thin shells."""

SMALLEST, LARGEST = 0.1, 10.0
"""Sizes that a gripper may be meant for: in sizes of its pads, and in strokes."""


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
        metres, mass = METRES[unit] / mesh.file_scale, self.mass
        known, size = not math.isnan(mesh.volume), mesh.size * metres
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
    warnings, unit, size = mesh.report.warnings, mesh.file_unit, mesh.file_size
    if unit is None or impossible_size(size, unit):
        return warnings
    problems = list(purpose.problems(mesh, unit))
    if not problems:
        return warnings
    own = unit_warning(size, unit)
    others = (text for text in warnings if text != own)
    remedy = "; ".join(_remedies(mesh, unit, purpose)) or "is its unit right (--unit)?"
    text = f"the object is {length_text(mesh.size)} large: {', and '.join(problems)}"
    return (*others, f"{text}: {remedy}")


def _remedies(mesh: ObjectMesh, unit: Unit, purpose: Purpose) -> Iterator[str]:
    """Other units, of the coordinates or of the mass, with which an object is plausible."""
    given = purpose.mass
    if purpose.has_density:
        return
    size = mesh.file_size
    fitting = [one for one in fitting_units(size, USUAL) if not any(purpose.problems(mesh, one))]
    if fitting:
        other = min(fitting, key=lambda one: (one not in PREFERRED, one))
        yield f"with --unit {other} it is {length_text(size * METRES[other])}"
    if given is None or unit not in fitting_units(size, PLAUSIBLE):
        return
    if not any(replace(purpose, mass=1e-3 * given).problems(mesh, unit)):
        yield f"if its mass is {given:.4g} g, give --mass {given:.4g}g"


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
    "torsion_radius": PART,
    "location_error": PlausibleRange(0.0, 0.0, 1.0, usual=0.02, example="2mm"),
    "max_distance": PlausibleRange(0.0, 0.0, 1.0, usual=0.02, example="2mm"),
}
"""Ranges by the name of the setting; others may have any length."""

LIKELY = 20.0
"""Factor from an ordinary length up to which a unit is likely."""


def length_warnings(lengths: Mapping[str, float | None], mesh: ObjectMesh) -> tuple[str, ...]:
    """Return a message for each length that is probably in another unit than it is taken in.

    Args:
        lengths: Lengths by the name of the setting.
        mesh: The object.
    """
    stated = "in metres" if mesh.unit else "in the mesh's unit, which is not stated"
    return tuple(
        f"{_comparison(name, length, mesh)}: is it in another unit? Lengths without a unit are "
        f"{stated}"
        for name, length, limits in _given(lengths)
        if not limits.small <= length / mesh.size <= limits.most
    )


def refuse_lengths(
    mesh: ObjectMesh, *settings: LengthSettings | None, **lengths: float | None
) -> None:
    """Refuse lengths that cannot be meant for an object of this size.

    Args:
        mesh: The object; lengths of its options are checked as well.
        settings: Settings with lengths.
        lengths: Further lengths, by the name of the setting.

    Raises:
        SettingError: There is such a length; the message names the unit that is likely. Or a length
            has a unit, but the mesh has none.
    """
    mesh.check_units(*settings, tuple(lengths.values()))
    given = mesh.options.lengths() | lengths
    for one in filter(None, settings):
        given |= one.lengths()
    _refuse_edge(mesh, mesh.options.max_edge)
    for name, length, limits in _given(given):
        if not limits.least <= length / mesh.size <= limits.most:
            raise SettingError(
                f"{_comparison(name, length, mesh)}: {_remedy(name, length, mesh, limits)}, or "
                "accept it with --force (in Python force=True)"
            )


def _refuse_edge(mesh: ObjectMesh, edge: float | None) -> None:
    """Refuse a longest edge without a unit that divides no edge, and would in another unit."""
    if edge is None or isinstance(edge, Metres) or mesh.unit is None or edge <= mesh.size:
        return
    if unit := _likely_unit(edge, DEFAULT_EDGE * mesh.size):
        raise SettingError(
            f"{_comparison('max_edge', edge, mesh)}: if it is in {unit}, give --max-edge "
            f"{edge:g}{unit}, or accept it with --force (in Python force=True)"
        )


def _given(lengths: Mapping[str, float | None]) -> Iterator[tuple[str, float, PlausibleRange]]:
    """Name, length and plausible range of the lengths that are set and have one."""
    for name, limits in RANGES.items():
        length = lengths.get(name)
        if length and 0.0 < length < math.inf:
            yield name, length, limits


def _comparison(name: str, length: float, mesh: ObjectMesh) -> str:
    """A length beside the size of an object."""
    own = f" {mesh.unit}" if mesh.unit else ""
    text = describe_length(length) if isinstance(length, Metres) else f"{length:.4g}{own}"
    ratio, source = length / mesh.size, mesh.report.source
    return f"{name} is {text}, {_times(ratio)} the size of {source}, {mesh.size:.4g}{own}"


def _remedy(name: str, length: float, mesh: ObjectMesh, limits: PlausibleRange) -> str:
    """What to write instead: the length in another unit, or the unit of the mesh."""
    own, option = isinstance(length, Metres), f"--{name.replace('_', '-')}"
    of_file, guess = mesh.file_unit, guess_unit(mesh.file_size).unit
    if guess is not None and (of_file is None or unit_warning(mesh.file_size, of_file)):
        usual = limits.usual * METRES[guess] * mesh.file_size
        if own and _is_likely(length / usual):
            return f"if the mesh is in {guess}, not in {of_file}, give --unit {guess}"
        if not own and (likely := _likely_unit(length, usual)):
            return (
                f"if the mesh is in {guess} and the length in {likely}, give --unit {guess} and "
                f"{option} {length:g}{likely}"
            )
    if own:
        return "check its number and its unit, and that of the mesh (--unit)"
    if of_file is not None and (likely := _likely_unit(length, limits.usual * mesh.size)):
        return f"if it is in {likely}, give {option} {length:g}{likely}"
    return f"give it with its unit, such as {limits.example}"


def _is_likely(ratio: float) -> bool:
    return 1.0 / LIKELY <= ratio <= LIKELY


def _likely_unit(number: float, usual: float) -> Unit | None:
    """The unit in which a number is nearest to the usual length [m]; None: none is near."""
    ratios = {unit: number * metres / usual for unit, metres in METRES.items()}
    nearest = min(ratios, key=lambda unit: abs(math.log(ratios[unit])))
    return nearest if _is_likely(ratios[nearest]) else None


def _times(ratio: float) -> str:
    if ratio >= 100.0:
        return f"{ratio:,.0f} times"
    return f"{ratio:.3g} times" if ratio > 1.0 else f"1/{1.0 / ratio:,.0f} of"
