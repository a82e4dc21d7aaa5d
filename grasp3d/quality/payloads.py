"""Payload: the largest mass that a given force can hold."""

import math

import numpy as np

from grasp3d.arrays import ArrayLike, Floats, locked
from grasp3d.contact.contacts import Contacts, tilts_of
from grasp3d.errors import SettingError
from grasp3d.quality.force_problem import ForceBound
from grasp3d.quality.force_ranges import WorstCase, force_range
from grasp3d.quality.grip_forces import ForceOptions
from grasp3d.quality.tasks import Task

STEPS = 60
"""Most steps of the search, for tasks with wrenches that do not grow with the mass."""

LARGEST_MASS = 1e6
"""Mass [kg] beyond which no payload is searched for."""


def payload(
    contacts: Contacts,
    task: Task,
    force: float,
    *,
    tilt: ArrayLike = 0.0,
    bound: ForceBound = "normal",
    rtol: float = 1e-3,
    threads: int | None = None,
) -> Floats:
    """Largest mass for which a force suffices, at all normals within a tilt of the given ones.

    Args:
        contacts: The contacts.
        task: What must be resisted; its own mass does not matter.
        force: Force at hand [N], bounded as `bound` says.
        tilt: As in `force_range`, whose largest force counts.
        bound: As in `grip_force`.
        rtol: As in `grip_force`.
        threads: Threads for a batch; None: one per processor.

    Returns:
        Masses [kg], shape (...); 0: the force does not even hold what does not grow with the mass,
        or no force holds the task.

    Raises:
        SettingError: A setting outside its range, or a task without weight or acceleration.

    Example:
        Two soft fingers that press with 40 N each, the part turned in any direction:

        >>> import grasp3d
        >>> from grasp3d.quality import Weight, payload
        >>> points, normals = [[-0.02, 0, 0], [0.02, 0, 0]], [[1, 0, 0], [-1, 0, 0]]
        >>> contacts = grasp3d.Contacts(points, normals, friction=0.5, torsion_radius=0.003)
        >>> print(f"{payload(contacts, Weight(), 40.0):.2f} kg")
        2.88 kg
    """
    if not 0.0 < force < math.inf:
        raise SettingError(f"the force at hand must be finite and above 0 [N]; got {force:g}")
    if task.mass is None:
        raise SettingError("a payload needs a task with a weight or an acceleration")
    task = task.scaled_to(1.0)
    options = ForceOptions(task, bound, None, rtol, threads)
    if all(term.mass is not None for term in task.terms()):
        largest = force_range(contacts, task, tilt, bound=bound, rtol=rtol, threads=threads).largest
        with np.errstate(divide="ignore"):  # no force is needed where nothing accelerates
            return locked(force / largest)[()]
    flat = contacts.reshape((-1,))
    tilts = tilts_of(tilt, contacts)
    found = _search(WorstCase.of(flat, tilts, options), force, rtol)
    return locked(found.reshape(contacts.batch))[()]


def _search(worst: WorstCase, force: float, rtol: float) -> Floats:
    """Largest masses that a force holds: the force is convex in the mass, so secants close in."""
    count = len(worst.contacts.points)
    low, high = np.zeros(count), np.full(count, math.inf)
    at_low, at_high = worst.force(np.arange(count), low) - force, np.full(count, math.inf)
    rows = np.flatnonzero(at_low <= 0.0)
    guess = np.ones(count)
    for step in range(STEPS):
        bracketed = np.isfinite(high[rows])
        near = bracketed & (high[rows] - low[rows] <= rtol * low[rows])
        rows = rows[~near & (low[rows] < LARGEST_MASS)]
        if not len(rows):
            break
        excess = worst.force(rows, guess[rows]) - force
        enough = excess <= 0.0
        low[rows[enough]], at_low[rows[enough]] = guess[rows[enough]], excess[enough]
        high[rows[~enough]], at_high[rows[~enough]] = guess[rows[~enough]], excess[~enough]
        with np.errstate(invalid="ignore"):
            secant = low + (high - low) * at_low / (at_low - at_high)
        # A secant comes from below; a point just above the lower end may end the search.
        tried = (secant, low * (1.0 + 0.9 * rtol), 0.5 * (low + high))[step % 3]
        inside = (tried > low) & (tried < high)
        with np.errstate(invalid="ignore"):
            guess = np.where(inside, tried, 0.5 * (low + high))
        guess = np.where(np.isinf(high), 2.0 * np.maximum(low, 0.5), guess)
    return low
