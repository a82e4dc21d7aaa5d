"""Frames of grippers: which axes and origin programs give a gripper's pose.

Nothing here imports NumPy until a matrix is made, so that the command line starts quickly.
"""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

from grasp3d.errors import SettingError
from grasp3d.hand.jaws import AXES, Jaws
from grasp3d.settings.checks import check_choice, parse_angle
from grasp3d.settings.lengths import Measure, parse_length

if TYPE_CHECKING:
    from grasp3d.arrays import Floats
    from grasp3d.hand.hand import Hand

Origin = Literal["tcp", "base", "ends"]
"""The tool centre point, the origin of the hand's own frame, or the ends of the fingers."""

AUTO = "auto"
"""In place of a frame, where poses are read with their object: the one that explains them."""

LARGEST = 1.0
"""Largest distance of the TCP from a frame's origin [m]."""

FORM = "approach=+z,closing=+x,tcp=0.1034"
"""A frame as text, for messages."""

_PARTS = ("approach", "closing", "side", "turn", "tcp", "link")


@dataclass(frozen=True, kw_only=True)
class GripperFrame:
    """Axes and origin of the frame in which a program states the poses of a gripper.

    The axes are right-handed, so that two of them state the third. As text a frame is the name of
    one in `FRAMES`, or parts with names: `approach` and `closing`, axes such as +z or -y, and
    `tcp`, how far the TCP is before the origin along the approach direction, in metres or with a
    unit; `base` stands for the `base_to_tcp` of the gripper, `ends` for an origin at the ends of
    its fingers. `link` names the link of a hand with joints whose frame it is, where the joints
    above it are at 0; axes and origin need not be stated then. `turn` turns the closing axis about
    the approach direction, and `side`, the third axis, is only checked. Parts after a name replace
    those of that frame.

    Example:
        >>> from grasp3d.hand.frames import GripperFrame
        >>> frame = GripperFrame.of("approach=+z,closing=+x,tcp=103.4mm")
        >>> frame.ahead, str(GripperFrame.of("graspgen"))
        (0.1034, 'graspgen')
        >>> GripperFrame.of("panda_hand,tcp=0.105").closing
        '-y'
    """

    approach: str = "z"
    """Axis of the frame that is the approach direction, such as 'z' or '-x'; empty: as the
    gripper's `base_axes` state."""
    closing: str = "x"
    """Axis from finger 1 to finger 2; empty as above."""
    turn: float = 0.0
    """Angle about the approach direction from that axis to the closing axis [rad]."""
    origin: Origin = "tcp"
    """What the origin is measured from."""
    ahead: float = 0.0
    """How far that point is before the origin, along the approach direction [m]."""
    link: str = ""
    """Link of a hand with joints in whose frame axes and origin are; empty: the base."""
    name: str = field(default="", compare=False)
    """Its name in `FRAMES`; empty: none."""

    def __post_init__(self) -> None:
        axes = self.approach, self.closing
        right = axes[0][-1:] != axes[1][-1:] and AXES.keys() >= {*axes}
        if not right and axes != ("", ""):
            raise SettingError(
                f"a gripper's frame needs two axes at right angles of {', '.join(AXES)}; got "
                f"approach={axes[0]},closing={axes[1]}"
            )
        check_choice("origin", self.origin, Origin)
        if not abs(self.ahead) <= LARGEST:
            raise SettingError(
                f"the TCP must be at most {LARGEST:g} m from the origin of a gripper's frame; got "
                f"{self.ahead:g} m: lengths in mm need their unit, tcp=103.4mm"
            )
        if not math.isfinite(self.turn):
            raise SettingError(f"the turn of a gripper's frame must be finite; got {self.turn:g}")

    @classmethod
    def of(cls, value: "GripperFrame | str") -> "GripperFrame":
        """The frame that a text names or states.

        Raises:
            SettingError: No frame is called so, or the text states none.
        """
        return value if isinstance(value, GripperFrame) else _of_text(value)

    def __str__(self) -> str:
        """The text of it, which `of` reads."""
        if self.name:
            return self.name
        own = not self.approach
        axes = {} if own else {n: _signed(getattr(self, n)) for n in ("approach", "closing")}
        turn = {"turn": f"{math.degrees(self.turn):.12g}deg"} if self.turn else {}
        parts = {**axes, **turn, "tcp": self._tcp}
        if self.link:
            plain = self == GripperFrame(link=self.link)
            parts = {"link": self.link, **({} if plain else parts)}
        return ",".join(["hand"] * own + [f"{name}={value}" for name, value in parts.items()])

    @property
    def _tcp(self) -> str:
        word = "" if self.origin == "tcp" else self.origin
        return word + (f"{self.ahead:{'+' * bool(word)}.12g}" if self.ahead or not word else "")

    def distance(self, hand: "Hand | None") -> float:
        """How far the TCP is before the origin, along the approach direction [m].

        Args:
            hand: The gripper; None: not known.

        Raises:
            SettingError: The frame depends on the lengths of a gripper, and there is none.
        """
        if self.origin == "tcp":
            return self.ahead
        if self.origin == "base" and _has_joints(hand):
            return self.ahead
        jaws = self._jaws(hand)
        return self.ahead + (jaws.base_to_tcp if self.origin == "base" else -jaws.end)

    def to_tcp(self, hand: "Hand | None") -> "Floats":
        """Matrix that takes coordinates of the gripper (TCP) to those of this frame, (4, 4) [m].

        Args:
            hand: The gripper; None: not known.

        Raises:
            SettingError: The frame depends on a gripper, and there is none.
        """
        import numpy as np

        names = (self.approach, self.closing) if self.approach else self._own_axes(hand)
        approach, unturned = (np.array(AXES[name]) for name in names)
        side = np.cross(approach, unturned)
        closing = math.cos(self.turn) * unturned + math.sin(self.turn) * side
        pose = np.eye(4)
        pose[:3, :3] = np.stack([closing, np.cross(approach, closing), approach], axis=1)
        pose[:3, 3] = self.distance(hand) * approach
        return pose @ np.linalg.inv(self._link_pose(hand)) if self.link else pose

    def _link_pose(self, hand: "Hand | None") -> "Floats":
        """Pose of the link in the hand's frame where all joints are at 0."""
        import numpy as np

        links = getattr(hand, "link_names", ())
        if self.link not in links:
            name = "no hand with joints is given" if hand is None else f"{hand.name} has none"
            raise SettingError(f"poses are in the frame of the link {self.link!r}, but {name}")
        poses = hand.link_poses(np.zeros((1, len(hand.joint_names))))  # type: ignore[union-attr]
        return np.asarray(poses[0, links.index(self.link)])

    def _own_axes(self, hand: "Hand | None") -> tuple[str, str]:
        if _has_joints(hand):
            return "z", "x"
        closing, approach = self._jaws(hand).base_axes
        return approach, closing

    def _jaws(self, hand: "Hand | None") -> Jaws:
        if isinstance(hand, Jaws):
            return hand
        raise SettingError(
            f"poses in the frame {str(self)!r} need the lengths of a parallel gripper: give it "
            "(--hand, in Python hand=...)"
        )


def _has_joints(hand: "Hand | None") -> bool:
    """Whether a hand's frame is that of its base, as of those with joints."""
    return hasattr(hand, "link_poses")


def _signed(axis: str) -> str:
    return axis if axis.startswith("-") else f"+{axis}"


def _of_text(text: str) -> GripperFrame:
    """The frame of a text. Raises SettingError."""
    words = [word.strip() for word in text.split(",")]
    base, named = GripperFrame(), "=" not in words[0]
    if named:
        base = _named_frame(words.pop(0))
        if not words:
            return base
    parts = dict(word.partition("=")[::2] for word in words)
    if len(parts) < len(words) or not parts.keys() <= {*_PARTS} or "" in parts.values():
        raise SettingError(
            f"a gripper's frame is a name or parts such as {FORM} (also turn); got {text!r}"
        )
    if "link" in parts:
        base, named = GripperFrame(link=parts["link"]), True
    given = [name for name in ("approach", "closing") if name in parts]
    if len(given) == 1 or (not given and not named):
        missing = ({"approach", "closing"} - {*given}).pop() if given else "approach"
        raise SettingError(
            f"a gripper's frame needs both of its axes, {missing} is missing in {text!r}: write "
            f"{FORM}"
        )
    values: dict[str, Any] = {name: _axis(parts[name]) for name in given}
    if "turn" in parts:
        values["turn"] = parse_angle("turn", parts["turn"])
    if "tcp" in parts:
        values |= _tcp_of(parts["tcp"])
    elif not named:
        raise SettingError(
            f"where is the TCP in the frame {text!r}? give tcp=0 where it is the origin, "
            "tcp=0.1034 where it is 103.4 mm before it, or tcp=base for the gripper's own"
        )
    frame = replace(base, name="", **values)
    if "side" in parts:
        _check_side(frame, _axis(parts["side"]))
    return frame


def _named_frame(name: str) -> GripperFrame:
    """The frame of a name. Raises SettingError."""
    if name == AUTO:
        raise SettingError(
            "'auto' is no frame of its own: it stands alone where poses are read with an object "
            "(evaluate, validate, simulate; in Python results.reading.applied(poses))"
        )
    if name not in FRAMES:
        raise SettingError(f"unknown gripper frame {name!r}; {known_frames()}")
    return FRAMES[name]


def _axis(text: str) -> str:
    axis = text.removeprefix("+")
    if axis not in AXES:
        raise SettingError(
            f"an axis of a gripper's frame is +x, -x, +y, -y, +z or -z; got {text!r}"
        )
    return axis


def _tcp_of(text: str) -> dict[str, Any]:
    """Origin and distance of a text. Raises SettingError."""
    word = re.match(r"base|ends|", text).group()  # type: ignore[union-attr]
    rest = text.removeprefix(word)
    if word and not rest:
        return {"origin": word, "ahead": 0.0}
    length = parse_length("tcp", rest)
    ahead = length.metres if isinstance(length, Measure) else float(length)
    return {"origin": word or "tcp", "ahead": ahead}


def _check_side(frame: GripperFrame, side: str) -> None:
    """Refuse a third axis that makes the frame left-handed. Raises SettingError."""
    import numpy as np

    if frame.turn or not frame.approach:
        raise SettingError("side is the third of the axes approach and closing, without a turn")
    third = np.cross(AXES[frame.approach], AXES[frame.closing])
    if float(third @ np.array(AXES[side])) != 1.0:
        right = next(name for name, axis in AXES.items() if np.array_equal(third, axis))
        raise SettingError(
            f"the axes approach={_signed(frame.approach)}, closing={_signed(frame.closing)} and "
            f"side={_signed(side)} are not right-handed: side is approach x closing, "
            f"{_signed(right)}"
        )


def known_frames() -> str:
    """The names of frames, and how to state another one, for messages."""
    return f"known are {', '.join(FRAMES)}; or state its axes, {FORM}"


def _named(
    name: str, axes: tuple[str, str], origin: Origin, *, turn: float = 0.0, ahead: float = 0.0
) -> tuple[str, GripperFrame]:
    approach, closing = axes
    return name, GripperFrame(
        name=name, approach=approach, closing=closing, origin=origin, turn=turn, ahead=ahead
    )


_OWN, _Z_X, _Z_Y, _X_Y = ("", ""), ("z", "x"), ("z", "-y"), ("x", "y")

FRAMES: dict[str, GripperFrame] = dict(
    [
        _named("tcp", _Z_X, "tcp"),
        _named("hand", _OWN, "base"),
        _named("isaac", _OWN, "base"),
        _named("moveit", _OWN, "base"),
        _named("graspgen", _Z_X, "base"),
        _named("acronym", _Z_X, "base"),
        _named("graspnetapi", _X_Y, "ends", ahead=0.02),
        _named("dexnet", _X_Y, "tcp"),
        _named("gpd", _X_Y, "ends", ahead=0.06),
        _named("burg", ("-z", "x"), "ends"),
        _named("panda_hand", _Z_Y, "base"),
        _named("panda_hand_tcp", _Z_Y, "tcp"),
        _named("panda_link8", _Z_Y, "base", turn=-0.25 * math.pi),
        _named("robotiq_arg2f_base_link", ("z", "y"), "base"),
        _named("robotiq_85_base_link", _Z_X, "base"),
    ]
)
"""Frames by name, as the programs state them (see docs/guide/elsewhere.md); several names may stand
for the same one."""


def frames_of(hand: Any) -> Iterator[tuple[GripperFrame, str]]:
    """Frames that poses of a hand may be in, with words for each.

    Those by name, and their axes at the TCP and at the base; of hands with joints those of the
    links between base and palm, and of what is fixed to these.
    """
    if _has_joints(hand):
        joints, path = hand.tree.joints, hand.tree.chain(hand.palm)
        fixed = (n for link in path for n in hand.tree.children(link) if joints[n].kind == "fixed")
        yield from ((GripperFrame(link=n), f"--frame link={n}") for n in (*path, *fixed))
        return
    yield from ((frame, f"--frame {name}") for name, frame in FRAMES.items())
    for name, frame in FRAMES.items():
        yield replace(frame, name="", origin="tcp", ahead=0.0), f"the axes of {name} at the TCP"
        yield replace(frame, name="", origin="base", ahead=0.0), f"the axes of {name} at the base"
