"""Grippers of two fingers that move along one axis."""

from collections.abc import Mapping
from dataclasses import MISSING, asdict, dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from grasp3d.arrays import ArrayLike, Bools, Floats
from grasp3d.errors import SettingError
from grasp3d.hand.jaws import Jaws
from grasp3d.hand.robot_files import check_keys, read_json
from grasp3d.system.context import unreported
from grasp3d.system.names import unknown

if TYPE_CHECKING:
    from grasp3d.hand.closing import ClosedJaws
    from grasp3d.hand.reach import Reach
    from grasp3d.hand.table import Table
    from grasp3d.hand.triangles import Triangles
    from grasp3d.mesh import ObjectMesh

FORMAT, VERSION = "grasp3d gripper", 1
"""Values of the keys `format` and `version` of a file."""

KEYS = ("format", "version", "unit")
"""Keys of files besides the fields of a gripper; they are optional."""

ROUNDING = 1e-9
"""Fraction of the stroke by which a limit may be exceeded through rounding."""

LEAST_TOUCH = 0.05
"""Fraction of a pad's area with which each jaw touches in a pose that fits."""

THIN = 1e-3
"""Thickness of fingers so thin that bad poses do not hide a wrong frame [m]."""


@dataclass(frozen=True, kw_only=True)
class ParallelGripper(Jaws):
    """A gripper of two fingers that move along one axis; lengths in metres.

    Its frame has the origin at the tool centre point (TCP), midway between the centres of the pads,
    or of round tips; z is the approach direction, from the palm toward the object; x is the closing
    axis, from finger 1 to finger 2; y = z x x. Each finger is a box of thickness x width x length
    along x, y and z; the palm is a box behind the fingers.

    Flat pads are on the inner faces of the fingers, at their ends. Round tips are balls at the ends
    of the fingers, which reach up to the centres of the balls.

    Attributes:
        name: Name in tables and files.
        min_opening: Smallest distance between the contacts [m].
        max_opening: Largest distance between the contacts, the stroke [m].
        finger_thickness: Size of a finger along x [m].
        finger_width: Size of a finger along y [m].
        finger_length: From the palm to the end of a finger [m].
        pad_width: Size of a flat pad along y [m], at most that of the finger.
        pad_height: Size of a flat pad along z [m], at most the length of the finger.
        tip_radius: Radius of round tips [m]; 0: flat pads.
        inner_faces: Faces of the inner side of finger 1, which touch the object when the jaws
            close. Each is flat, convex, and given by its corners (x, y, z) in the gripper's frame
            [m], in the pad's plane x = 0 or behind it (x < 0). Finger 2 mirrors them. Empty: the
            flat pad alone.
        tip_thickness: Size of a finger along x at its pad [m]; None: that of the whole finger.
        palm_thickness: Size of the palm along x [m], at least the stroke.
        palm_width: Size of the palm along y [m].
        palm_length: Size of the palm along z [m].
        compliance: Depth to which the object presses into pads or tips [m].
        clearance: Distance between each finger and the object before the fingers close [m].
        max_force: Greatest force of each finger [N]; None: not stated.
        sensor_resolution: Resolution alpha of the fingertips [rad]; None: not stated.
        base_to_tcp: From the origin of the hand's own frame to the TCP, along z [m].
        base_axes: The closing and the approach axis as axes of the hand's own frame, that
            of its robot description, such as ("-y", "z").
        joint_names: Names of the finger joints in simulators.
        joint_scale: Change of each joint per metre of opening.
        joint_closed: Value of each joint at an opening of 0.
        source: Where the lengths come from.

    Example:
        >>> from grasp3d.hand.parallel_gripper import ParallelGripper
        >>> gripper = ParallelGripper(
        ...     name="mine", max_opening=0.08, finger_thickness=0.01, finger_width=0.02,
        ...     finger_length=0.045, pad_width=0.02, pad_height=0.02,
        ...     palm_thickness=0.1, palm_width=0.06, palm_length=0.05,
        ... )
        >>> gripper.limits
        (0.0, 0.076)
        >>> ParallelGripper.preset("franka").max_force
        70.0
    """

    fingers = (2,)
    """Contact counts of the grasps for which it has poses."""

    @classmethod
    def preset(cls, name: str) -> "ParallelGripper":
        """A gripper that is known by name; see `PRESETS`.

        Args:
            name: franka (or panda), robotiq_2f85, robotiq_2f140, wsg50 or tactile.

        Raises:
            SettingError: No preset has that name.

        Example:
            >>> from grasp3d.hand.parallel_gripper import ParallelGripper
            >>> ParallelGripper.preset("robotiq_2f85").max_opening
            0.085
            >>> ParallelGripper.preset("nope")
            Traceback (most recent call last):
                ...
            grasp3d.errors.SettingError: no gripper is called 'nope'; known: franka (panda), ...
        """
        if (key := ALIASES.get(name, name)) in PRESETS:
            return PRESETS[key]
        raise SettingError(unknown("gripper", name, [*PRESETS, *ALIASES], preset_names()))

    def shape(self, opening: float, posture: ArrayLike = ()) -> "Triangles":
        """Palm, fingers and tips in its own frame [m]; see `jaw_triangles`."""
        from grasp3d.hand.triangles import jaw_triangles

        del posture
        return jaw_triangles(self, opening)

    def reach(self, mesh: "ObjectMesh", points: Any, normals: Any, **options: Any) -> "Reach":
        """Find the grasps that it reaches; see `Hand.reach` and `reach_grasps`."""
        from grasp3d.hand.reach import reach_grasps

        return reach_grasps(mesh, points, normals, self, **options)

    def close(self, mesh: "ObjectMesh", poses: Any, **options: Any) -> "ClosedJaws":
        """Close its jaws and find what they touch; see `Hand.close` and `close_jaws`."""
        from grasp3d.hand.closing import close_jaws

        return close_jaws(mesh, poses, self, **options)

    def blocked(
        self,
        mesh: "ObjectMesh",
        poses: Floats,
        closed: "ClosedJaws",
        *,
        held: Bools,
        table: "Table | None" = None,
    ) -> Bools:
        """Whether it collides on its way to poses at which its jaws close, shape (k,).

        If the jaws do not close symmetrically about the TCP, the hand or the object gives way until
        they do. See `Hand.blocked`.
        """
        from grasp3d.hand.reach import collides

        opening = np.where(held, np.maximum(closed.opening, 0.0), self.limits[1])
        centred, offset = poses.copy(), np.where(held, closed.offset, 0.0)
        centred[:, :3, 3] += offset[:, None] * poses[:, :3, 0]
        return collides(mesh, centred, opening, self, table=table)

    fitting = (
        "jaws that are thin close on the object where it is, each with a twentieth of its pad,"
    )
    """What holds at poses that fit, for a sentence; see `Hand.fitting`."""

    def fits(
        self, mesh: "ObjectMesh", poses: Any, posture: Any, *, table: "Table | None" = None
    ) -> Bools:
        """Whether it reaches poses wide open and then closes on the object, shape (k,).

        Each jaw must touch with a twentieth of its pad. Thin fingers are tried as well, so that bad
        poses do not hide a wrong frame. See `Hand.fits`.
        """
        del posture
        thin, fits = self, np.zeros(len(poses), dtype=np.bool_)
        if not self.round_tips:
            thin = replace(
                self, finger_thickness=THIN, finger_width=self.pad_width, tip_thickness=None,
                inner_faces=(),
            )  # fmt: skip
        for one in dict.fromkeys((self, thin)):
            rows = np.flatnonzero(~fits)
            with unreported():
                closed = one.close(mesh, poses[rows])
            held = np.zeros(len(rows), dtype=np.bool_)
            free = ~one.blocked(mesh, poses[rows], closed, held=held, table=table)
            touched = closed.area.min(axis=1) >= LEAST_TOUCH * self.touch_area
            fits[rows] = closed.closed & free & touched
        return fits

    def opens_to(self, closed: "ClosedJaws") -> Bools:
        """Whether it can open to each opening, with clearance on both sides, shape (k,)."""
        least, most = self.limits
        slack = ROUNDING * most
        # The object yields to the pads, which end up nearer to each other than at the first touch.
        soft = 2.0 * self.compliance
        return np.asarray(
            (closed.opening >= least - slack) & (closed.opening - soft <= most + slack)
        )

    def description(self) -> dict[str, Any]:
        """All fields, with the format and unit of its files."""
        return {"format": FORMAT, "version": VERSION, "unit": "m", **asdict(self)}


def gripper_of(content: Mapping[str, Any]) -> ParallelGripper:
    """Make a gripper from the content of a JSON file in the format of grippers.

    Raises:
        SettingError: It is not the description of a gripper.
    """
    known = {field.name: field for field in fields(ParallelGripper)}
    check_keys(content, known, version=VERSION, unit="m")
    needed = [name for name, field in known.items() if field.default is MISSING]
    if missing := [name for name in needed if name not in content]:
        raise SettingError(f"{', '.join(missing)} missing; every gripper needs it")
    return ParallelGripper(**{name: content[name] for name in known if name in content})


FOLDER = Path(__file__).with_name("presets")
"""Folder of the presets' JSON files."""

PRESETS: dict[str, ParallelGripper] = {
    name: gripper_of(read_json(FOLDER / f"{name}.json"))
    for name in ("franka", "robotiq_2f85", "robotiq_2f140", "wsg50", "tactile")
}
"""The grippers by name.

Strokes and forces are those stated by the manufacturers; the other lengths are measured on the
geometry of published robot descriptions. Fingers and palm are boxes around that geometry, except
where the notes say otherwise. The JSON file of each gripper has notes on its sources.
"""

ALIASES = {"panda": "franka"}
"""Other names of presets."""


def preset_names() -> list[str]:
    """Names of the presets, with their aliases in brackets."""
    others = {name: [alias for alias, of in ALIASES.items() if of == name] for name in PRESETS}
    return [f"{name} ({', '.join(more)})" if more else name for name, more in others.items()]
