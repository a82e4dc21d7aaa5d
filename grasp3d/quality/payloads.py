"""Payload: the largest mass that a given force can hold."""

import math

import numpy as np

from grasp3d.arrays import ArrayLike, Floats, locked
from grasp3d.contact.contacts import Contacts
from grasp3d.errors import SettingError
from grasp3d.quality.force_problem import ForceBound
from grasp3d.quality.force_ranges import force_range
from grasp3d.quality.tasks import Task

HALVINGS = 24
"""Halvings of the interval of masses, for tasks with wrenches that do not grow with the mass."""

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

    def largest(masses: Floats | float) -> Floats:
        return force_range(
            contacts, task, tilt, bound=bound, masses=masses, rtol=rtol, threads=threads
        ).largest

    if all(term.mass is not None for term in task.terms()):
        return locked(force / largest(1.0))[()]
    low, high = np.zeros(contacts.batch), np.ones(contacts.batch)
    while (growing := (largest(high) <= force) & (high < LARGEST_MASS)).any():
        high = np.where(growing, 2.0 * high, high)
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        enough = largest(middle) <= force
        low, high = np.where(enough, middle, low), np.where(enough, high, middle)
    return locked(low)[()]
