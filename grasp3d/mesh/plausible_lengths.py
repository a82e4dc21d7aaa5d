"""Warnings about lengths that are implausible for an object, and about implausible sizes."""

import math
from collections.abc import Iterator

from grasp3d.errors import SettingError
from grasp3d.mesh.object_mesh import ObjectMesh
from grasp3d.mesh.plausible_units import guess_unit, length_text, unit_warning
from grasp3d.settings.units import METRES, LengthSettings, Metres, describe_length

DENSEST = 25e3
"""Density above that of any material [kg/m^3]: osmium has 22,600."""

LIGHTEST = 1.0, 0.02
"""Density [kg/m^3] below those of foams, and mass per area [kg/m^2] below those of thin shells."""

SMALLEST, LARGEST = 0.1, 10.0
"""Plausible sizes of an object for a gripper: at least in sizes of its pads, at most in strokes."""


def object_warnings(
    mesh: ObjectMesh, mass: float | None = None, pad: float = 0.0, stroke: float = math.inf
) -> Iterator[str]:
    """Warnings of a size that is implausible for the object's mass or for the gripper.

    Args:
        mesh: The object; if its unit is unknown or implausible in itself, nothing is checked.
        mass: Its mass [kg]; None: not known.
        pad: Side of a square with the area of a gripper's pad [m]; 0: there is none.
        stroke: Stroke of the gripper [m]; inf: there is none.
    """
    if mesh.unit is None or unit_warning(mesh.file_size, mesh.file_unit):
        return
    if mass is not None:
        is_open = math.isnan(mesh.volume)  # it fills at most the ball around it
        density = mass / (math.pi / 6.0 * mesh.size**3 if is_open else mesh.volume)
        is_light = not is_open and density < LIGHTEST[0] and mass / mesh.area < LIGHTEST[1]
        if is_light or density > DENSEST:
            yield (
                f"with {mass:.4g} kg the object's density is {float(f'{density:.2g}'):,g} kg/m^3, "
                f"{'less than foam or foil' if is_light else 'more than any material'}: are its "
                "mass (--mass) and its unit (--unit) right?"
            )
    misfit = ""
    if mesh.size < SMALLEST * pad:
        misfit = f"smaller than a tenth of the gripper's pads, {length_text(pad)}"
    if mesh.size > LARGEST * stroke:
        misfit = f"larger than ten strokes of the gripper, {length_text(stroke)} each"
    if misfit:
        yield f"the object measures {length_text(mesh.size)}, {misfit}: is its unit (--unit) right?"


RANGES = {
    **dict.fromkeys(("max_edge", "min_opening"), (0.0, 1.0, 0.05)),
    **dict.fromkeys(("torsion_radius", "location_error", "max_distance"), (0.0, 1.0, 0.05)),
    "max_opening": (1.0 / 500.0, 100.0, 0.5),
}
"""Smallest and largest plausible length of each setting, and an ordinary one from which the unit is
guessed, as fractions of the object's size; other settings may have any length."""

LIKELY = 20.0
"""Largest ratio of a length to an ordinary one at which its unit is likely."""


def refuse_lengths(
    mesh: ObjectMesh, *settings: LengthSettings | None, **lengths: float | None
) -> None:
    """Refuse lengths that are implausible for an object of this size.

    Args:
        mesh: The object; lengths of its options are checked as well.
        settings: Settings with lengths.
        lengths: Further lengths, by the name of the setting.

    Raises:
        SettingError: There is such a length; the message names the likely unit. Or a length has a
            unit, but the mesh has none.
    """
    mesh.check_units(*settings, tuple(lengths.values()))
    for text in length_warnings(mesh, *settings, **lengths):
        raise SettingError(f"{text}, or accept it with --force (in Python force=True)")


def length_warnings(
    mesh: ObjectMesh, *settings: LengthSettings | None, **lengths: float | None
) -> Iterator[str]:
    """Describe each implausible length; see `refuse_lengths`."""
    for one in (mesh.options, *filter(None, settings)):
        lengths |= one.lengths()
    for name, (least, most, usual) in RANGES.items():
        length, unit = lengths.get(name), f" {mesh.unit}" if mesh.unit else ""
        if not length or not 0.0 < length < math.inf:
            continue
        ratio, remedy = length / mesh.size, _remedy(name, length, mesh, usual)
        if least <= ratio <= most or (name == "max_edge" and "--max-edge" not in remedy):
            continue  # a longest edge above the object's size divides no edge
        text = describe_length(length) if isinstance(length, Metres) else f"{length:.4g}{unit}"
        yield (
            f"{name} is {text}, {float(f'{ratio:.3g}'):,g} times the size of {mesh.report.source}, "
            f"{mesh.size:.4g}{unit}: {remedy or 'check its number and its unit'}"
        )


def _remedy(name: str, length: float, mesh: ObjectMesh, usual: float) -> str:
    """Suggest the length in another unit, or the unit of the mesh; empty: neither is likely."""
    unit, guess = mesh.file_unit, guess_unit(mesh.file_size).unit
    reasons, options = list[str](), list[str]()
    if guess is not None and (unit is None or unit_warning(mesh.file_size, unit)):
        unit, reasons, options = guess, [f"the mesh is in {guess}"], [f"--unit {guess}"]
    if unit is not None and not isinstance(length, Metres):
        ordinary = usual * METRES[unit] * mesh.file_size
        away = {one: abs(math.log(length * METRES[one] / ordinary)) for one in METRES}
        likely = min(METRES, key=lambda one: away[one])
        if away[likely] <= math.log(LIKELY):
            reasons.append(f"{'the length' if reasons else 'it'} is in {likely}")
            options.append(f"--{name.replace('_', '-')} {length:g}{likely}")
    return f"if {' and '.join(reasons)}, give {' and '.join(options)}" if reasons else ""
