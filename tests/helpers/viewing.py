"""Small labelled surfaces, and sessions that have come to rest."""

import time
from functools import cache
from pathlib import Path

import numpy as np

from grasp3d import (
    GraspModel,
    Sampling,
    SurfaceLabels,
    label_surface,
    mesh_from_arrays,
    scan_surface,
)
from grasp3d.viewer.session.album import Album, album_of
from grasp3d.viewer.session.session import Session
from tests.helpers import shapes

PATIENCE = 120.0


@cache
def labels() -> SurfaceLabels:
    """A cone: S, M and U, creases, a tip, and vertices without any grasp."""
    mesh = mesh_from_arrays(*shapes.cone(0.35, sections=24), unit="cm", max_edge=0.2)
    found = label_surface(mesh, GraspModel(friction=0.75), sampling=Sampling(max_opening=0.3))
    assert set(found.label) == {0, 1, 2}
    assert np.isinf(found.critical_angle).any()
    return found


@cache
def box() -> SurfaceLabels:
    return label_surface(mesh_from_arrays(*shapes.box(), max_edge=0.5))


@cache
def hands() -> SurfaceLabels:
    """Grasps of three fingers."""
    mesh = mesh_from_arrays(*shapes.sphere(1), max_edge=9.0)
    return label_surface(mesh, GraspModel(fingers=3), sampling=Sampling(candidates=8))


@cache
def scan(fingers: int = 2) -> SurfaceLabels:
    """The cone with fingers fixed at its side."""
    mesh = labels().mesh
    return scan_surface(mesh, fixed=mesh.vertices[[30, 60, 90][: fingers - 1]])


def settled(album: Album | SurfaceLabels) -> Session:
    """A session that has nothing more to do."""
    session = Session(album if isinstance(album, Album) else album_of(album))
    rest(session)
    return session


def rest(session: Session) -> None:
    end = time.monotonic() + PATIENCE
    while session.working is not None:
        session.poll()
        assert time.monotonic() < end, session.working
        time.sleep(0.002)


def rewritten(path: Path, *changes: tuple[bytes, bytes]) -> Path:
    """A file with some of its bytes replaced."""
    data = path.read_bytes()
    for before, after in changes:
        assert before in data
        data = data.replace(before, after, 1)
    path.write_bytes(data)
    return path
