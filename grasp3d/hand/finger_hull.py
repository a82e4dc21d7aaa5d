"""Faces of a finger that the other finger sees, from its geometry.

A jaw that moves along the closing axis touches with these. Each piece of the geometry, a closed
surface that is connected, counts as its convex hull, as in physics engines: hollows of a piece are
filled, those between pieces are not. Geometry that is not closed is one piece.

A hull is the intersection of half-spaces. Those that bound it most are used, until the shape that
they bound is nowhere more than `TOLERANCE` outside the hull; this merges coplanar triangles, and
fillets become a few faces. Where pieces are in front of each other, the front one is kept.

Everything is in the gripper's frame, of finger 1: the other finger is at larger x.
"""

import math
from collections.abc import Iterator, Sequence
from itertools import islice
from typing import NamedTuple

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from grasp3d.arrays import Floats
from grasp3d.hand.jaws import MOST_CORNERS, Corners, problem_of_face

TOLERANCE = 2e-4
"""Largest distance of the faces from the hull [m]; parts that are narrower are left out. Collision
meshes are hardly more exact, and pads give way by more."""

STEEP = math.radians(3.0)
"""Angle to the closing axis up to which faces are sides of the finger, as moulded parts with their
draft have them. Nothing is held there: the friction would have to be 1 / tan(3 degrees) = 19."""

MOST_FACES = 64
"""Most faces of a finger: the time to close jaws is proportional to them. A hull with more of them
is approximated more coarsely; pieces that have more of them together count as one."""

EDGE_ON = 1e-6
"""Largest x of the unit normal of a face that counts as parallel to the closing axis."""

SAME_PLANE = 1e-6
"""Distance along x below which pieces are equally far in front [m]."""

SAME_POINT = 6
"""Decimals [m] in which corners of connected triangles agree."""

SLIVER = 5e-5
"""Width up to which parts of faces are left out that are in front of or behind others [m]."""


class Face(NamedTuple):
    """A convex face at x = a + b y + c z."""

    plane: Floats
    """a [m], b and c (3,)."""
    outline: Floats
    """Corners (y, z), counterclockwise [m] (n, 2)."""

    def x(self, points: Floats) -> Floats:
        """Position of its plane along x at points (y, z) (n, 2), shape (n,)."""
        return np.asarray(self.plane[0] + points @ self.plane[1:])

    @property
    def corners(self) -> Floats:
        """Corners (x, y, z) (n, 3)."""
        return np.column_stack([self.x(self.outline), self.outline])

    @property
    def angle(self) -> float:
        """Angle to the closing axis [rad], 0 to pi / 2."""
        return math.atan2(1.0, math.hypot(*self.plane[1:]))


def finger_faces(
    triangles: Floats, *, front: float = -math.inf, tolerance: float = TOLERANCE
) -> list[Face]:
    """Faces of a finger that the other finger sees.

    Args:
        triangles: Corners of its geometry [m], shape (n, 3, 3).
        front: Position along z of the front of the palm; what is behind it is left out [m].
        tolerance: Largest distance of the faces from the hulls of its pieces [m].

    Returns:
        At most 64 faces, which do not overlap seen along x; none where the geometry has no volume.

    Example:
        >>> import trimesh
        >>> from grasp3d.hand.finger_hull import finger_faces
        >>> box = trimesh.creation.box(bounds=[[-0.01, -0.005, -0.03], [0.0, 0.005, 0.01]])
        >>> (face,) = finger_faces(box.triangles)
        >>> face.plane.round(9).tolist(), face.outline.round(9).tolist()[::2]
        ([0.0, 0.0, 0.0], [[-0.005, -0.03], [0.005, 0.01]])
    """
    for pieces in (_pieces(triangles), [triangles]):
        faces = list(islice(_faces_of(pieces, front, tolerance), MOST_FACES + 1))
        if len(faces) <= MOST_FACES:
            break
    return faces


def _faces_of(pieces: Sequence[Floats], front: float, tolerance: float) -> Iterator[Face]:
    """Faces of pieces that count as their hulls, but for sides and slivers."""
    hulls = [hull_faces(points_beyond(piece, front), tolerance=tolerance) for piece in pieces]
    for number, faces in enumerate(hulls):
        for face in faces:
            for part in _seen(face, hulls[:number], hulls[number + 1 :]):
                if width(part.outline) > tolerance and part.angle > STEEP:
                    yield part


def points_beyond(triangles: Floats, front: float) -> Floats:
    """Points whose hull is that of the triangles' parts from a plane at z on, shape (n, 3)."""
    starts = np.asarray(triangles).reshape(-1, 3)
    ends = np.roll(triangles, -1, axis=1).reshape(-1, 3)
    below = starts[:, 2] < front
    crossing = below != (ends[:, 2] < front)
    one, two = starts[crossing], ends[crossing]
    cut = one + (two - one) * ((front - one[:, 2:]) / (two - one)[:, 2:] if len(one) else 0.0)
    return np.concatenate([starts[~below], cut])


def hull_faces(points: Floats, *, tolerance: float = TOLERANCE) -> list[Face]:
    """Faces toward larger x of the convex hull of points (n, 3), those that are steep as well.

    They cover the hull seen along x, are nowhere behind it and at most `tolerance` in front of it,
    or more if there are `MOST_FACES` of them.
    """
    rows = _half_spaces(points)
    if rows is None:
        return []
    low, high = points.min(axis=0), points.max(axis=0)
    outline = rectangle(low[1:], high[1:])
    faces = [Face(np.array([high[0], 0.0, 0.0]), outline)]
    while len(rows) and len(faces) < MOST_FACES:
        corners = np.concatenate([face.corners for face in faces])
        outside = (corners @ rows[:, :3].T + rows[:, 3]).max(axis=0)
        worst = int(outside.argmax())
        if outside[worst] <= tolerance:
            break
        row, bounding = rows[worst], outside > tolerance  # the others never will be
        bounding[worst] = False
        rows = rows[bounding]
        if row[0] == 0.0:
            outline = clipped(outline, outline @ row[1:3] + row[3])
            faces = [
                Face(f.plane, clipped(f.outline, f.outline @ row[1:3] + row[3])) for f in faces
            ]
        else:
            faces = _cut_by(Face(-row[[3, 1, 2]] / row[0], outline), faces)
        faces = [face for face in faces if len(face.outline) > 2]
    return faces


def _half_spaces(points: Floats) -> Floats | None:
    """Half-spaces nx x + ny y + nz z + d <= 0 around points, of those with nx >= 0 (m, 4).

    Where faces at the back meet those at the front, half-spaces with nx = 0 bound the hull seen
    along x. None: the points have no volume.
    """
    if len(points) < 4:
        return None
    try:
        whole, outline = ConvexHull(points), ConvexHull(points[:, 1:])
    except QhullError:  # flat
        return None
    front = whole.equations[whole.equations[:, 0] > EDGE_ON]
    sides = np.column_stack([np.zeros(len(outline.equations)), outline.equations])
    return np.concatenate([front, sides])


def _cut_by(new: Face, faces: Sequence[Face]) -> list[Face]:
    """The faces where they are not in front of a new one, and the new one where it is rearmost."""
    outline, pieces = new.outline, []
    for face in faces:
        outline = clipped(outline, new.x(outline) - face.x(outline))
        pieces.append(
            Face(face.plane, clipped(face.outline, face.x(face.outline) - new.x(face.outline)))
        )
    return [*pieces, Face(new.plane, outline)]


def _pieces(triangles: Floats) -> list[Floats]:
    """Triangles (n, 3, 3) of each closed, connected surface; of all where some are not closed."""
    import trimesh  # slow to import, and needed where a robot's description is read alone

    solid = trimesh.Trimesh(
        triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3), process=False
    )
    solid.merge_vertices(digits_vertex=SAME_POINT)
    pieces = solid.split(only_watertight=False, repair=False)
    if not all(piece.is_watertight for piece in pieces):
        return [triangles]
    return [np.asarray(piece.triangles) for piece in pieces]


def _seen(
    face: Face, earlier: Sequence[Sequence[Face]], later: Sequence[Sequence[Face]]
) -> list[Face]:
    """Convex parts of a face that no other piece is in front of.

    Of pieces that are equally far in front the earlier piece is kept.
    """
    parts = [face.outline]
    for pieces, gap in ((earlier, -SAME_PLANE), (later, SAME_PLANE)):
        for other in (other for piece in pieces for other in piece):
            hidden = common(face.outline, other.outline)
            hidden = clipped(hidden, face.x(hidden) - other.x(hidden) + gap)
            parts = [rest for part in parts for rest in without(part, hidden, SLIVER)]
    return [Face(face.plane, part) for part in parts]


SAME_CORNER = 1e-9
"""Distance up to which neighbouring corners are one [m]: the line through them has no direction."""


def rectangle(low: Floats, high: Floats) -> Floats:
    """The rectangle between two opposite corners (2,), shape (4, 2)."""
    return np.array([low, [high[0], low[1]], high, [low[0], high[1]]])


def clipped(polygon: Floats, values: Floats) -> Floats:
    """The part of a polygon where a linear function, of values (n,) at its corners, is at most 0.

    Example:
        >>> import numpy as np
        >>> from grasp3d.hand.finger_hull import clipped, rectangle
        >>> square = rectangle(np.zeros(2), np.ones(2))
        >>> clipped(square, square[:, 0] - 0.5).tolist()
        [[0.0, 0.0], [0.5, 0.0], [0.5, 1.0], [0.0, 1.0]]
    """
    inside = values <= 0.0
    if inside.all():
        return polygon
    corners = []
    for i in range(len(polygon)):
        j = (i + 1) % len(polygon)
        if inside[i]:
            corners.append(polygon[i])
        if inside[i] != inside[j]:
            t = values[i] / (values[i] - values[j])
            corners.append((1.0 - t) * polygon[i] + t * polygon[j])
    points = np.array(corners).reshape(-1, 2)
    steps = np.abs(points - np.roll(points, 1, axis=0)).max(axis=1, initial=0.0)
    return np.asarray(points[steps > SAME_CORNER])


def common(one: Floats, two: Floats) -> Floats:
    """The part of a polygon that is within another one."""
    if len(one) < 3 or len(two) < 3:
        return one[:0]
    if (one.max(axis=0) < two.min(axis=0)).any() or (two.max(axis=0) < one.min(axis=0)).any():
        return one[:0]
    for *normal, offset in _sides(two):
        one = clipped(one, one @ normal + offset)
    return one


def without(polygon: Floats, hole: Floats, narrow: float) -> Iterator[Floats]:
    """Parts of a polygon that are outside another one, but for those at most `narrow` wide."""
    if width(common(polygon, hole)) <= narrow:
        yield polygon
        return
    for *normal, offset in _sides(hole):
        outside = polygon @ normal + offset
        part = clipped(polygon, -outside)
        if width(part) > narrow:
            yield part
        polygon = clipped(polygon, outside)


def _sides(polygon: Floats) -> Floats:
    """Half-planes ny y + nz z + d <= 0 whose intersection a polygon is, not scaled (n, 3)."""
    along = np.roll(polygon, -1, axis=0) - polygon
    normals = np.column_stack([along[:, 1], -along[:, 0]])
    return np.column_stack([normals, -(normals * polygon).sum(axis=1)])


def width(polygon: Floats) -> float:
    """Smallest distance of parallel lines that a polygon is between."""
    if len(polygon) < 3:
        return 0.0
    sides = _sides(polygon)
    rows = sides / np.hypot(sides[:, 0], sides[:, 1])[:, None]
    return float(-(polygon @ rows[:, :2].T + rows[:, 2]).min(axis=0).max())


def area(polygon: Floats) -> float:
    """Area of a polygon."""
    x, y = polygon.T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def without_flat_corners(polygon: Floats, distance: float) -> Floats:
    """A polygon without corners that are nearer than that to the line through their neighbours."""
    while len(polygon) > 2:
        before, after = np.roll(polygon, 1, axis=0), np.roll(polygon, -1, axis=0)
        (ax, ay), (bx, by) = (after - before).T, (polygon - before).T
        heights = np.abs(ax * by - ay * bx) / np.maximum(np.hypot(ax, ay), distance)
        flattest = int(heights.argmin())
        if heights[flattest] >= distance:
            break
        polygon = np.delete(polygon, flattest, axis=0)
    return polygon


ALIKE, ALIKE_WITHIN = 0.95, 1e-3
"""Fraction of their inner sides on which fingers agree that mirror each other, within that distance
[m]: the compliance of a gripper that states none."""

FLAT = 0.99
"""Fraction of a pad and of the inner side on which they agree where the pad is the inner side."""

STANDS_OUT = 5e-5
"""Distance from the line through its neighbours, seen along x, below which a corner is none [m]."""

DIGITS = 9
"""Decimals of coordinates [m]: fewer than rounding errors have."""


def inner_faces(
    fingers: tuple[Floats, Floats], *, front: float, pad: tuple[float, float]
) -> tuple[Corners, ...] | None:
    """Faces of the inner side of finger 1, as `ParallelGripper` has them.

    Args:
        fingers: Corners of the geometry of finger 1 and of the mirror image of finger 2, with the
            foremost points at x = 0 [m], shape (n, 3, 3) each.
        front: Position along z of the front of the palm [m].
        pad: Sizes of the pad along y and z [m].

    Returns:
        The faces; empty where the pad is all of them, or where fingers are too large for a face.
        None: the fingers do not mirror each other.

    Example:
        >>> import trimesh
        >>> from grasp3d.hand.finger_hull import inner_faces
        >>> box = trimesh.creation.box(bounds=[[-0.01, -0.01, -0.03], [0.0, 0.01, 0.01]]).triangles
        >>> inner_faces((box, box), front=-0.01, pad=(0.02, 0.02))
        ()
        >>> inner_faces((box, box), front=-0.02, pad=(0.02, 0.02))
        (((0.0, -0.01, -0.02), (0.0, 0.01, -0.02), (0.0, 0.01, 0.01), (0.0, -0.01, 0.01)),)
        >>> inner_faces((box, 0.5 * box), front=-0.02, pad=(0.01, 0.01)) is None
        True
    """
    one, two = (finger_faces(finger, front=front) for finger in fingers)
    if agreement(one, two, ALIKE_WITHIN) < ALIKE:
        return None
    half = 0.5 * np.array(pad)
    if agreement([Face(np.zeros(3), rectangle(-half, half))], one, TOLERANCE) > FLAT:
        return ()
    faces = tuple(corners for face in one for corners in corners_of(face))
    return () if any(map(problem_of_face, faces)) else faces


def agreement(one: Sequence[Face], two: Sequence[Face], within: float) -> float:
    """Area on which inner sides are equally far in front, as a fraction of the larger one.

    Args:
        one: Faces that do not overlap, seen along x.
        two: The same of another finger.
        within: Largest difference along x that counts as none [m].

    Returns:
        0 to 1; 1 if both are empty.
    """
    total = 0.0
    for face in one:
        for other in two:
            part = common(face.outline, other.outline)
            for front, back in ((face, other), (other, face)):
                part = clipped(part, front.x(part) - back.x(part) - within)
            total += area(part)
    largest = max(sum(area(face.outline) for face in faces) for faces in (one, two))
    return total / largest if largest else 1.0


def corners_of(face: Face) -> list[Corners]:
    """A face as one that a gripper may have, in several parts if it has too many corners.

    Example:
        >>> import numpy as np
        >>> from grasp3d.hand.finger_hull import Face
        >>> from grasp3d.hand.finger_hull import corners_of
        >>> square = np.array([[0, 0], [0.01, 0], [0.01, 0.01], [0.005, 0.01], [0, 0.01]])
        >>> corners_of(Face(np.zeros(3), square))
        [((0.0, 0.0, 0.0), (0.0, 0.01, 0.0), (0.0, 0.01, 0.01), (0.0, 0.0, 0.01))]
    """
    points = Face(face.plane, without_flat_corners(face.outline, STANDS_OUT)).corners
    points[:, 0] = np.minimum(points[:, 0], 0.0)
    corners = [(float(x), float(y), float(z)) for x, y, z in points.round(DIGITS) + 0.0]
    step = MOST_CORNERS - 2
    starts = range(1, len(corners) - 1, step)
    return [(corners[0], *corners[start : start + step + 1]) for start in starts]


def thickness_at_tcp(finger: Floats) -> float:
    """Size of a finger (n, 3, 3) along x at z = 0, behind x = 0; 0: nothing is there [m]."""
    points = points_beyond(finger, 0.0)
    section = points[points[:, 2] < 10.0**-DIGITS]
    return round(float(-section[:, 0].min()), DIGITS) if len(section) else 0.0
