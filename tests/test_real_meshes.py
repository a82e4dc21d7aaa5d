"""Scanned, modelled and malformed meshes, which are not part of the repository."""

import csv
import json
import subprocess
import sys
from pathlib import Path

import manifold3d
import numpy as np
import pytest
import trimesh

from grasp3d import GraspModel, Sampling, label_surface, load_mesh
from grasp3d.mesh.mesh_files import read_mesh
from tests.helpers import shapes

REAL = sorted(
    path.name for path in shapes.SHARED.glob("meshes/*") if path.suffix not in {".csv", ".md"}
)


@pytest.fixture(params=REAL or [""])
def path(request: pytest.FixtureRequest) -> Path:
    return shapes.shared("meshes", request.param)


@pytest.mark.slow
def test_a_real_mesh_is_labelled(path: Path) -> None:
    mesh = load_mesh(path)
    labels = label_surface(mesh, GraspModel(friction=0.5), sampling=Sampling(rays=16))
    assert len(labels.label) == len(mesh.vertices) >= mesh.file_vertices
    fractions = labels.fractions()
    assert sum(fractions.values()) == pytest.approx(1.0)
    # All of them are objects that can be grasped somewhere.
    assert fractions["S"] > 0.2
    assert fractions["U"] < 0.3
    found = labels.reason == 0
    assert found.mean() > 0.9
    assert np.isfinite(labels.partners[found]).all()


OPEN = {"classic_stanford_bunny.obj", "classic_teapot.obj", "kit_Sprayflask_800.obj",
        "kit_Wineglass_800.obj"}  # fmt: skip
"""Meshes with holes that safe repair does not close."""

REFUSED = {*OPEN, "adv_vase.obj"}
"""Meshes that Manifold rejects without repair; the vase has an inconsistent orientation."""


def solid_of(points: np.ndarray, faces: np.ndarray) -> manifold3d.Manifold:
    """Solid of a surface in Manifold, with its bodies united."""
    mesh = manifold3d.Mesh64(np.array(points, order="C"), faces.astype(np.uint64))
    mesh.merge()
    solid = manifold3d.Manifold(mesh)
    assert solid.status() == manifold3d.Error.NoError
    return manifold3d.Manifold.batch_boolean(solid.decompose(), manifold3d.OpType.Add)


@pytest.mark.slow
def test_volume_and_centre_of_mass_agree_with_manifold_and_trimesh(path: Path) -> None:
    """Manifold makes a solid of the unrepaired file, and trimesh computes its mass properties."""
    mesh = load_mesh(path, max_edge=1e9, repair="full" if path.name in OPEN else "safe")
    assert mesh.report.closed
    raw = read_mesh(path)
    points = (mesh.file_scale * raw.vertices - mesh.center) / mesh.size
    if path.name in REFUSED:
        solid = solid_of(mesh.normalized, mesh.faces)
    else:
        inward = trimesh.Trimesh(points, raw.faces, process=False).volume < 0.0
        solid = solid_of(points, raw.faces[:, ::-1] if inward else raw.faces)
    assert mesh.volume == pytest.approx(solid.volume() * mesh.size**3, rel=0.01)
    united = solid.to_mesh64()
    mass = trimesh.Trimesh(
        np.asarray(united.vert_properties)[:, :3], np.asarray(united.tri_verts), process=False
    ).mass_properties
    found = (mesh.center_mass - mesh.center) / mesh.size
    assert np.linalg.norm(mass.center_mass - found) < 0.01


LABEL_ALL = """
import json, re, resource, sys, time
from pathlib import Path
# The largest size begins with that of the process that started this one: count from here.
Path("/proc/self/clear_refs").write_text("5")
from grasp3d import GraspError, GraspModel, Sampling, label_surface, load_mesh
from grasp3d.system.limited_reading import limited_reading
for name in sys.argv[1:]:
    started, row = time.monotonic(), {}
    try:
        with limited_reading():
            mesh = load_mesh(name)
        repairs = [step.message for step in mesh.report.repairs]
        row = {"warnings": mesh.report.warnings, "repairs": repairs}
        mesh = load_mesh(mesh, max_edge=mesh.size / 5.0)
        row["fractions"] = label_surface(mesh, GraspModel(), sampling=Sampling(rays=8)).fractions()
    except GraspError as error:
        row["error"] = str(error)
    print(json.dumps({"file": Path(name).name, "seconds": time.monotonic() - started, **row}))
print(re.search(r"VmHWM:\\s+(\\d+)", Path("/proc/self/status").read_text())[1])
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
"""
ACCEPTED = {"tiny_1e-9.obj", "double_sided_triangle.off"}
"""Files that are accepted although the manifest suggests an error: the scale does not matter, and a
sheet has a warning."""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="the unit of ru_maxrss is that of Linux")
def test_a_malformed_file_is_labelled_or_rejected_with_one_line() -> None:
    with shapes.shared("hostile", "manifest.csv").open(encoding="utf-8") as stream:
        expected = {row["file"]: row["suggested_expectation"] for row in csv.DictReader(stream)}
    paths = [str(shapes.shared("hostile", name)) for name in expected]
    done = subprocess.run(
        [sys.executable, "-c", LABEL_ALL, *paths], check=True, capture_output=True, text=True
    )
    assert done.stderr == ""
    *lines, own, readers = done.stdout.splitlines()
    assert max(int(own), int(readers)) < 3_000_000  # kB
    for row in map(json.loads, lines):
        suggested = expected.pop(row["file"])
        error = row.get("error", "")
        assert row["seconds"] < 40.0, row
        assert error.isprintable()
        assert bool(error) == (suggested.startswith("reject") and row["file"] not in ACCEPTED), row
        if not error:
            assert sum(row["fractions"].values()) == pytest.approx(1.0)
        if suggested == "load without complaint":
            assert row["warnings"] == []
            assert set(row["repairs"]) <= {"joined to an earlier one at the same position"}
        if row["file"] == "double_sided_triangle.off":
            assert "encloses no volume" in row["warnings"][0]
    assert expected == {}
