"""Classification of grasps as S, M or U, exactly or by enumeration of extreme normals."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from grasp3d.arrays import ArrayLike, Floats, shaped
from grasp3d.contact.contacts import Contacts, per_contact
from grasp3d.errors import SettingError
from grasp3d.quality.epsilon_options import EpsilonOptions
from grasp3d.settings import MIN_EXTREMES, Method, check_choice, whole_number
from grasp3d.stability.exact import StabilityProblem, decide
from grasp3d.stability.label import Label
from grasp3d.stability.normal_sets import face_normals
from grasp3d.stability.stability import Stability


def classify(
    contacts: Contacts,
    sensor_resolution: ArrayLike,
    *,
    method: Method = "exact",
    friction_interval: tuple[ArrayLike, ArrayLike] | None = None,
    normal_error: ArrayLike = 0.0,
    location_error: ArrayLike = 0.0,
    creases: Mapping[int, ArrayLike] | None = None,
    extreme_normals: int = 8,
    rings: int | None = None,
    options: EpsilonOptions | None = None,
) -> Stability:
    """Classify grasps as surely stable (S), ambiguous (M) or surely unstable (U).

    The method 'exact' considers every normal within the resolution: a grasp is S if it is
    force-closed with cones of half-angle beta - alpha/2, and U if it is not with cones of
    beta + alpha/2. For two fingers this is a closed form, for more two closure tests. From
    beta + alpha/2 = 90 degrees on, grasps of three fingers and more are never U: such cones are not
    convex, and nothing is proved. Where tilts exceed friction at some of three contacts or more,
    and no contact is on a crease, the grasp is S if the other contacts alone are force-closed;
    seven contacts and more also if their critical friction angle is below the smallest
    beta - alpha/2. Where friction or resolution differ among the contacts this is safe, not exact.

    Two contacts with patches are held along the best line between the patches (see
    `critical_friction_angle`): exact where friction and resolution of both are the same, else safe;
    never U from beta + alpha/2 = 90 degrees on.

    The method 'extremes' is that of Wan & Howe 2018, Sec. III: all combinations of the perceived
    and of extreme normals, `extreme_normals` on a rim alpha/2 away. It is sampled. An M may be
    labelled S or U, if the decisive tilt is not among the samples; with polygonal cones, which lie
    inside the circular ones, also an S as M or U, and an M as U.

    Args:
        contacts: The contacts, with their perceived normals.
        sensor_resolution: Resolution alpha [rad], from 0 to below pi: one value, or shape
            (..., n).
        method: 'exact' or 'extremes'.
        friction_interval: Smallest and largest friction coefficient, where friction is uncertain:
            each above 0, one number or of shape (..., n), with the contacts' friction between them;
            None: the contacts' friction alone. S is decided by the smallest, U by the largest.
        normal_error: Largest angle between true and perceived normals beyond alpha/2 [rad], from 0
            to below pi / 2, as joint encoders cause it: one value, or shape (..., n).
        location_error: Largest distance between true and perceived contacts, in the unit of the
            points, at least 0: one value, or shape (..., n). Normals do not change with the
            location. Method exact only. Two contacts: exact, U safe on creases; more: safe, every S
            and U is correct, and grasps with a contact on a crease are M.
        creases: For contacts on creases and corners, by number: inward normals of the faces that
            meet there, shape (k, 3) or (..., k, 3). The contact may have any normal between them,
            tilted by up to alpha/2. They affect labels, and with method extremes epsilon. Method
            exact: exact for two fingers; for more the sets are sampled in steps of 5 degrees,
            safely: every S and U is correct.
        extreme_normals: Method extremes: number of normals on a rim, at least 3.
        rings: Method extremes: number of rims, at even steps up to alpha/2; None: one, and more
            where alpha > 4 beta, so that they are at most 2 beta apart.
        options: Cones, actuation, torque scale, accuracy and threads of epsilon; edges apply to
            labels of method extremes too, while exact labels always come from circular cones.
            None: the defaults.

    Raises:
        SettingError: A setting outside its range, friction 0, or too many combinations; patches of
            three contacts and more, with method extremes, on creases, or at uncertain locations.
        ContactError: Creases that do not match the contacts.

    Example:
        Three grasps of two fingers, felt with a resolution of 20 degrees:

        >>> import math
        >>> import grasp3d
        >>> points = [[[-1, 0, 0], [1, y, 0]] for y in (0.0, 0.6, 1.5)]
        >>> contacts = grasp3d.Contacts(points, [[[1, 0, 0], [-1, 0, 0]]] * 3, friction=0.5)
        >>> found = grasp3d.classify(contacts, math.radians(20.0))
        >>> [grasp3d.Label(code).name for code in found.label]
        ['S', 'M', 'U']
    """
    check_choice("method", method, Method)
    if rings is not None:
        whole_number("rings", rings, 1)
    whole_number("extreme normals", extreme_normals, MIN_EXTREMES)
    tilt = _resolutions(contacts, sensor_resolution) / 2.0
    tilt = tilt + _errors("normal error", normal_error, contacts, math.pi / 2.0)
    location = _errors("location error", location_error, contacts, math.inf)
    if method == "extremes" and location.any():
        raise SettingError("method extremes tests normals only; a location_error needs exact")
    if contacts.patch is not None:
        _check_patches(contacts, method, creases=bool(creases), located=bool(location.any()))
    low, high = _friction_range(contacts, friction_interval)
    flat = contacts.reshape((-1,))
    problem = StabilityProblem(
        contacts=flat,
        tilt=tilt.reshape(-1, contacts.count),
        low=flat if low is contacts else low.reshape((-1,)),
        high=flat if high is contacts else high.reshape((-1,)),
        creases=face_normals(creases or {}, contacts),
        extreme_normals=extreme_normals,
        rings=rings,
        options=options or EpsilonOptions(),
        location=location.reshape(-1, contacts.count),
    )
    stable, unstable, hulls = decide(problem, method)
    label = np.full(len(stable), Label.M, dtype=np.uint8)
    label[unstable] = Label.U
    label[stable] = Label.S
    return Stability(
        label=shaped(label, contacts.batch),
        method=method,
        hulls=shaped(hulls, contacts.batch),
        batch=contacts.batch,
        _problem=problem,
    )


def _check_patches(contacts: Contacts, method: Method, *, creases: bool, located: bool) -> None:
    """Refuse what is not known of contacts with patches."""
    reasons = {
        f"{contacts.count} contacts": contacts.count > 2,
        "method extremes": method == "extremes",
        "creases": creases,
        "a location_error": located,
    }
    for what, given in reasons.items():
        if given:
            raise SettingError(
                "labels of contacts with patches are those of two fingers by method exact, without "
                f"creases and location_error; got {what}: give contacts.without_patches()"
            )


def _resolutions(contacts: Contacts, sensor_resolution: ArrayLike) -> Floats:
    """Check resolutions and broadcast them to the contacts, shape (..., n)."""
    alpha = per_contact("sensor resolution", sensor_resolution, contacts)
    if not ((alpha >= 0.0) & (alpha < math.pi)).all():
        raise SettingError(
            "sensor resolution must be at least 0 and below pi radians; "
            f"got {sensor_resolution!r} (radians)"
        )
    return alpha


def _errors(name: str, values: ArrayLike, contacts: Contacts, limit: float) -> Floats:
    """Check errors and broadcast them to the contacts, shape (..., n)."""
    errors = per_contact(name, values, contacts)
    if not ((errors >= 0.0) & (errors < limit)).all():
        below = "" if math.isinf(limit) else f" and below {limit:.4g} (radians)"
        raise SettingError(f"{name} must be at least 0{below}; got {values!r}")
    return errors


def _friction_range(
    contacts: Contacts, interval: tuple[ArrayLike, ArrayLike] | None
) -> tuple[Contacts, Contacts]:
    """The contacts with their smallest and with their largest friction."""
    if not (contacts.friction > 0.0).all():
        raise SettingError(f"friction must be above 0; got {contacts.friction.min():g}")
    if interval is None:
        return contacts, contacts
    if not (isinstance(interval, Sequence) and len(interval) == 2):
        raise SettingError(f"friction_interval must be (smallest, largest); got {interval!r}")
    low, high = (
        per_contact(f"{end} friction", value, contacts)
        for end, value in zip(("smallest", "largest"), interval, strict=True)
    )
    if not ((low > 0.0) & (low <= contacts.friction) & (contacts.friction <= high)).all():
        raise SettingError(
            "friction_interval must be (smallest, largest), above 0, with the contacts' friction "
            "between them"
        )
    return contacts.with_friction(low), contacts.with_friction(high)
