"""Bad input of every command: one line that says what would be right, and nothing is written."""

import json
from pathlib import Path

import pytest

from grasp3d.hand.hand_files import write_hand
from tests.helpers import shapes
from tests.helpers.commands import export, printed, refusal
from tests.helpers.grippers import HAND

REFUSED = """
paper -o x --object missing.stl | missing.stl: there is no such file
label . | is a folder
label ball.ply --friction 0.6..0.4 | an interval of two, the smallest first
label ball.ply --sensor-resolution 0.39 | 0.39 degrees: write 0.39deg for that, or 0.39rad
label ball.ply --friction 50 | that of rubber is some 2; got 50: is 0.5 meant?
label x --gripper franka | grasp3d label has no option --gripper; did you mean --hand?
label x --mu 0.5 | did you mean --friction?
label ball.ply --max-opening 70km | --max-opening must be a length: a number | (m, cm, mm, in)
label ball.ply -o ball.ply | is read by
label box.stl --unit mm --at 0,0,90mm | at 0.0,0.0,90 mm is 50 mm from the surface of box.stl, more
label ball.ply --hand franka --best 1 --pose-error 5,3deg | must be from 0 to 0.2 m; got 5 m
label box.stl --region ball.ply -o ball.ply --overwrite | is read by
label ball.ply --best 0 | best must be at least 1
label box.stl --max-opening 70mm | is 70 mm, but the unit of box.stl is not known | add --unit mm
label box.stl --hand franka | hands and grippers are given in metres, but the unit of box.stl
label box.stl --unit mm --table as-is | table needs a gripper (--hand
label box.stl --task pushes.csv | torques of the task are in N m, but the unit of box
label ball.ply --region mask.ply:grip | mask.ply: is not a mask of ball.ply, of which vertices are
batch ball.ply -o out --region mask.ply | mask.ply belongs to one mesh; a library takes a box
label box.stl -o notes.ply | notes.ply: exists; name another file, or replace it with --overwrite
label ball.ply --best 1 --grasps notes.csv | notes.csv: exists; name another file
label drawn.stl --best 1 | drawn_grasps.png: exists; name another file
label taken_by.stl | taken_by_labeled.ply: exists; name another file
check ball.ply -o pair.json | pair.json: exists; name another file
hand franka -o hand.json | hand.json: exists; name another file
label box.stl --best 2 --grasps task.csv --task task.csv --overwrite | is read by
label box.stl --unit mm --hand franka --best 2 --frame tool0 | unknown gripper frame
label box.stl --unit mm --best 2 --frame graspgen | frame is for poses of a gripper of two
evaluate box.stl contacts.csv --frame graspgen | contains no poses; frame applies to poses
label box.stl --unit mm --hand franka --best 2 --object-pose 1,0,0,0 --grasps a.h5 | acronym files
label open.stl --strict | the surface is open: inside and outside
evaluate box.stl box.stl | unsupported contacts format .stl: supported are .csv
evaluate box.stl pair.json -o pair.json | pair.json: is read by this command; name another file
evaluate box.stl three.json --fingers 4 | have 3 fingers
evaluate box.stl poses.csv --unit mm | poses need a gripper or hand: give it with --hand NAME
evaluate box.stl poses.csv --unit mm --hand franka --max-distance 1 | max_distance applies to
evaluate box.stl pair.json -o task.csv --task 'weight + task.csv' --overwrite | is read by
evaluate box.stl pair.json -o task_link.csv --task task.csv --overwrite | is read by
validate poses.csv --mesh box.stl --hand franka -o poses.csv | poses.csv: is read by this command
simulate box.stl --unit mm | grasp3d simulate needs --hand; see grasp3d simulate --help
simulate box.stl --unit mm --hand franka --frame acronym | name their file with --grasps
simulate ball.ply --unit mm --hand franka -o link.csv | link.csv: is read by this command; name
sweep | grasp3d sweep needs PATH|SHAPE ... first; see grasp3d sweep --help
sweep circle -o notes.csv | notes.csv: exists; name another file
sweep circle -o figure.csv | figure.svg: exists; name another file
sweep sphere --friction 0.4..0.6 | --friction must be a number; got '0.4..0.6'; or give a range FROM
sweep circle --fingers 3 | closed form for two fingers only; got 3
check ball.ply --max-memory 0.1 | max memory must be at least 0.5 GB
hand --picture a.png | --picture needs a gripper
batch void -o out | no mesh in it
batch nothing://lib -o out | no file system is called nothing://
batch ball.ply -o ball.ply | its folder is a file
view . --screenshot a.png | was not written by grasp3d batch
view bad.ply --screenshot a.png | have no property 'critical_angle'
design --fingertip-radius 8 | fingertip_radius needs a unit, such as 8mm
design --receptive-field 4mm --sensor-resolution 20 | each define the sensor
design --joints 2 --friction 0.5 | --joints needs --friction and a sensor
sweep box.stl --hand finger_length.json | millimetres
"""
"""Words of a command line, and what its error contains."""

USAGE = """
'' | give a command; known: label, check
lable ball.ply | no command is called 'lable'; did you mean label?
--quiet label | no command is called '--quiet'
label | grasp3d label needs FILE first; see grasp3d label --help
label x y | 'y' is one too many: grasp3d label takes FILE
label x --max-opening 80 mm | 'mm' is one too many | its unit without a space, as in 80mm
design mug.stl | 'mug.stl' is one too many: grasp3d design takes options only
label x --frict 1 | grasp3d label has no option --frict; did you mean --friction?
design --friction 0.5 -joints 2 | grasp3d design has no option -joints; did you mean --joints?
sweep circle -Friction 0.5 | has no option -Friction; did you mean --friction?
label x --colour red | no option --colour; all options: grasp3d label --help-all
label x --at | --at needs a value: X,Y,Z
label x --quiet=1 | --quiet takes no value
paper -o x --sensor-resolution | --sensor-resolution needs a value: DEGREES ...
label x --fingers 2.5 | --fingers must be a whole number; got '2.5'
check ball.ply --repair all | --repair must be one of none, safe, full; got 'all'
"""
"""The same of words that are no command, option, value or choice."""

TRIED = """
label ball.ply --hand frank | --hand: no gripper is called 'frank' (did you mean franka?)
label ball.ply --hand missing.json | --hand: missing.json: there is no such file
label ball.ply --hand leap | --hand: leap is a hand with joints, whose links are not shipped
label ball.ply --hand notes.csv | unsupported gripper format .csv
label ball.ply --unit feet | --unit must be one of m, cm, mm, in, guess; got 'feet'
label ball.ply --density 1000 --mass 1 | mass and density exclude each other
label ball.ply --grasps-format acronym | needs the number of best grasps
label ball.ply --best 3 --grasps x.json --grasps-format csv --hand franka | .csv
label ball.ply -o x.PLYS | unsupported format .PLYS
evaluate ball.ply void | void: has no suffix: supported are .csv
evaluate ball.ply pair.json -o x.ply | unsupported table format .ply
validate poses.csv --mesh box.stl -o notes | notes: has no suffix: supported are .csv .parquet
simulate box.stl --grasps poses.csv --hand franka -o x.ply | unsupported pose format .ply
hand franka --tcp 5 | for URDF and MuJoCo files
batch ball.ply -o out --workers 2 --scheduler tcp://x:1 | workers and scheduler exclude each other
view ball.ply --width 10 --screenshot x.png | width must be from 320
"""
"""Wrong inputs that need no mesh: they are refused before one is read."""

WRITING = """
label ball.ply -o @.ply
label ball.ply --best 2 --grasps @.json
label box.stl --unit mm --hand franka --best 2 --grasps @.csv
evaluate box.stl pair.json -o @.csv
validate poses.csv --mesh box.stl --hand franka -o @.csv
simulate box.stl --unit mm --hand franka -o @.csv
batch ball.ply -o @.csv/out
sweep ball.ply -o @.csv
check ball.ply -o @.json
view ball.ply --screenshot @.png
hand franka -o @.json
hand franka --picture @.png
paper --object ball.ply -o @.csv/paper
"""
"""Every option that names an output, where it cannot be written: @ is a place."""

PLACES = ("missing/result", "notes.csv/result", "taken")
"""A folder that is missing, a file as a folder, a folder as a file."""

TAKEN = ("ply", "csv", "svg", "json", "png")
"""Suffixes of folders."""

MINE = ("notes.ply", "notes.csv", "figure.svg", "taken_by_labeled.ply", "drawn_grasps.png")
"""Files that no command has written."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with meshes, grasps and files of other programs, sound ones and damaged ones."""
    folder = tmp_path_factory.mktemp("refused")
    ball = export(folder / "ball.ply", shapes.sphere(2))
    vertices, faces = shapes.box((40.0, 60.0, 80.0))
    export(folder / "box.stl", (vertices, faces))
    export(folder / "open.stl", (vertices, faces[:-2]))
    for name in ("taken_by.stl", "drawn.stl"):
        export(folder / name, (vertices, faces))
    for name in ("void", "leap", *(f"taken.{suffix}" for suffix in TAKEN)):
        (folder / name).mkdir()
    (folder / "link.csv").symlink_to(ball)
    (folder / "task_link.csv").symlink_to("task.csv")
    pair, pose = [[20, 0, 0], [-20, 0, 0]], "0,0,40,1,0,0,0,mm,1"
    faces_of = "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    axes = "".join(f"property float {axis}\n" for axis in "xyz")
    header = f"ply\nformat ascii 1.0\nelement vertex 3\n{axes}"
    corners = "0 0 0 1\n1 0 0 1\n0 1 0 0\n3 0 1 2\n"
    texts = {
        "mask.ply": f"{header}property float grip\n{faces_of}{corners}",
        "bad.ply": f"{header}property uchar label\n{faces_of}{corners}",
        "pair.json": json.dumps([pair]),
        "three.json": json.dumps([[*pair, [0, 30, 0]]]),
        "poses.csv": f"px,py,pz,qx,qy,qz,qw,unit,outcome\n{pose}\n",
        "task.csv": "5,0,0,0,0,0\n",
        "pushes.csv": "fx,fy,fz,tx,ty,tz\n5,0,0,0,0,0.1\n",
        **dict.fromkeys(MINE, "name,price\n"),
    }
    write_hand(folder / "hand.json", HAND)
    hand = json.loads((folder / "hand.json").read_text(encoding="utf-8"))
    texts["finger_length.json"] = json.dumps(hand | {"finger_length": 45.0})
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    return folder


def check_refused(folder: Path, case: str) -> str:
    words, *messages = case.split(" | ")
    error = refusal(words, folder)
    assert all(message in error for message in messages), error
    return error


@pytest.mark.parametrize("case", [*filter(None, (REFUSED + USAGE).splitlines())])
def test_bad_input_is_one_line_and_writes_nothing(folder: Path, case: str) -> None:
    check_refused(folder, case)


@pytest.fixture
def unread(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a mesh that is read, and kernels that are compiled, fail the test."""

    def read(*_: object, **__: object) -> None:
        pytest.fail("work was begun")

    monkeypatch.setattr("grasp3d.mesh.preparing.read_source", read)
    monkeypatch.setattr("grasp3d.paper.writing.solids", read)


@pytest.mark.usefixtures("unread")
@pytest.mark.parametrize("case", TRIED.strip().splitlines())
def test_wrong_input_is_refused_before_the_work(folder: Path, case: str) -> None:
    assert len(check_refused(folder, case)) <= 300


@pytest.mark.usefixtures("unread")
@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("case", WRITING.strip().splitlines())
def test_an_unwritable_output_is_refused_before_the_work(
    folder: Path, case: str, place: str
) -> None:
    if place == "taken" and "/" in case:
        pytest.skip("a folder may be there")
    if place == "missing/result" and case.startswith(("batch ball.ply -o @", "paper")):
        pytest.skip("it makes folders")
    error = refusal(case.replace("@", place), folder)
    assert place.partition("/")[0] in error


def test_an_existing_file_is_replaced_where_that_is_wanted(tmp_path: Path) -> None:
    (tmp_path / "out.csv").write_text("mine", encoding="ascii")
    printed("sweep", "circle", "--friction", "0.5", "-o", "out.csv", "--overwrite", cwd=tmp_path)
    assert (tmp_path / "out.csv").read_text(encoding="utf-8").startswith('"name"')
