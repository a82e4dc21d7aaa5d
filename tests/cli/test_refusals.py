"""Bad input of every command: one line that says what would be right, and nothing is written."""

import json
from pathlib import Path

import pytest

from grasp3d.hand.hand_files import write_hand
from tests.helpers import shapes
from tests.helpers.commands import export, refusal, run_process
from tests.helpers.grippers import HAND

REFUSED = """
paper -o x --object missing.stl | missing.stl: there is no such file
label . | is a folder
label empty.stl | the file is empty
label prose.stl | cannot be read as STL: its triangles are complete neither
label nan.off | not a finite number
label ball.ply --friction 0 | friction must be a finite number above 0
label ball.ply --friction 0.6..0.4 | the smallest first
label ball.ply --friction 0.6..0.4 | an interval of two, the smallest first
label ball.ply --sensor-resolution 180 | below 180 degrees
label ball.ply --sensor-resolution 0.39 | 0.39 degrees: write 0.39deg for that, or 0.39rad
label ball.ply --friction 50 | that of rubber is some 2; got 50: is 0.5 meant?
label ball.ply --friction 0.4..60 | got 0.4..60: is 0.6 meant?
label x --gripper franka | grasp3d label has no option --gripper; did you mean --hand?
label x --mu 0.5 | did you mean --friction?
label x --weight 0.2kg | did you mean --mass?
label ball.ply --location-error '1 furlong' | --location-error must be a length: a number
label ball.ply --max-opening 70km | --max-opening must be a length: a number | (m, cm, mm, in)
label ball.ply -o x.docx | unsupported format .docx: supported are .ply
label ball.ply -o no/where.ply | cannot be written
label ball.ply -o ball.ply | is read by
label ball.ply --at 0,0 | at must be 3 finite lengths | got '0,0'
label box.stl --unit mm --at 0,0,90mm | at 0.0,0.0,90 mm is 50 mm from the surface of box.stl, more
label ball.ply --hand franka --best 1 --pose-error 5,3deg | must be from 0 to 0.2 m; got 5 m
label ball.ply --hand franka --best 1 --pose-error 5mm, | a pose error must be a length
label box.stl --unit mm --hand hand.json --best 2 --grasps hand.json --overwrite | is read by
label box.stl --region ball.ply -o ball.ply --overwrite | is read by
label box.stl --task named.csv | line 3: give force [N] and torque [N m] as 6 finite numbers
label ball.ply --best 0 | best must be at least 1
label box.stl --max-opening 70mm | is 70 mm, but the unit of box.stl is not known | add --unit mm
label box.stl --unit mm --max-opening 70 | is 70 m, 650 times the size of box.stl, 0.1077 m: if
label box.stl --hand franka | hands and grippers are given in metres, but the unit of box.stl
label box.stl --unit mm --hand franka --table stable --up y | up does not
label box.stl --unit mm --table as-is | applies to grippers only
label box.stl --unit mm --hand franka --fingers 3 | gripper 'franka' has two fingers, not 3
label box.stl --unit mm --hand franka --min-opening 100 --force | contradicts
label box.stl --mass 1e300 | mass must be at most 1e+09 [kg]; got 1e300
label box.stl --mass 1 --density 9 | mass and density exclude each other
label box.stl --task five.csv | task 'five.csv': line 1: give force [N] and torque [N m] as 6 finite
label box.stl --task missing.csv | missing.csv': there is no such file
label box.stl --task wieght | no task is called 'wieght'; known: weight
label box.stl --task pushes.csv | torques of the task are in N m, but the unit of box
label ball.ply --region box:1,2,3 | region must be box:X0,Y0,Z0,X1,Y1,Z1, or a PLY painted
label ball.ply --region box:9,9,9,10,10,10 | has 0 of its 10,242 vertices | the object lies
label ball.ply --region ball.ply | ball.ply: no vertex is painted
label ball.ply --region ball.ply:grip | ball.ply: no vertex is painted with grip above 0.5; its
label ball.ply --region mask.ply:grip | mask.ply: is no mask of ball.ply, of which vertices are
batch ball.ply -o out --region mask.ply | mask.ply is of one mesh; a library takes a box
label box.stl -o notes.ply | notes.ply: exists; name another file
label box.stl --best 2 --grasps task.csv --task task.csv --overwrite | is read by
label box.stl --unit mm --hand franka --best 2 --frame tool0 | unknown gripper frame
label box.stl --unit mm --hand franka --best 2 --frame mirror.txt | mirror.txt: the matrix of a
label box.stl --unit mm --best 2 --frame graspgen | frame is for poses of a gripper of two
evaluate box.stl contacts.csv --frame graspgen | contains no poses; frame applies to poses
label box.stl --unit mm --hand franka --best 2 --object-pose 0.4,0,0.1 | must be x,y,z,yaw (metres
label box.stl --unit mm --hand franka --best 2 --object-pose 400,0,0,0 | 400 m away from the robot
label box.stl --unit mm --hand franka --best 2 --object-pose prose.txt | prose.txt: the object
label box.stl --unit mm --hand franka --best 2 --object-pose turned.json | a matrix of 4 rows
label box.stl --unit mm --hand franka --best 2 --object-pose 1,0,0,0 --grasps a.h5 | acronym files
label box.stl --unit mm --mass 2000 --strict | 1e+07 kg/m^3, more than any material: are its
label open.stl --strict | the surface is open: inside and outside
label open.stl --mass 0.5kg | is open, so its centre of mass is not known
evaluate box.stl poses.csv --hand franka --outcome held | no outcome is called 'held': its grasps
evaluate box.stl box.stl | unsupported contacts format .stl: supported are .csv
evaluate box.stl bad.csv | found a b c
evaluate box.stl pair.json -o pair.json | pair.json: is read by this command; name another file
evaluate box.stl far.json | grasp 1, contact 2 at (-5000, 0, 0)
evaluate box.stl three.json --fingers 4 | have 3 fingers
evaluate box.stl pair.json --metrics min_weight,beauty | 'beauty'; known: all, epsilon_l1
evaluate box.stl poses.csv --unit mm | poses need a gripper or hand: give it with --hand NAME
evaluate box.stl poses.csv --unit mm --hand franka --max-distance 1 | max_distance applies to
evaluate box.stl pair.json -o task.csv --task 'weight + task.csv' --overwrite | is read by
evaluate box.stl pair.json -o task.csv --task 'pushes.csv + ./task.csv' --overwrite | is read by
evaluate box.stl pair.json -o task_link.csv --task task.csv --overwrite | is read by
evaluate box.stl robot.csv --unit mm --hand franka --object-pose 1,0,0,0 | it states the object
evaluate box.stl short.csv --unit mm --hand franka | Expected 7 columns, got 3
evaluate box.stl twice.csv --unit mm --hand franka | two columns are called 'px'
evaluate box.stl bad.csv --unit mm --hand franka | contains no poses: expected columns px py
evaluate box.stl zero.csv | zero.csv: the file is empty
evaluate box.stl head.csv | there are no grasps in it, only column names
evaluate box.stl numbers.csv | its first line must be names of columns; found 20 0 0 -20 0 0
evaluate box.stl commas.csv | grasp 1: x2 must be a number; got '-20,5'
evaluate box.stl metres.csv --unit mm --hand franka | far from the object, 4,6 | in mm, not in m
evaluate box.stl posed.csv --unit mm --hand franka | in the frame 'base_link', not in that of the
evaluate box.stl inward.json --unit mm --hand franka | normals must be outward; got 'inward'
validate scaled.json --mesh box.stl --unit cm --hand franka | box.stl is cm: give --unit mm
validate untried.csv --mesh box.stl --hand franka | no outcome is known of any grasp; a table needs
validate perhaps.csv --mesh box.stl --hand franka | grasp 2: outcome must be 1 or true
validate poses.csv --mesh box.stl --hand franka -o poses.csv | poses.csv: is read by this command
validate poses.csv --hand franka --meshes nowhere | nowhere: there is no such folder
simulate box.stl --unit mm | grasp3d simulate needs --hand; see grasp3d simulate --help
simulate box.stl --unit mm --hand franka --count 0 | count must be from 1 to 1000; got 0
simulate box.stl --unit mm --hand franka --frame acronym | name their file with --grasps
simulate ball.ply --unit mm --hand franka -o link.csv | link.csv: is read by this command; name
sweep | grasp3d sweep needs PATH|SHAPE ...; see grasp3d sweep --help
sweep void | no mesh in it
sweep circle -o notes.csv | notes.csv: exists; name another file
sweep sphere --friction 0.4..0.6 | --friction must be a number; got '0.4..0.6'; or give a range FROM
sweep circle --friction 50 | that of rubber is some 2; got 50: is 0.5 meant?
sweep circle --sensor-resolution 0.39 | write 0.39deg for that, or 0.39rad
sweep circle --fingers 3 | closed form for two fingers only; got 3
check void | no mesh in it
check ball.ply --max-memory 0.1 | max memory must be at least 0.5 GB
hand --picture a.png | --picture needs a gripper
hand nope | 'nope'; known: franka (panda), robotiq_2f85, robotiq_2f140, wsg50, tactile
hand franka --fingers a b | is none
batch void -o out | no mesh in it
batch list.csv -o out | list.csv, row 2: names ball.ply a second time (first in row 1); remove one
batch nothing://lib -o out | no file system is called nothing://
batch 'void/**x/[a' -o out | cannot be opened (Invalid pattern: '**' can only be
batch ball.ply -o ball.ply | its folder is a file
view . --screenshot a.png | was not written by grasp3d batch
view bad.ply --screenshot a.png | have no property 'critical_angle'
view ball.ply --screenshot a.png --fingers 9 | fingers must be from 2 to 5
design --friction 50 | is 0.5 meant?
design --fingertip-radius 8 | fingertip_radius needs its unit, such as 8mm
design --receptive-field 4mm --sensor-resolution 20 | each define the sensor
design --receptive-field 32mm | pi x 10 = 31.42; got 32
design --joints 2 --friction 0.5 | --joints needs --friction and a sensor
label box.stl --hand pad_width.json | pad_width (0.03 m) must be at most finger_width
sweep box.stl --hand finger_length.json | millimetres
"""
"""Words of a command line, and what its error contains."""

USAGE = """
'' | give a command; known: label, check
lable ball.ply | no command is called 'lable'; did you mean label?
--quiet label | no command is called '--quiet'
label | grasp3d label needs FILE; see grasp3d label --help
label x y | 'y' is one too many: grasp3d label takes FILE
label x --max-opening 80 mm | 'mm' is one too many | its unit without a space, as in 80mm
design mug.stl | 'mug.stl' is one too many: grasp3d design takes options only
label x --frict 1 | grasp3d label has no option --frict; did you mean --friction?
label x --resolution 3 | did you mean --sensor-resolution?
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
label ball.ply --hand leap | --hand: leap is a hand with joints, known without its links
label ball.ply --hand void/ | --hand: void: is a folder; name a file
label ball.ply --hand damaged.json | damaged.json: is no JSON
label ball.ply --hand notes.csv | unsupported gripper format .csv
label ball.ply --unit feet | --unit must be one of m, cm, mm, in, guess; got 'feet'
label ball.ply --mass heavy | mass must be
label ball.ply --density 1000 --mass 1 | mass and density exclude each other
label ball.ply --grasps-format acronym | give their number with --best
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
label ball.ply -o @.npz
label ball.ply --best 2 --grasps @.json
label ball.ply --best 2 --grasps @.parquet
label box.stl --unit mm --hand franka --best 2 --grasps @.csv
evaluate box.stl pair.json -o @.csv
evaluate box.stl poses.csv --unit mm --hand franka -o @.json
validate poses.csv --mesh box.stl --hand franka -o @.csv
simulate box.stl --unit mm --hand franka -o @.csv
simulate box.stl --unit mm --grasps poses.csv --hand franka -o @.json
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

BAD_LENGTHS = {"pad_width": 0.03, "finger_length": 45.0}
"""What is wrong with the gripper in the file of that name [m]."""

POSED = [{"pose": [[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 40], [0, 0, 0, 1]], "success": 1}]
STATED = {
    "inward": {"grasp3d": {"unit": "mm", "normals": "inward"}, "grasps": POSED},
    "scaled": {
        "grasp3d": {"unit": "mm", "object_file": "a/box.stl", "object_scale": 0.001},
        "grasps": POSED,
    },
}
"""Files of poses that state what cannot be taken, by their name."""

TAKEN = ("ply", "npz", "csv", "svg", "json", "png", "parquet")
"""Suffixes of folders."""

NOTES = ("ply", "csv")
"""Suffixes of files of other programs."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with meshes, grasps and files of other programs, sound ones and damaged ones."""
    folder = tmp_path_factory.mktemp("refused")
    ball = export(folder / "ball.ply", shapes.sphere(2))
    vertices, faces = shapes.box((40.0, 60.0, 80.0))
    export(folder / "box.stl", (vertices, faces))
    export(folder / "open.stl", (vertices, faces[:-2]))
    for name in ("void", "leap", *(f"taken.{suffix}" for suffix in TAKEN)):
        (folder / name).mkdir()
    (folder / "link.csv").symlink_to(ball)
    pair = [[20, 0, 0], [-20, 0, 0]]
    header = "ply\nformat ascii 1.0\nelement vertex {}\n" + "".join(
        f"property float {axis}\n" for axis in "xyz"
    )
    (folder / "task_link.csv").symlink_to("task.csv")
    columns = "px,py,pz,qx,qy,qz,qw,unit,outcome\n"
    framed = "px,py,pz,qx,qy,qz,qw,unit,object_pose\n0,0,40,1,0,0,0,mm,"
    texts = {
        "empty.stl": "",
        "prose.stl": "Not a mesh at all.\n" * 9,
        "mask.ply": "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
        "property float z\nproperty float grip\nelement face 1\n"
        "property list uchar int vertex_indices\nend_header\n"
        "0 0 0 1\n1 0 0 1\n0 1 0 0\n3 0 1 2\n",
        "bad.ply": header.format(3) + "property uchar label\nelement face 1\n"
        "property list uchar int vertex_indices\nend_header\n"
        "0 0 0 1\n1 0 0 2\n0 1 0 7\n3 0 1 2\n",
        "nan.off": "OFF\n3 1 0\n0 0 0\n1 0 0\n0 nan 0\n3 0 1 2\n",
        "bad.csv": "a,b,c\n1,2,3\n",
        "list.csv": "path\nball.ply\nball.ply\n",
        "pair.json": json.dumps([pair]),
        "far.json": json.dumps([[pair[0], [-5000, 0, 0]]]),
        "three.json": json.dumps([[*pair, [0, 30, 0]]]),
        "poses.csv": f"{columns}0,0,40,1,0,0,0,mm,1\n",
        "untried.csv": f"{columns}0,0,40,1,0,0,0,mm,\n",
        "perhaps.csv": f"{columns}0,0,40,1,0,0,0,mm,false\n0,0,40,1,0,0,0,mm,perhaps\n",
        "robot.csv": f'{framed}"1,0,0,0"\n',
        "short.csv": f"{','.join(columns.split(',')[:7])}\n0,0,40,1,0,0,0\n0,0,40\n",
        "twice.csv": f"px,{columns}0,0,0,40,1,0,0,0,mm,1\n",
        "prose.txt": "Over there.\n",
        "mirror.txt": "-1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n",
        "turned.json": json.dumps({"position": {}, "orientation": {"x": 0, "y": 0, "z": 1}}),
        "zero.csv": "",
        "head.csv": "x1;y1;z1;x2;y2;z2\n",
        "numbers.csv": "20,0,0,-20,0,0\n",
        "commas.csv": "x1;y1;z1;x2;y2;z2\n20.5;0;0;-20,5;0;0\n",
        "metres.csv": f"{columns}0,0,500,1,0,0,0,m,1\n",
        "posed.csv": "px,py,pz,qx,qy,qz,qw,frame\n0,0,40,1,0,0,0,base_link\n",
        **{f"{name}.json": json.dumps(STATED[name]) for name in STATED},
        "task.csv": "5,0,0,0,0,0\n",
        **{f"notes.{suffix}": "name,price\n" for suffix in NOTES},
        "pushes.csv": "fx,fy,fz,tx,ty,tz\n5,0,0,0,0,0.1\n",
        "five.csv": "5,0,0,0,0\n",
        "named.csv": "fx,fy,fz,tx,ty,tz\n5,0,0,0,0,0\nforce 0,5,0,0,0,0\n",
        "damaged.json": '{"format": ',
    }
    write_hand(folder / "hand.json", HAND)
    hand = json.loads((folder / "hand.json").read_text(encoding="utf-8"))
    for name, value in BAD_LENGTHS.items():
        texts[f"{name}.json"] = json.dumps(hand | {name: value})
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    return folder


@pytest.mark.parametrize("case", [*filter(None, (REFUSED + USAGE).splitlines())])
def test_bad_input_is_one_line_and_writes_nothing(folder: Path, case: str) -> None:
    words, *messages = case.split(" | ")
    error = refusal(words, folder)
    assert all(message in error for message in messages), error


@pytest.mark.slow
@pytest.mark.parametrize(
    "words",
    ["label ball.ply --hand frank", "lable ball.ply", "batch .", "label ball.ply -o x/y.ply"],
)
def test_a_process_of_its_own_refuses_the_same(folder: Path, words: str) -> None:
    run = run_process(*words.split(), cwd=folder)
    assert (run.returncode, run.stdout, run.stderr) == (2, "", refusal(words, folder))


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
    words, *messages = case.split(" | ")
    error = refusal(words, folder)
    assert all(message in error for message in messages), error
    assert len(error) <= 300


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
