"""The protocol `Hand`, which grippers and hands with joints implement."""

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

from grasp3d.settings import GraspModel

if TYPE_CHECKING:
    from grasp3d.arrays import ArrayLike, Bools
    from grasp3d.hand.closing import ClosedJaws
    from grasp3d.hand.reach import Reach
    from grasp3d.hand.table import Table
    from grasp3d.hand.triangles import Triangles
    from grasp3d.mesh import ObjectMesh


@runtime_checkable
class Hand(Protocol):
    """Anything that can hold an object; no other module depends on how many joints it has.

    All lengths are in metres, including those of meshes, poses and results. In its frame z is the
    approach direction, from the palm toward the object, unless an attribute `approach` states
    another. Its state is an opening and a posture: the values of its further joints, if any.
    """

    @property
    def name(self) -> str:
        """Name in tables and files."""

    @property
    def fingers(self) -> tuple[int, ...]:
        """Contact counts of the grasps for which it has poses; the last applies when it closes."""

    @property
    def limits(self) -> tuple[float, float]:
        """Smallest and largest opening that a grasp may have [m]."""

    @property
    def max_opening(self) -> float:
        """Largest opening of the hand, without clearance [m]."""

    @property
    def finger_length(self) -> float:
        """Distance from the palm to the end of a finger [m]."""

    @property
    def size(self) -> float:
        """Approximate size of the whole hand [m]."""

    @property
    def max_force(self) -> float | None:
        """Greatest force of each finger [N]; None: not stated."""

    @property
    def sensor_resolution(self) -> float | None:
        """Sensor resolution alpha of the fingertips [rad]; None: not stated."""

    @property
    def touch_area(self) -> float:
        """Largest contact area of a fingertip [m^2]."""

    def torsion_radius(self, friction: float) -> float:
        """Torsion radius of a fingertip that touches with its whole area [m]."""

    def check_fingers(self, count: int) -> None:
        """Raise SettingError if the hand cannot make grasps of `count` fingers."""

    def distances(self) -> tuple[float, float]:
        """Smallest and largest distance between two contacts that the hand can reach [m]."""

    def shape(self, opening: float, posture: "ArrayLike" = ()) -> "Triangles":
        """Its solid parts in its own frame at an opening [m] and a posture."""

    # With `*_` and `**options`, each hand can name the options that it takes.
    def reach(
        self, mesh: "ObjectMesh", points: Any, normals: Any, *_: Any, **options: Any
    ) -> "Reach":
        """Find the grasps that the hand reaches, and the pose and opening of each.

        Args:
            mesh: The object; its unit must be known.
            points: Contacts, in the mesh's frame, shape (b, n, 3).
            normals: Inward unit normals there, shape (b, n, 3).
            options: `grip`: +1 external grasps, -1 internal ones, one number or shape (b,);
                `table`: what the object stands on, or None; `approach`: an `Approach`, or None.
        """

    def close(self, mesh: "ObjectMesh", poses: Any, *_: Any, **options: Any) -> "ClosedJaws":
        """Close the fingers at poses, from wide open, and find what they touch.

        Args:
            mesh: The object; its unit must be known.
            poses: From the hand's frame to the mesh's, shape (k, 4, 4).
            options: `object_motion`: free, the object gives way, or fixed, it does not move;
                `friction`: Coulomb coefficient between the fingers and a free object; `give_way`:
                how far the object or the fingers may give way where fingers start inside it [m],
                see `ClosedJaws.shift`.
        """

    def blocked(
        self, mesh: "ObjectMesh", poses: Any, closed: "ClosedJaws", *_: Any, **options: Any
    ) -> "Bools":
        """Whether the hand collides on its way to poses, shape (k,).

        Args:
            mesh: The object.
            poses: As in `close`.
            closed: What `close` returned for them.
            options: `held`: whether it is tested at the opening at which it holds the object, or
                else wide open, shape (k,); `table`: what the object stands on, or None.
        """

    @property
    def fitting(self) -> str:
        """What holds at poses that fit, for a sentence: 'jaws ... close on the object,'."""

    def fits(
        self, mesh: "ObjectMesh", poses: Any, posture: Any, *, table: "Table | None" = None
    ) -> "Bools":
        """Whether it can close on the object at poses, shape (k,); a test for wrong frames.

        Args:
            mesh: The object; its unit must be known.
            poses: From the hand's frame to the mesh's [m], shape (k, 4, 4).
            posture: Values of its joints there, shape (k, p).
            table: The table that it must not touch; None: no table.
        """

    def opens_to(self, closed: "ClosedJaws") -> "Bools":
        """Whether the openings of closed grasps are within the limits, shape (k,)."""

    def description(self) -> Mapping[str, Any]:
        """Its description for JSON files, with a "format" that identifies it."""


def touching(hand: Hand, model: GraspModel) -> GraspModel:
    """The model with the hand's sensor resolution, if the hand states one.

    Args:
        hand: The hand.
        model: Friction and sensor resolution.
    """
    alpha = hand.sensor_resolution
    return model if alpha is None else replace(model, sensor_resolution=alpha)
