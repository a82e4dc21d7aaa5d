"""Meshes of simple solids."""

import math

import numpy as np
import pytest

from grasp3d.mesh.primitives import box_mesh, cylinder_mesh, sphere_mesh


@pytest.mark.slow
def test_solids_are_closed_and_have_their_size() -> None:
    for mesh, volume, edge in (
        (sphere_mesh(2.0, subdivisions=4), 4.0 / 3.0 * math.pi * 8.0, math.inf),
        (box_mesh((1.0, 2.0, 3.0), max_edge=0.5), 6.0, 0.5),
        (cylinder_mesh(0.5, 2.0, max_edge=0.1), math.pi * 0.25 * 2.0, 0.1),
    ):
        assert mesh.report.closed
        assert mesh.volume == pytest.approx(volume, rel=0.01)
        assert mesh.center_mass == pytest.approx(np.zeros(3), abs=1e-9)
        assert not mesh.report.repairs
        corners = mesh.vertices[mesh.faces]
        lengths = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
        assert lengths.max() <= edge * (1.0 + 1e-9)
    lying = cylinder_mesh(1.0, 3.0)
    assert np.ptp(lying.vertices, axis=0) == pytest.approx((3.0, 2.0, 2.0), rel=1e-3)
    assert len(lying.vertices) < 100_000
