"""Other readings of poses: which mistake of a file would explain why the jaws do not close."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from grasp3d.arrays import Bools, Bytes, Floats, Ints
from grasp3d.grasps.hand_readings import JointTrial, reading_in_degrees
from grasp3d.grasps.poses import GraspPoses
from grasp3d.grasps.postures import matched
from grasp3d.grasps.readings import (
    FAR,
    FITTING,
    FRAME,
    READING,
    SUSPECTED,
    SUSPICION,
    TAKEN,
    Alternative,
    PoseReading,
    Trial,
    Tried,
    changed_readings,
    frame_key,
    frame_words,
    framed,
)
from grasp3d.hand.articulated.articulated_hand import ArticulatedHand
from grasp3d.hand.closed_jaws import Closing
from grasp3d.hand.frames import FRAMES, GripperFrame
from grasp3d.hand.hand import Hand
from grasp3d.hand.jaws import AXES, Jaws, metres_per_unit
from grasp3d.hand.table import Table
from grasp3d.mesh import ObjectMesh
from grasp3d.system.context import unreported

FEWEST = 5
"""Poses below which nothing is suspected: too few agree by chance."""

LOOKED_AT, SCREENED, TRIED = 2000, 24, 200
"""Poses of which distinct ones are chosen, those that all readings are tried with, and those that
the best few are tried with; each spread evenly over the ones before."""

SAME = 0.01, math.radians(15.0)
"""Distance [m] and angle [rad] within which two poses are nearly the same."""

KINDS, NEAR = 4, 0.2
"""How many kinds of readings the best few are of, and by which fraction of the poses a reading may
be worse than the best of its kind."""

LEAST_FIT, LEAST_GAIN = 0.4, 0.2
"""A reading is suspected if this fraction of the poses fits with it, and by so much more."""

LEAST_TOUCH = 0.05
"""Fraction of the area of a pad that both jaws touch in a pose that fits."""

NONE_FITS = 0.05
"""Fraction of the poses that fit as stated above which the scale of lengths is not suspected."""

FEW_FIT = 0.5
"""Fraction up to which readings are tried that take longer."""

CENTRED = 3
"""Most times that an origin of a series is moved to where the contacts are at the TCP."""

LISTED = 3
"""Most readings that are named where none wins."""

STEP, BEHIND = 0.01, 0.06
"""Steps of the distance from origin to TCP in a series, and how far it goes beyond the base [m]."""

READINGS = {READING: "--frame auto", SUSPECTED: "warning"}
"""What people are told of these settings."""


def suspected_reading(
    mesh: ObjectMesh, poses: GraspPoses, hand: Hand, *, table: Table | None = None
) -> PoseReading | None:
    """What mistake in a file of poses would explain that few of them fit the object.

    A pose fits if the gripper, wide open, approaches it without collision, its jaws then close on
    the object, and each touches it with a twentieth of a pad. Tried are other frames of the
    gripper, with all axes and several origins, quaternions in another order, rotations or poses
    that are inverted, and lengths in other units or of an object of another scale. One is suspected
    if two fifths of the poses fit with it, a fifth more than as stated, and it wins the sign test
    of the poses that fit with one of the two only, at the level 0.01 divided by the number of
    readings. It is named if it wins this test, or that of the areas that the jaws touch, at 0.001
    against each of the others that are tried with as many poses, and loses none.

    Args:
        mesh: The object; its unit is known.
        poses: Poses as they were read; without a unit they are in the mesh's.
        hand: The gripper.
        table: What the object stands on; None: nothing.

    Returns:
        The reading; None: enough poses fit, there are too few of them, or no reading is better.
    """
    read = (poses if poses.unit else replace(poses, unit=mesh.unit)).in_unit("m")
    if isinstance(hand, ArticulatedHand):
        read = matched(read, hand)
        if (in_degrees := reading_in_degrees(read, hand)) is not None:
            return in_degrees
    tried = read.take(_distinct(read.poses))
    if tried.count < FEWEST:
        return None
    trial: Trial
    if isinstance(hand, ArticulatedHand):
        trial = JointTrial(mesh, hand, table)
    else:
        trial = JawTrial(mesh, hand, table)
    (stated,) = trial.of([framed(poses.gripper_frame)], tried)
    if stated.fitting >= FITTING * tried.count:
        return None
    none_fits = stated.fitting <= NONE_FITS * tried.count
    further = trial.last_alternatives(tried, lengths=none_fits)
    for alternatives in (
        trial.alternatives(tried, lengths=none_fits),
        further if stated.fitting <= FEW_FIT * tried.count else iter(()),
    ):
        others = [
            one
            for one in alternatives
            if not one.is_length
            or trial.tells(one, tried)
            or trial.spread(stated.reading, tried) >= FAR
        ]
        if not others:
            return None
        screened = trial.of(others, tried.take(_spread(tried.count, SCREENED)))
        found = trial.of(_best_few(screened, hand), tried)
        first = max(found, key=lambda one: one.fitting)
        enough = max(LEAST_FIT * tried.count, stated.fitting + LEAST_GAIN * tried.count)
        if first.fitting >= enough and first.fits_more(stated, SUSPICION / len(others)):
            break
    else:
        return None
    chosen = _chosen(found, first, hand)
    if len(chosen) == 1 and chosen[0].reading.series:
        centred = _series_centred(trial, chosen[0], tried)
        chosen = [centred] if trial.tells(centred.reading, tried) else []
    reading = chosen[0].reading if len(chosen) == 1 else None
    return PoseReading(
        words=reading.words if reading else _several(chosen, found, first, hand),
        best=reading,
        fit=trial.fit,
        fitting=(chosen[0] if chosen else first).fitting,
        stated=stated.fitting,
        tried=tried.count,
        count=poses.count,
        stated_frame=poses.gripper_frame,
        hand=hand,
    )


def explained(
    mesh: ObjectMesh, poses: GraspPoses, hand: Hand, *, table: Table | None = None
) -> GraspPoses:
    """The poses in the suspected reading; as they are if there is none, or no one that is named.

    Args:
        mesh: The object; its unit is known.
        poses: As for `suspected_reading`.
        hand: The gripper.
        table: What the object stands on; None: nothing.

    Returns:
        The poses; the setting `pose_reading` says in which reading.
    """
    reading = suspected_reading(mesh, poses, hand, table=table)
    if reading and reading.frame:
        return reading.applied(poses if poses.unit else replace(poses, unit=mesh.unit))
    stated = frame_words(poses.gripper_frame, hand)
    kept = f"kept {stated}, as stated: no other frame is named"
    return replace(poses, settings={**poses.settings, READING: kept})


def starting_inside(state: Bytes) -> str | None:
    """What suggests that most poses are too deep, from `Closing` codes (k,): one sentence."""
    inside = int((state == Closing.STARTS_INSIDE).sum())
    if len(state) < FEWEST or 2 * inside <= len(state):
        return None
    return (
        f"a finger starts in the object in {inside} of {len(state)} poses, even wide open: is the "
        "origin of the poses the point between the fingertips, is the unit of mesh and poses "
        "right, and is the object narrower than the stroke there?"
    )


def _distinct(poses: Floats) -> Ints:
    """Indices of poses of which no two are nearly the same: those that are count once.

    Where many are at one place, what fits there would decide for all others.
    """
    chosen: list[int] = []
    for row in _spread(len(poses), LOOKED_AT):
        others = poses[chosen]
        near = np.linalg.norm(others[:, :3, 3] - poses[row, :3, 3], axis=1) < SAME[0]
        cosine = 0.5 * (np.einsum("kij,ij->k", others[:, :3, :3], poses[row, :3, :3]) - 1.0)
        if not (near & (cosine > math.cos(SAME[1]))).any():
            chosen.append(int(row))
    return np.array(chosen, dtype=np.int64)[_spread(len(chosen), TRIED)]


def _spread(count: int, most: int) -> Ints:
    """Indices of at most so many of some poses, spread evenly."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(np.int64))


def _best_few(screened: Sequence[Tried], hand: Hand) -> list[Alternative]:
    """Readings of the best kinds; of origins in a series the best one of each kind."""
    kinds: dict[tuple[str, str], list[Tried]] = {}
    for one in sorted(screened, key=lambda one: -one.fitting):
        kinds.setdefault(one.reading.kind(hand), []).append(one)
    few: list[Alternative] = []
    for group in list(kinds.values())[:KINDS]:
        least = group[0].fitting - NEAR * len(group[0].fits)
        near = [one.reading for one in group if one.fitting >= least]
        few += [one for one in near if not one.series]
        few += [one for one in near if one.series][:1]
    return few


def _chosen(found: Sequence[Tried], first: Tried, hand: Hand) -> list[Tried]:
    """The readings that win against all of other kinds, those of programs if there are any.

    Several differ in the place of the origin only, and none of them wins against the others.
    """
    kind = first.reading.kind(hand)
    same = [one for one in found if one.reading.kind(hand) == kind and not first.fits_more(one)]
    best = [one for one in same if not one.reading.series] or same
    others = [one for one in found if one.reading.kind(hand) != kind]
    if not all(one.beats(other) for one in best for other in others):
        return []
    winners = (
        one
        for one in best
        if all(one.beats(two) and not two.is_nearer(one) for two in best if two is not one)
    )
    return next(([one] for one in winners), best)


def _several(chosen: Sequence[Tried], found: Sequence[Tried], first: Tried, hand: Hand) -> str:
    """Words for several readings that fit as well, at most `LISTED` of other kinds."""
    if not chosen:
        rivals: dict[tuple[str, str], str] = {}
        for one in sorted(found, key=lambda one: -one.fitting):
            if not first.fits_more(one):
                words = one.reading.words.removesuffix(TAKEN)
                rivals.setdefault(one.reading.kind(hand), words)
        named = "; ".join([*rivals.values()][:LISTED])
        more = "; and more" if len(rivals) > LISTED else ""
        several = "with one of several other readings, of which none wins"
        return f"{several} ({named}{more}: state it with --frame),"
    frames = " or ".join(str(one.reading.frame) for one in chosen)
    return f"{FRAME}{frames}, which differ in the place of the origin,"


def _series_centred(trial: Trial, tried: Tried, poses: GraspPoses) -> Tried:
    """A reading of a series with the contacts at the TCP, as far as no fewer poses fit."""
    for _ in range(CENTRED):  # a pad far off is touched near its end only
        (nearer,) = trial.of([_centred(tried)], poses)
        if nearer.fitting < tried.fitting:
            break
        tried = nearer
    return tried


def _centred(tried: Tried) -> Alternative:
    """A reading with the contacts at the TCP, to a millimetre."""
    frame = tried.reading.frame
    ahead = round(frame.ahead + float(np.nanmedian(tried.ahead)), 3)
    return framed(replace(frame, ahead=ahead), series=True)


class JawTrial(Trial):
    """Readings of poses of grippers that close."""

    fit = (
        "the jaws close on the object where it is, without collision and with a twentieth of the "
        "pads,"
    )

    def alternatives(self, poses: GraspPoses, *, lengths: bool) -> Iterator[Alternative]:
        """See `Trial`."""
        hand = self.hand
        known: set[str] = {frame_key(poses.gripper_frame.to_tcp(hand), hand)}
        for frame, series in _frames(poses.gripper_frame, hand):
            key = frame_key(frame.to_tcp(hand), hand)
            if key not in known:
                known.add(key)
                yield framed(frame, series=series)
        frames = [poses.gripper_frame]
        if poses.gripper_frame == FRAMES["tcp"] and isinstance(hand, Jaws):
            frames += [FRAMES["hand"], FRAMES["graspgen"]]  # of which they may have been converted
        yield from changed_readings(self.mesh, poses, hand, frames, lengths=lengths)

    def fits(self, poses: Floats, posture: Floats) -> tuple[Bools, Floats, Floats]:
        """See `Trial`."""
        del posture  # jaws have none
        with unreported():
            closed = self.hand.close(self.mesh, poses)
        open_wide = np.zeros(len(poses), dtype=np.bool_)
        blocked = self.hand.blocked(self.mesh, poses, closed, held=open_wide, table=self.table)
        least = LEAST_TOUCH * self.hand.touch_area / metres_per_unit(self.mesh) ** 2
        area = closed.area.min(axis=1)
        middle = closed.points.mean(axis=1) - poses[:, :3, 3]
        ahead = np.einsum("ki,ki->k", middle, poses[:, :3, 2]) * metres_per_unit(self.mesh)
        return closed.closed & ~blocked & (area >= least), area, ahead


def _frames(stated: GripperFrame, hand: Hand) -> Iterator[tuple[GripperFrame, bool]]:
    """Frames of the gripper, those of programs first, and whether the origin is one of a series."""
    is_jaws = isinstance(hand, Jaws)
    yield from ((frame, False) for frame in FRAMES.values() if is_jaws or frame.origin == "tcp")
    for approach in AXES:
        for closing in ("x", "y", "z") if is_jaws else AXES:
            if closing[-1] != approach[-1]:
                for origin in ("tcp", "base") if is_jaws else ("tcp",):
                    frame = GripperFrame(approach=approach, closing=closing, origin=origin)
                    yield frame, False
    if not isinstance(hand, Jaws):
        return
    axes = {"approach": stated.approach, "closing": stated.closing, "turn": stated.turn}
    kind = frame_key(stated.to_tcp(hand)[:3, :3], hand)
    known = [
        frame.distance(hand)
        for frame in (stated, *FRAMES.values())
        if frame_key(frame.to_tcp(hand)[:3, :3], hand) == kind
    ]
    for step in range(-1, int((hand.base_to_tcp + BEHIND) / STEP) + 1):
        if min(abs(step * STEP - one) for one in known) > 1.5 * STEP:
            yield GripperFrame(**axes, ahead=step * STEP), True  # type: ignore[arg-type]
