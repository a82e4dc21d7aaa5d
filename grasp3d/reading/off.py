"""Normalisation of OFF files for trimesh: without comments, faces of at most four corners."""

from itertools import pairwise

from grasp3d.errors import MeshError
from grasp3d.reading.declared_sizes import OFF_HEADER, off_counts, without_comments
from grasp3d.reading.obj import MOST_CORNERS
from grasp3d.reading.sources import Source


def plain_off(source: Source, data: bytes) -> bytes:
    """Return an OFF without comments and with faces of at most four corners.

    trimesh reads comments as data, and reads no larger faces: they become triangle fans.

    Raises:
        MeshError: A face has fewer corners than it declares.
    """
    vertices, faces = off_counts(source)
    data = without_comments(data)
    header = OFF_HEADER.match(data)
    data = data[header.end() if header else 0 :]
    start, lines = vertices, [line for line in data.splitlines() if line.strip()]
    kept: list[bytes] = []
    for number, line in enumerate(lines[start : start + faces]):
        words = line.split()
        count = int(words[0]) if words[0].isdigit() else 0
        if not 3 <= count < min(len(words), MOST_CORNERS + 1):
            text = line.decode("utf-8", "replace")[:40]
            raise MeshError(
                f"{source.where}: face {number} ({text!r}) does not have the corners that it "
                f"declares, of which 3 to {MOST_CORNERS:,} are allowed; export the mesh again"
            )
        if count <= 4:
            kept.append(line)
        else:
            first, *rest = words[1 : count + 1]
            kept += [b"3 %s %s %s" % (first, a, b) for a, b in pairwise(rest)]
    head = b"OFF\n%d %d 0" % (vertices, len(kept))
    return b"\n".join([head, *lines[:start], *kept])
