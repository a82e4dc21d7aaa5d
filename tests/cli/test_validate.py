"""`grasp3d validate`."""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import trimesh

from grasp3d import GraspModel, ParallelGripper, load_mesh
from grasp3d.grasps.evaluation import evaluate_grasps
from grasp3d.grasps.pose_files import read_poses, write_poses
from grasp3d.grasps.poses import GraspPoses
from grasp3d.plots.validation_page import FILES
from grasp3d.system.tables import read_columns
from tests.helpers import shapes
from tests.helpers.commands import printed
from tests.helpers.commands import run_here as grasp3d
from tests.helpers.tried_grasps import poses_on

FRANKA = ParallelGripper.preset("franka")
COUNT, HELD_FROM = 120, -0.1
QUICK = ("--resamples", "100", "--max-edge", "2cm", "--unit", "m")


@cache
def poses(count: int = COUNT) -> tuple[GraspPoses, np.ndarray]:
    """Poses on a smooth body, some of which miss it, and their margins."""
    points, faces = shapes.lopsided(3)
    mesh = load_mesh((0.025 * points, faces), unit="m", max_edge=0.02)
    given = poses_on(mesh, count, 0, 0.075).poses.copy()
    given[:6, :3, 3] += 0.2
    found = evaluate_grasps(mesh, GraspPoses(poses=given), GraspModel(), hand=FRANKA)
    return GraspPoses(poses=given, unit="m", hand="panda"), np.array(found.margin)


def tried(held: np.ndarray) -> GraspPoses:
    return replace(poses(len(held))[0], outcome=held.astype(float))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with body.ply and log.csv; grasps held whose margin is above HELD_FROM."""
    points, faces = shapes.lopsided(3)
    trimesh.Trimesh(0.025 * points, faces, process=False).export(tmp_path / "body.ply")
    write_poses(tmp_path / "log.csv", tried(poses()[1] > HELD_FROM))
    return tmp_path


GIVEN = ("validate", "log.csv", "--mesh", "body.ply", "--hand", "franka", *QUICK)


@pytest.mark.slow
def test_it_prints_how_well_scores_predict(folder: Path) -> None:
    text = printed(*GIVEN, cwd=folder)
    held = int((poses()[1] > HELD_FROM).sum())
    assert f"120 grasps with an outcome on 1 object: {held} held" in text
    assert "gripper franka, as given; mass not known" in text
    assert "the jaws do not close on the mesh: labelled U, with the worst value" in text
    assert re.search(r"margin +larger +1\.000 1\.000-1\.000 +1\.000 1\.000-1\.000", text)
    assert "100 resamples (seed 0) of the grasps; they hold for this object" in text
    assert re.search(r"0\.5 +22\.6° +100\.0 % \d+-100 +\d+ ", text)
    assert "best threshold" in text
    assert {path.name for path in folder.iterdir()} == {"body.ply", "log.csv"}
    assert grasp3d(*GIVEN, cwd=folder).stdout == text
    narrow = grasp3d(*GIVEN, cwd=folder, columns=80).stdout
    assert "…" not in narrow


def test_options_choose_the_grid_the_seed_and_the_model(folder: Path) -> None:
    words = ("--frictions", "0.4", "--sensor-resolutions", "0:20:10", "--seed", "7", "--worst", "1",
             "--friction", "0.8", "--mass", "20g", "--bins", "4", "--target", "0.5")  # fmt: skip
    text = printed(*GIVEN, *words, cwd=folder)
    assert "labels, margins and forces at μ 0.8, α 22.6°" in text
    rows = re.findall(r"^0\.4 +(\S+)° ", text, re.MULTILINE)
    assert rows == ["0", "10", "20"]
    assert "seed 7" in text
    assert "grip force" in text
    assert "mass 20 g, as given" in text
    assert len(re.findall(r"^-?\d+\.\d° to", text, re.MULTILINE)) == 4
    assert "50 % of the accepted grasps held" in text
    assert len(re.findall(r"^  grasp \d+:", text, re.MULTILINE)) <= 3


@pytest.mark.slow
def test_the_report_is_written_again_but_replaces_no_other_file(folder: Path) -> None:
    for _ in range(2):
        assert printed(*GIVEN, "-o", "out", "-q", "--worst", "0", cwd=folder) == ""
    assert {path.name for path in (folder / "out").iterdir()} == set(FILES)
    table = read_columns(folder / "out" / "grasps.csv")
    np.testing.assert_array_equal(table["success"], poses()[1] > HELD_FROM)
    for name in FILES:
        (folder / "out" / name).write_text("mine")
        done = grasp3d(*GIVEN, "-o", "out", cwd=folder)
        assert done.returncode == 2
        assert f"{name}: exists; name another file" in done.stderr
        (folder / "out" / name).unlink()


def test_the_mesh_is_looked_up_in_the_scale_that_is_stated(folder: Path) -> None:
    in_mm = trimesh.load_mesh(folder / "body.ply", process=False).apply_scale(1000.0)
    (folder / "meshes" / "deep").mkdir(parents=True)
    in_mm.export(folder / "meshes" / "deep" / "body.ply")
    (folder / "body.ply").unlink()
    stated = replace(tried(poses()[1] > HELD_FROM), object_file="any/body.ply", object_scale=0.001)
    write_poses(folder / "log.json", stated)
    given = ("validate", "log.json", "--resamples", "100", "--max-edge", "20")
    text = printed(*given, "--meshes", "meshes", cwd=folder)
    assert "gripper franka, as the file states (panda)" in text
    assert re.search(r"margin +larger +1\.000 ", text)
    done = grasp3d(*given, cwd=folder)
    assert done.returncode == 2
    assert "log.json: names the mesh 'any/body.ply', which is not beside it in" in done.stderr
    assert "--meshes FOLDER" in done.stderr


@pytest.mark.slow
def test_acronym_needs_no_options(tmp_path: Path) -> None:
    import h5py

    name = "Mug_10f6e09036350e92b3f21f1137c3c347_0.0002682457830986903.h5"
    mug = shapes.shared("datasets", "acronym", name)
    with h5py.File(mug) as file, h5py.File(tmp_path / "mug.h5", "w") as part:
        file.copy("object", part)
        file.copy("gripper", part)
        for field in ("grasps/transforms", "grasps/qualities/flex/object_in_gripper"):
            part[field] = file[field][:80]
    folder = ("--meshes", mug.parent)
    text = printed("validate", "mug.h5", *folder, "--resamples", "100", cwd=tmp_path)
    assert "80 grasps with an outcome on 1 object: " in text
    assert (
        "gripper franka, as the file states (panda); mass 13.1 g, as the file states; centre of "
        "mass as the file states"
    ) in text


def with_columns(folder: Path, **columns: np.ndarray) -> Path:
    """A log without outcomes of its own, with other columns."""
    given = replace(poses()[0], columns=columns)
    write_poses(folder / "other.csv", given)
    return folder / "other.csv"


@pytest.mark.slow
def test_outcomes_are_those_that_are_named(folder: Path) -> None:
    held = poses()[1] > HELD_FROM
    with_columns(folder, stayed=np.where(held, "True", "false"), fell=1.0 - held)
    given = ("validate", "other.csv", *GIVEN[2:])
    found = printed(*given, "--outcome", "stayed", cwd=folder)
    assert found.startswith("120 grasps with an outcome (stayed) on 1 object: ")
    own = printed(*GIVEN, cwd=folder)
    assert found.replace(" (stayed)", "").replace("other.csv", "log.csv") == own
    write = ("evaluate", "body.ply", "other.csv", "--hand", "franka", "--unit", "m", "-q")
    printed(*write, "--outcome", "fell", "-o", "out.csv", cwd=folder)
    np.testing.assert_array_equal(read_columns(folder / "out.csv")["outcome"], ~held)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            None,
            "other.csv: no outcome is known of any grasp; a table needs .* named with --outcome",
        ),
        ("held", "other.csv: no outcome is called 'held': its grasps have .*, fate, fall_time\n"),
        ("fate", r"other.csv: grasp 1: fate must be 1 or true \(it held\), .* got 'fell'"),
        ("fall_time<1", "other.csv: no outcome is called 'fall_time<1'"),
    ],
)
def test_outcomes_that_are_none_are_refused(folder: Path, text: str | None, message: str) -> None:
    with_columns(folder, fate=np.full(COUNT, "fell"), fall_time=np.zeros(COUNT))
    before = set(folder.iterdir())
    given = ("validate", "other.csv", *GIVEN[2:], "-o", "out")
    done = grasp3d(*given, *(() if text is None else ("--outcome", text)), cwd=folder)
    assert done.returncode == 2
    assert re.search(message, done.stderr)
    assert done.stderr.strip().count("\n") == 0
    assert set(folder.iterdir()) == before


def test_values_that_are_all_the_same_are_no_outcomes(folder: Path) -> None:
    """A file's own outcomes may be: then there is a warning."""
    path = with_columns(folder, fell=np.zeros(COUNT), stayed=np.ones(COUNT))
    given = ("validate", "other.csv", *GIVEN[2:])
    for name, became in (("fell", "failed"), ("stayed", "held")):
        done = grasp3d(*given, "--outcome", name, "-o", "out", cwd=folder)
        assert done.returncode == 2
        assert f"the outcome '{name}' all 120 grasps {became}, so no score" in done.stderr
        assert not (folder / "out").exists()
    write_poses(path, replace(read_poses(path), outcome=0.0))
    done = grasp3d(*given, cwd=folder)
    assert done.returncode == 0
    assert "other.csv: all 120 grasps failed, so no score can be ranked" in " ".join(
        (done.stdout + done.stderr).split()
    )


@pytest.mark.slow
def test_light_and_heavy_grasps_are_one_run(folder: Path) -> None:
    held, masses = poses()[1] > HELD_FROM, np.where(np.arange(COUNT) % 2, "30 g", "1.2kg")
    write_poses(folder / "both.csv", replace(tried(held), columns={"object_mass": masses}))
    given = ("validate", "both.csv", *GIVEN[2:], "--worst", "1")
    text = printed(*given, "-o", "out", cwd=folder)
    assert "mass 30 g to 1.2 kg, by the column object_mass;" in text
    assert re.search(r"^label with force +larger ", text, re.MULTILINE)
    table = read_columns(folder / "out" / "grasps.csv")
    assert set(table["mass"].tolist()) == {0.03, 1.2}
    assert "mass 50 g, as given;" in printed(*given, "--mass", "50g", cwd=folder)
    masses[[2, 5]] = ["", "-3 g"]
    for problem in ("grasp_3 has no object_mass, which", "object_mass of grasp_6 must be finite"):
        write_poses(folder / "both.csv", replace(tried(held), columns={"object_mass": masses}))
        done = grasp3d(*given, "-o", "new", cwd=folder)
        assert done.returncode == 2
        assert f"both.csv: {problem}" in done.stderr
        assert done.stderr.strip().count("\n") == 0
        masses[2] = "1 kg"
    assert not (folder / "new").exists()


@pytest.mark.slow
def test_scores_are_compared_and_reasons_are_a_line_each(folder: Path) -> None:
    text = printed(*GIVEN, "--friction", "0.2", "--sensor-resolution", "0", cwd=folder)
    table = r"^robust score less +ROC-AUC, 95 %, paired +p\n((?:.*\n)*?)μ "
    heads = re.search(table, text, re.MULTILINE)
    assert heads is not None
    rows = [re.split(r"  +", line) for line in heads[1].splitlines()]
    assert [row[0] for row in rows[:3]] == ["patch payload", "pad margin", "success probability"]
    assert {len(row) for row in rows} == {3}
    assert all(re.fullmatch(r"[-+]0\.\d{3} [-+]0\.\d{3} to [-+]0\.\d{3}", row[1]) for row in rows)
    ((count, listed),) = re.findall(
        r"^held, though U: (\d+) grasps\n((?:  .*\n)+)", text, re.MULTILINE
    )
    held = poses()[1] > HELD_FROM
    assert 0 < int(count) < held.sum()
    reasons = re.findall(r"^  ([\d,]+) ([^:]+): .*; grasps? \d+", listed, re.MULTILINE)
    assert len(reasons) == listed.count("\n") == len({name for _, name in reasons})


@pytest.mark.slow
def test_warnings_that_files_share_are_one_line(folder: Path) -> None:
    body = trimesh.load_mesh(folder / "body.ply", process=False)
    body.update_faces(np.arange(len(body.faces)) >= 200)
    for number in range(7):
        body.export(folder / f"{number}.ply")
        part = tried(poses()[1] > HELD_FROM).take(np.arange(15 * number, 15 * number + 15))
        stated = replace(part, object_file=f"{number}.ply", settings={"mass": 0.1}, hand="panda")
        write_poses(folder / f"{number}.json", stated)
    files = [f"{number}.json" for number in range(7)]
    text = printed("validate", *files, *QUICK, "--mass", "100g", "-o", "out", cwd=folder)
    assert text.count("is open, and no centre of mass is stated") == 1
    named = "(and the like in 7 files: 0.json, 1.json, 2.json, 3.json, 4.json, ...)"
    assert named in " ".join(text.split())
    assert "mass 100 g, as given; centre of mass not known, as the mesh is open: the middle" in text
    assert re.search(
        r"ROC-AUC of the robust score by object: \d\.\d+ \(\d\.ply\) to \d\.\d+ ", text
    )
    assert re.search(r"precision, 95 % +by object$", text, re.MULTILINE)
    assert len(read_columns(folder / "out" / "objects.csv")["mesh"]) == 7


def test_a_missing_library_is_named_with_its_extra(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in ("acronym", "documents"):
        monkeypatch.setattr(f"grasp3d.grasps.pose_files.{module}.find_spec", lambda _: None)
    for name, library in (("a.h5", "h5py"), ("a.yaml", "PyYAML")):
        (folder / name).write_bytes(b"\x89HDF\r\n\x1a\n")
        done = grasp3d("validate", name, *GIVEN[2:], cwd=folder)
        assert done.returncode == 2
        assert f"needs {library}: pip install 'grasp3d[datasets]'" in done.stderr
