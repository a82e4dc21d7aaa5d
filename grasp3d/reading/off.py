"""The text of an OFF, cleared of comments, its faces checked, and many corners cut to few."""

import re
from itertools import pairwise

from grasp3d.errors import MeshError
from grasp3d.reading.obj import MOST_CORNERS
from grasp3d.reading.promises import off_counts
from grasp3d.reading.sources import Source


def plain_off(source: Source, data: bytes) -> bytes:
    """Strip comments, which trimesh takes for lines of data, and cut polygons into fans.

    It reads triangles and quads, but no larger faces among them.

    Raises:
        MeshError: A face has fewer corners than it promises.
    """
    vertices, faces = off_counts(source)
    if b"#" in data:
        data = re.sub(rb"#[^\r\n]*", b"", data)
    lines = [line for line in data.splitlines() if line.strip()]
    start = vertices + (1 if len(lines[0].split()) > 1 else 2)
    kept: list[bytes] = []
    for number, line in enumerate(lines[start : start + faces]):
        words = line.split()
        count = int(words[0]) if words[0].isdigit() else 0
        if not 3 <= count < min(len(words), MOST_CORNERS + 1):
            text = line.decode("utf-8", "replace")[:40]
            raise MeshError(
                f"{source.where}: face {number} ({text!r}) has not the corners that it promises, "
                f"of which 3 to {MOST_CORNERS:,} are read; export the mesh again"
            )
        if count <= 4:
            kept.append(line)
        else:
            first, *rest = words[1 : count + 1]
            kept += [b"3 %s %s %s" % (first, a, b) for a, b in pairwise(rest)]
    head = b"OFF\n%d %d 0" % (vertices, len(kept))
    return b"\n".join([head, *lines[start - vertices : start], *kept])
