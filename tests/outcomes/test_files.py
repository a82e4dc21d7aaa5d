"""Files of grasps with outcomes: gripper, mesh, mass and centre of mass."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from grasp3d import Load, MeshOptions, ParallelGripper
from grasp3d.errors import ContactError, MeshError, SettingError
from grasp3d.formats import write_grasps
from grasp3d.formats.poses import GraspPoses
from grasp3d.outcomes.tried_grasps import (
    GIVEN,
    STATED,
    MeshFolder,
    StatedObject,
    check_grasps,
    stated_object,
)

FRANKA = ParallelGripper.preset("franka")
ABOVE = np.diag([1.0, -1.0, -1.0, 1.0])


def poses(**fields: object) -> GraspPoses:
    given = {"poses": np.array([ABOVE, ABOVE]), "outcome": [1.0, 0.0], "unit": "m", **fields}
    return GraspPoses(**given)  # type: ignore[arg-type]


def mass(found: StatedObject) -> float:
    (one,) = set(found.masses.tolist())
    return float(one)


@pytest.fixture
def box(tmp_path: Path) -> Path:
    path = tmp_path / "box.stl"
    trimesh.creation.box([60.0, 40.0, 20.0]).export(path)
    return path


def test_meshes_are_found_by_path_then_by_name(tmp_path: Path) -> None:
    folder, grasps = tmp_path / "meshes", tmp_path / "log" / "a.h5"
    for name in ("meshes/Mug/one.obj", "meshes/Cup/two.obj", "log/three.obj", "log/Mug/four.obj"):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("o")
    lookup = MeshFolder(folder)
    for stated, expected in {
        "Mug/one.obj": "meshes/Mug/one.obj",
        "meshes/Elsewhere/two.obj": "meshes/Cup/two.obj",
        "meshes\\Mug\\one.obj": "meshes/Mug/one.obj",
        "any/three.obj": "log/three.obj",
        "Mug/four.obj": "log/Mug/four.obj",
        "/a/b/one.obj": "meshes/Mug/one.obj",
        "../../meshes/Mug/one.obj": "meshes/Mug/one.obj",
    }.items():
        assert lookup.find(stated, grasps) == tmp_path / expected
    beside = MeshFolder(None)
    assert beside.find("three.obj", grasps) == tmp_path / "log/three.obj"
    with pytest.raises(
        MeshError, match=r"'one.obj', which is not beside it in .*log \(--meshes FOLDER"
    ):
        beside.find("one.obj", grasps)
    with pytest.raises(MeshError, match=r"not beside it in .* nor below .*meshes: give the file"):
        lookup.find("five.obj", grasps)
    with pytest.raises(MeshError, match=r"names no mesh file of its object; give it with --mesh"):
        lookup.find(None, grasps)
    (tmp_path / "secret.obj").write_text("o")
    for outside in ("../secret.obj", str(tmp_path / "secret.obj")):
        with pytest.raises(MeshError, match="which is not beside"):
            beside.find(outside, grasps)


def test_the_gripper_is_given_stated_or_known(tmp_path: Path, box: Path) -> None:
    wsg = ParallelGripper.preset("wsg50")

    def used(path: Path, given: ParallelGripper | None = None) -> tuple[str, str]:
        (tried,) = check_grasps([path], mesh=box, hand=given)
        return tried.hand.name, tried.hand_from

    own = replace(wsg, name="own")
    write_grasps(tmp_path / "own.json", poses(hand=own))
    assert used(tmp_path / "own.json") == ("own", "as the file states")
    assert used(tmp_path / "own.json", FRANKA) == ("franka", "as given")
    write_grasps(tmp_path / "named.json", poses(hand="panda"))
    assert used(tmp_path / "named.json") == ("franka", "as the file states (panda)")
    write_grasps(tmp_path / "none.csv", poses())
    with pytest.raises(SettingError, match=r"none.csv: states no gripper; give it with --hand"):
        used(tmp_path / "none.csv")
    write_grasps(tmp_path / "odd.json", poses(hand="odd"))
    with pytest.raises(SettingError, match=r"odd.json: states the gripper 'odd', unknown; give"):
        used(tmp_path / "odd.json")


def test_grasps_that_were_not_tried_are_left_out(tmp_path: Path, box: Path) -> None:
    path = tmp_path / "a.csv"
    four = GraspPoses(poses=np.tile(ABOVE, (4, 1, 1)), outcome=[np.nan, 1.0, np.nan, 0.0], unit="m")
    write_grasps(path, four)
    (tried,) = check_grasps([path], mesh=box, hand=FRANKA)
    assert tried.not_tried == 2
    assert tried.numbers.tolist() == [2, 4]
    assert tried.poses.outcome.tolist() == [1.0, 0.0]
    write_grasps(path, replace(four, outcome=np.full(4, np.nan)))
    with pytest.raises(ContactError, match=r"a.csv: no outcome is known of any grasp; a table ne"):
        check_grasps([path], mesh=box, hand=FRANKA)
    with pytest.raises(ContactError, match="name at least one file"):
        check_grasps([])
    with pytest.raises(ContactError, match="there is no such file"):
        check_grasps([tmp_path / "b.csv"], mesh=box)
    with pytest.raises(SettingError, match="need the mesh of their object"):
        check_grasps([poses()], hand=FRANKA)


def test_what_a_file_states_of_its_object_is_used(box: Path) -> None:
    stated = poses(object_scale=0.001, settings={"mass": 0.2, "com": [0.01, 0.0, 0.002]})
    found = stated_object(box, stated, None, None)
    assert found.mesh.unit == "m"
    assert found.mesh.size == pytest.approx(0.0748, abs=1e-4)
    assert found.mesh.center_mass == pytest.approx([0.01, 0.0, 0.002])
    assert (mass(found), found.mass_from, found.center_from) == (0.2, STATED, STATED)
    in_mm = stated_object(box, stated, MeshOptions(unit="mm"), Load(mass="50 g"))
    assert in_mm.mesh.center_mass == pytest.approx([0.01, 0.0, 0.002])
    assert (mass(in_mm), in_mm.mass_from) == (0.05, GIVEN)
    given = stated_object(box, stated, MeshOptions(unit="mm", center_of_mass="1mm,0,0"), None)
    assert given.mesh.center_mass == pytest.approx([0.001, 0.0, 0.0])
    assert given.center_from == GIVEN
    bare = stated_object(box, poses(object_scale=0.001), None, None)
    assert np.isnan(bare.masses).all()
    assert bare.load is None
    assert bare.sources == (
        "mass not known, so no grip force (give it with --mass); centre of mass of the volume, at "
        "uniform density"
    )
    dense = stated_object(box, stated, MeshOptions(unit="mm"), Load(density=1000.0))
    assert mass(dense) == pytest.approx(0.048)
    for center in ([0.0, 1.0, 0.0], [0.0, 0.0], "above", [0.0, 0.0, np.nan]):
        elsewhere = poses(object_scale=0.001, settings={"com": center})
        with pytest.raises(ContactError, match=r"must be three numbers \[m\] near box.stl: is it"):
            stated_object(box, elsewhere, None, None)
    with pytest.raises(SettingError, match=r"the unit of box\.stl is not known"):
        stated_object(box, poses(), None, None)


def test_an_open_mesh_keeps_its_mass(tmp_path: Path) -> None:
    open_box = trimesh.creation.box([0.06, 0.04, 0.02])
    open_box.update_faces(np.arange(12) >= 1)
    open_box.export(tmp_path / "open.stl")

    def found(load: Load | None = None, **fields: object) -> StatedObject:
        return stated_object(tmp_path / "open.stl", poses(**fields), MeshOptions(unit="m"), load)

    stated = found(settings={"mass": 0.2})
    surface = "centre of mass not known, as the mesh is open: the middle of its surface"
    assert stated.sources == f"mass 0.2 kg, as the file states; {surface}"
    forced = found(Load(grip_force=40.0))
    assert "mass not known, so forces are for 1 kg" in forced.sources
    assert forced.load == Load(grip_force=40.0)
    bare = found()
    assert bare.load is None
    assert surface in bare.sources
    np.testing.assert_array_equal(stated.mesh.center_mass, bare.mesh.center_mass)
    own = found(settings={"mass": 0.2, "com": [0.0, 0.0, 0.003]})
    assert (mass(own), own.center_from) == (0.2, STATED)
    given = found(Load(mass=0.1), settings={"mass": 0.2})
    assert (mass(given), given.mass_from) == (0.1, GIVEN)
    with pytest.raises(SettingError, match=r"open\.stl: is open, so a density gives no mass"):
        found(Load(density=1000.0))


def test_masses_are_those_of_a_column(box: Path) -> None:
    def found(values: list[object], load: Load | None = None, **settings: object) -> StatedObject:
        own = poses(object_scale=0.001, columns={"mass": np.array(values)}, settings=settings)
        return stated_object(box, own, None, load)

    both = found([2.0, 0.5], mass=0.2)
    assert (both.mass_from, both.masses.tolist()) == ("by the column mass", [2.0, 0.5])
    parts = [(rows.tolist(), load) for rows, load in both.parts(np.arange(2))]
    assert parts == [([1], Load(mass=0.5)), ([0], Load(mass=2.0))]
    forced = Load(grip_force=40.0)
    assert [load for _, load in found(["500 g", "2"], forced).parts(np.arange(2))] == [
        Load(mass=0.5, grip_force=40.0), Load(mass=2.0, grip_force=40.0)
    ]  # fmt: skip
    assert mass(found([2.0, 0.5], Load(mass=0.1))) == 0.1
    empty = found([np.nan, np.nan], mass=0.2)
    assert (mass(empty), empty.mass_from) == (0.2, STATED)
    assert "mass 0.5 to 2 kg, by the column mass; " in both.sources
    with pytest.raises(ContactError, match="mass of grasp_2 must be finite and above 0"):
        found([2.0, np.nan])
    with pytest.raises(ContactError, match=r"mass of grasp_1 must be finite and above 0 \[kg\]"):
        found([-2.0, 1.0])
    with pytest.raises(ContactError, match=r"mass of grasp_2 must be a number \[kg\], or a numb"):
        found(["1", "heavy"])
