"""Bounds of epsilon where friction, contact locations and the centre of mass are uncertain too."""

import math
from dataclasses import dataclass

import numpy as np

from grasp3d.arrays import Bools, Floats, locked
from grasp3d.contact.contacts import Contacts
from grasp3d.errors import SettingError
from grasp3d.quality.epsilon_options import EpsilonOptions
from grasp3d.quality.over_friction import FrictionCases, over_friction
from grasp3d.quality.tilting import EpsilonRange, epsilon_range
from grasp3d.settings import GraspModel
from grasp3d.system.progress import Progress, ignore

COLLINEAR = 1e-9
"""Width of contacts on a line, relative to its length."""


@dataclass(frozen=True)
class WrenchErrors:
    """What is not known about contacts beside their normals."""

    friction: tuple[float | tuple[float, ...], float | tuple[float, ...]]
    """Smallest and largest coefficient of friction, for all contacts or for each."""
    location: tuple[float, ...]
    """Location error of each contact, in the unit of the points."""
    center_radius: float = 0.0
    """Radius of the ball in which the centre of mass lies, in the same unit."""

    @classmethod
    def of_model(cls, model: GraspModel, center_radius: float = 0.0) -> "WrenchErrors":
        """The errors of a model, with lengths in the mesh's unit."""
        errors = tuple(tip.location_error for tip in model.fingertips)
        return cls(model.friction_bounds, errors, center_radius)

    @property
    def friction_known(self) -> bool:
        """Whether friction is known exactly."""
        return self.friction[0] == self.friction[1]


def uncertain_epsilon_range(
    contacts: Contacts,
    tilt: float | tuple[float, ...],
    errors: WrenchErrors,
    options: EpsilonOptions,
    *,
    bound_rtol: float | None = None,
    progress: Progress | None = None,
) -> EpsilonRange:
    """As `epsilon_range`, over friction, contact locations and centre of mass as well.

    The minimum is at the smallest friction, the bound on the maximum at the largest. Contacts that
    are d away from their perceived positions change the support function by at most d / rho, for
    actuation 'total' the largest d, for 'per_finger' their sum, and the span of two hard fingers
    turns with the line between them; of three and more on one line the minimum is 0. A centre of
    mass c away from the nominal one changes epsilon by at most the factor
    s = (k + sqrt(k^2 + 4)) / 2, k = c / rho: the largest singular value of the change of reference
    point.

    Args:
        contacts: The contacts (b, n) at their nominal friction.
        tilt: As in `epsilon_range`, for all contacts or for each.
        errors: What is not known.
        options: Cones, actuation, torque scale, accuracy and threads.
        bound_rtol: As in `epsilon_range`.
        progress: Called with the fraction of the work done, from 0 to 1.
    """
    report = progress or ignore
    if errors.friction_known:
        found = epsilon_range(contacts, tilt, options, bound_rtol=bound_rtol, progress=report)
    else:
        found = _over_friction(contacts, tilt, errors, options, bound_rtol, report)
    minimum, maximum = found.minimum, found.maximum
    if any(errors.location):
        change, turned = _of_locations(contacts, errors.location, options)
        minimum = np.maximum(minimum * turned - change, 0.0)
        minimum = np.where(_on_a_line(contacts), 0.0, minimum)
        with np.errstate(divide="ignore"):
            maximum = (maximum + change) / turned
        largest = 1.0 if options.actuation == "total" else float(contacts.count)
        maximum = np.minimum(maximum, largest * _largest_wrench(contacts, errors, options))
    if errors.center_radius > 0.0:
        k = errors.center_radius / np.asarray(options.torque_scale)
        factor = 0.5 * (k + np.sqrt(k * k + 4.0))
        minimum, maximum = minimum / factor, maximum * factor
    return EpsilonRange(found.nominal, locked(minimum), locked(maximum))


def _over_friction(
    contacts: Contacts,
    tilt: float | tuple[float, ...],
    errors: WrenchErrors,
    options: EpsilonOptions,
    bound_rtol: float | None,
    progress: Progress,
) -> EpsilonRange:
    def epsilons(
        contacts: Contacts, tilt: float | tuple[float, ...], progress: Progress
    ) -> EpsilonRange:
        return epsilon_range(contacts, tilt, options, bound_rtol=bound_rtol, progress=progress)

    cases = FrictionCases(contacts, *map(contacts.with_friction, errors.friction))
    nominal, low, high = over_friction(epsilons, cases, tilt, progress)
    return EpsilonRange(nominal.nominal, low.minimum, high.maximum)


def _of_locations(
    contacts: Contacts, location: tuple[float, ...], options: EpsilonOptions
) -> tuple[Floats, Floats]:
    """(change of epsilon, cosine of the turn of the span), shape (b,) each."""
    if contacts.patch is not None:
        raise SettingError(
            "contacts with patches have no bounds for uncertain locations: give a location_error "
            "of 0, or point contacts"
        )
    scale = np.broadcast_to(np.asarray(options.torque_scale), contacts.batch)
    total = max(location) if options.actuation == "total" else sum(location)
    change = total / scale
    if contacts.count > 2 or (contacts.torsion_radius > 0.0).any():
        return change, np.ones(contacts.batch)
    # What two hard fingers cannot resist is the torque about their line d: the wrench (p x d, d)
    # spans the orthogonal complement, p a point of the line. It turns with d and moves with p.
    line = contacts.points[..., 1, :] - contacts.points[..., 0, :]
    opening = np.linalg.norm(line, axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(opening > 0.0, sum(location) / opening, math.inf)
        direction = np.nan_to_num(line / opening[..., None])
    turn = 2.0 * np.sin(0.5 * np.where(ratio > 1.0, math.pi, np.arcsin(np.minimum(ratio, 1.0))))
    middle = contacts.points.mean(axis=-2) / scale[..., None]
    size = np.sqrt(1.0 + (np.cross(middle, direction) ** 2).sum(axis=-1))
    moved = 0.5 * sum(location) / scale + np.linalg.norm(middle, axis=-1) * turn
    sine = np.minimum(np.hypot(moved, turn) / size, 1.0)
    return change, np.sqrt((1.0 - sine) * (1.0 + sine))


def _on_a_line(contacts: Contacts) -> Bools:
    """Whether three hard contacts or more are on one line, up to rounding, shape (b,).

    Epsilon is that within the wrenches that they span, without the torque about the line. Contacts
    beside the line resist that torque too, however little.
    """
    if contacts.count < 3:
        return np.zeros(contacts.batch, dtype=np.bool_)
    centred = contacts.points - contacts.points.mean(axis=-2, keepdims=True)
    lengths = np.linalg.svd(centred, compute_uv=False)
    straight = lengths[..., 1] <= COLLINEAR * np.maximum(lengths[..., 0], 1e-300)
    return np.asarray(straight & (contacts.torsion_radius == 0.0).all(axis=-1))


def _largest_wrench(contacts: Contacts, errors: WrenchErrors, options: EpsilonOptions) -> Floats:
    """Length of the longest wrench of a unit force at any position of a contact, shape (b,)."""
    arms = np.linalg.norm(contacts.points, axis=-1) + np.array(errors.location)
    arms += contacts.torsion_radius
    scale = np.asarray(options.torque_scale)
    return np.asarray(np.sqrt(1.0 + (arms.max(axis=-1) / scale) ** 2))
