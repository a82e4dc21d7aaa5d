"""Files that name other files, or that are mutated: which process reads them, and how it ends."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

import grasp3d
from grasp3d.cli import main
from grasp3d.errors import MeshError
from grasp3d.mesh import mesh_files
from grasp3d.mesh.sources import Source
from grasp3d.viewer.show import show
from scripts import fuzz
from tests.helpers import mesh_files as examples
from tests.helpers.mesh_files import DATA, written

ROOT = str(Path(grasp3d.__file__).parents[1])
MODEL = examples.xml_model(examples.xml_object(1), '<item objectid="1"/>')


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere child processes import anew")
def test_commands_read_in_child_processes_and_python_in_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(source: Source) -> None:
        raise source.error(f"read by {os.getpid()}")

    monkeypatch.setitem(mesh_files.READERS, "stl", refuse)
    path = written(tmp_path, "a.stl", b"solid")
    for read in (grasp3d.load_mesh, show):
        with pytest.raises(MeshError, match=f"read by {os.getpid()}$"):
            read(path)
    output = str(tmp_path / "out")
    for words in (["label"], ["check"], ["view"], ["batch", "-o", output, "--workers", "0"]):
        assert main([words[0], str(path), *words[1:]]) > 0
        printed = "".join(capsys.readouterr())
        assert "read by " in printed
        assert f"read by {os.getpid()}" not in printed


READ_ALL = """
import sys
from pathlib import Path
opened, others = set(), set()
def hook(event, args):
    if event == "open":
        opened.add(str(args[0]))
    elif event.startswith(("socket.", "os.system", "os.exec", "urllib", "webbrowser")):
        others.add(event)
sys.addaudithook(hook)
from grasp3d import GraspError
from grasp3d.mesh.mesh_files import read_mesh
for name in sys.argv[1:]:
    try:
        print(len(read_mesh(Path(name)).faces))
    except GraspError as error:
        print("refused")
folder = str(Path(sys.argv[1]).parents[1])
print(*others, *sorted(name for name in opened if name.startswith(folder)))
"""


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="links of POSIX")
def test_only_the_files_of_the_mesh_are_opened(tmp_path: Path) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    for place in (tmp_path / "secret.bin", folder / "good.bin"):
        place.write_bytes(DATA)
    secret = (tmp_path / "secret.bin").as_uri()
    written(folder, "a.mtl", f"newmtl red\nmap_Kd {tmp_path}/secret.bin\n")
    lines = f"mtllib a.mtl\nmtllib {tmp_path}/secret.bin\nusemtl red\nmap_Kd ../secret.bin\n"
    comment = "comment TextureFile ../secret.bin\nelement vertex"
    tree = examples.tree()
    tree["images"] = [{"uri": "../secret.bin"}, {"uri": "http://127.0.0.1:9/a.png"}]
    tree["textures"] = [{"source": 0}]
    tree["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
    tree["meshes"][0]["primitives"][0]["material"] = 0
    relation = f'<Relationship Target="{secret}" TargetMode="External"/>'
    entity = f'<!DOCTYPE model [<!ENTITY a SYSTEM "{secret}">]><model'
    more = {"_rels/.rels": f"<Relationships>{relation}</Relationships>", "../../secret.bin": "x"}
    files = {
        "a.obj": lines + examples.obj_text(),
        "a.ply": examples.ply_text().replace("element vertex", comment),
        "a.glb": examples.glb(tree),
        "a.gltf": examples.gltf(examples.tree(), "good.bin"),
        "b.gltf": examples.gltf(examples.tree(), "../secret.bin"),
        "c.gltf": examples.gltf(examples.tree(), "http://127.0.0.1:9/a.bin"),
        "a.3mf": examples.zipped({"3D/3dmodel.model": MODEL, **more}),
        "b.3mf": examples.zipped({"3D/3dmodel.model": MODEL.replace("<model", entity, 1)}),
    }
    paths = [str(written(folder, name, content)) for name, content in files.items()]
    done = subprocess.run(
        [sys.executable, "-c", READ_ALL, *paths],
        cwd=tmp_path, env={**os.environ, "PYTHONPATH": ROOT},
        check=True, capture_output=True, text=True,
    )  # fmt: skip
    assert done.stderr == ""
    *read, opened = done.stdout.splitlines()
    assert read == ["4", "4", "4", "4", "refused", "refused", "4", "4"]
    assert opened.split() == sorted([*paths, str(folder / "good.bin")])


COUNT = 40
"""Mutated files of each reader."""


@pytest.mark.slow
@pytest.mark.parametrize("name", fuzz.READERS)
def test_a_mutated_file_is_read_or_refused(name: str, tmp_path: Path) -> None:
    path = tmp_path / f"example{fuzz.READERS[name][0]}"
    fuzz.write_example(name, path)
    example = path.read_bytes()
    assert fuzz.READERS[name][1](path) is not None
    outcomes = list[str]()
    for number in range(COUNT):
        started = time.monotonic()
        outcomes.append(fuzz.outcome_of(name, path, [1, number], example))
        assert time.monotonic() - started < 40.0
    assert [outcome for outcome in outcomes if outcome.startswith("FAILED")] == []
    assert set(outcomes) != {"read"}  # otherwise nothing was damaged
