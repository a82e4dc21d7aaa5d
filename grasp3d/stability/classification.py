"""S, M or U of given grasps: exactly, or by the paper's enumeration of extreme normals."""

import math
from collections.abc import Mapping, Sequence
from typing import get_args

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Floats, shaped
from grasp3d.contact.contacts import Contacts, per_contact
from grasp3d.errors import SettingError
from grasp3d.quality.ferrari_canny import epsilon
from grasp3d.settings import MIN_EXTREMES, Actuation, Method, whole
from grasp3d.stability.exact import Question, settle
from grasp3d.stability.label import Label
from grasp3d.stability.normal_sets import face_normals
from grasp3d.stability.stability import Stability

NO_GRASPS = Contacts(np.zeros((0, 1, 3)), np.zeros((0, 1, 3)))


def classify(
    contacts: Contacts,
    sensor_resolution: npt.ArrayLike,
    *,
    method: Method = "exact",
    friction_interval: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
    creases: Mapping[int, npt.ArrayLike] | None = None,
    extreme_normals: int = 8,
    rings: int | None = None,
    edges: int | None = None,
    actuation: Actuation = "total",
    torque_scale: float = 1.0,
    rtol: float = 1e-3,
    threads: int | None = 1,
) -> Stability:
    """Tell whether grasps are surely stable, surely unstable, or the sensor cannot tell.

    The method 'exact' answers for every normal within the resolution: a grasp is S where cones of
    half-angle beta - alpha/2 close, and U where those of beta + alpha/2 do not. For two fingers
    this is a closed form, for more a closure test each. From beta + alpha/2 = 90 degrees on three
    fingers and more are never called U: such cones are not convex, and nothing is proved.
    Three fingers and more whose tilts exceed friction are S where, without creases, those that know
    better close without them; seven and more also where their critical friction angle is below the
    smallest beta - alpha/2. Where friction or resolution differ among them this is safe, not exact.

    The method 'extremes' is that of Wan & Howe 2018, Sec. III: all combinations of the perceived
    and of extreme normals, `extreme_normals` on a rim alpha/2 away. It is sampled. It can take an M
    for an S or a U, because the tilt that tells was not tried; with polygonal cones, which lie
    inside the circular ones, also an S for M or U, and an M for U.

    Args:
        contacts: The contacts, with their perceived normals.
        sensor_resolution: Resolution alpha [rad], from 0 to below pi: one, or shape (..., n).
        method: 'exact' or 'extremes'.
        friction_interval: Smallest and largest friction coefficient, above 0, each one number or of
            shape (..., n), where friction is known only so far, about that of the contacts; None:
            that alone. An S is one for the smallest, a U for the largest.
        creases: Contacts on creases and corners, by number: inward normals of the faces that meet
            there, shape (k, 3) or (..., k, 3). The contact may have any normal between them, tilted
            by up to alpha/2. They count in labels, and in epsilon of the method extremes. Method
            exact: exact for two fingers; for more the sets are sampled in steps of 5 degrees,
            safely: what is called S or U is.
        extreme_normals: Method extremes: normals on a rim, at least 3.
        rings: Method extremes: rims at even steps up to alpha/2; None: one, and more where
            alpha > 4 beta, at most 2 beta apart.
        edges: Edges of polygonal friction cones, of epsilon and of the method extremes; None:
            circular ones. Exact labels come from circular ones.
        actuation: As in `quality.epsilon`.
        torque_scale: As in `quality.epsilon` [mesh unit].
        rtol: As in `quality.epsilon`.
        threads: Threads for a batch; None: one per processor.

    Raises:
        SettingError: A setting outside its range, friction 0, or too many combinations.
        ContactError: Creases that do not fit the contacts.
    """
    if method not in get_args(Method):
        known = ", ".join(get_args(Method))
        raise SettingError(f"no method is called {method!r}; known: {known}")
    if rings is not None:
        whole("rings", rings, 1)
    whole("extreme normals", extreme_normals, MIN_EXTREMES)
    tilt = _resolutions(contacts, sensor_resolution) / 2.0
    low, high = _friction_range(contacts, friction_interval)
    flat = contacts.reshape((-1,))
    question = Question(
        contacts=flat,
        tilt=tilt.reshape(-1, contacts.count),
        low=flat if low is contacts else low.reshape((-1,)),
        high=flat if high is contacts else high.reshape((-1,)),
        creases=face_normals(creases or {}, contacts),
        edges=edges,
        actuation=actuation,
        around=extreme_normals,
        rings=rings,
        torque_scale=torque_scale,
        rtol=rtol,
        threads=threads,
    )
    epsilon(NO_GRASPS, **question.measures)  # refuses settings that are needed only later
    stable, unstable, hulls = settle(question, method)
    label = np.full(len(stable), Label.M, dtype=np.uint8)
    label[unstable] = Label.U
    label[stable] = Label.S
    return Stability(
        label=shaped(label, contacts.batch),
        method=method,
        hulls=shaped(hulls, contacts.batch),
        batch=contacts.batch,
        _question=question,
    )


def _resolutions(contacts: Contacts, sensor_resolution: npt.ArrayLike) -> Floats:
    """Check resolutions and spread them over the contacts, shape (..., n)."""
    alpha = per_contact("sensor resolution", sensor_resolution, contacts)
    if not ((alpha >= 0.0) & (alpha < math.pi)).all():
        raise SettingError(
            "sensor resolution must be at least 0 and below pi radians; "
            f"got {sensor_resolution!r} (radians)"
        )
    return alpha


def _friction_range(
    contacts: Contacts, interval: tuple[npt.ArrayLike, npt.ArrayLike] | None
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
            "friction_interval must be (smallest, largest), above 0, about the contacts' friction"
        )
    return contacts.with_friction(low), contacts.with_friction(high)
