"""Files that stand for much memory, or name other files."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import grasp3d
from grasp3d.cli import main
from grasp3d.errors import FileUnreadError, MeshError
from grasp3d.mesh import mesh_files
from grasp3d.mesh.mesh_files import read_mesh
from grasp3d.mesh.sources import Source
from grasp3d.system import limited_reading
from grasp3d.viewer.show import show
from tests.helpers import mesh_files as examples
from tests.helpers.mesh_files import DATA, written

ROOT = str(Path(grasp3d.__file__).parents[1])
MODEL = examples.xml_model(examples.xml_object(1), '<item objectid="1"/>')


def repeated() -> bytes:
    """A GLB of one part that is shown at each of many nodes."""
    count, tree = 60_000, examples.tree()
    tree["bufferViews"] = [{"buffer": 0, "byteLength": 12 * count}]
    tree["buffers"] = [{"byteLength": 12 * count}]
    tree["accessors"] = [{"bufferView": 0, "componentType": 5126, "count": count, "type": "VEC3"}]
    tree["meshes"] = [{"primitives": [{"attributes": {"POSITION": 0}}]}]
    tree["nodes"] = [{"mesh": 0}] * 400
    tree["scenes"] = [{"nodes": list(range(400))}]
    return examples.glb(tree, np.arange(3 * count, dtype="<f4").tobytes())


SMALL = {
    "a.glb": repeated(),
    "a.3mf": examples.zipped({"3D/3dmodel.model": MODEL, "a.png": bytes(400_000_000)}),
}


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="limits of memory are Linux's")
@pytest.mark.parametrize("name", SMALL)
def test_a_small_file_that_stands_for_much_memory_is_refused(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = written(tmp_path, name, SMALL[name])
    monkeypatch.setattr(limited_reading, "MEMORY", 3e8)
    with (
        limited_reading.limited_reading(),
        pytest.raises(FileUnreadError, match=r"takes more than 0\.3 GB of memory"),
    ):
        read_mesh(path)


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


HOOK = """
import os, sys
log = os.open(os.environ["AUDIT_LOG"], os.O_WRONLY | os.O_APPEND)
def hook(event, args):
    if event == "open" and isinstance(args[0], (str, bytes)):
        os.write(log, f"open {os.fsdecode(args[0])}\\n".encode())
    elif event.startswith(("socket.", "os.system", "os.exec", "urllib", "webbrowser")):
        os.write(log, f"other {event}\\n".encode())
sys.addaudithook(hook)
"""
READ_ALL = """
import sys
from pathlib import Path
from grasp3d import GraspError
from grasp3d.mesh.mesh_files import read_mesh
for name in sys.argv[1:]:
    try:
        print(len(read_mesh(Path(name)).faces))
    except GraspError as error:
        print("refused")
"""


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="links of POSIX")
def test_only_the_files_of_the_mesh_are_opened(tmp_path: Path) -> None:
    folder, hooks, log = tmp_path / "folder", tmp_path / "hooks", tmp_path / "log"
    folder.mkdir()
    hooks.mkdir()
    (tmp_path / "secret.bin").write_bytes(DATA)
    (folder / "good.bin").write_bytes(DATA)
    secret = (tmp_path / "secret.bin").as_uri()
    written(folder, "a.mtl", f"newmtl red\nmap_Kd {tmp_path}/secret.bin\n")
    lines = f"mtllib a.mtl\nmtllib {tmp_path}/secret.bin\nusemtl red\nmap_Kd ../secret.bin\n"
    comment = "comment TextureFile ../secret.bin\nelement vertex"
    tree = examples.tree()
    tree["images"] = [{"uri": "../secret.bin"}, {"uri": "http://127.0.0.1:9/a.png"}]
    tree["textures"] = [{"source": 0}]
    tree["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
    tree["meshes"][0]["primitives"][0]["material"] = 0
    relations = (
        f'<Relationships><Relationship Target="{secret}" TargetMode="External"/></Relationships>'
    )
    entity = f'<!DOCTYPE model [<!ENTITY a SYSTEM "{secret}">]><model'
    files = {
        "a.obj": lines + examples.obj_text(),
        "a.ply": examples.ply_text().replace("element vertex", comment),
        "a.glb": examples.glb(tree),
        "a.gltf": examples.gltf(examples.tree(), "good.bin"),
        "b.gltf": examples.gltf(examples.tree(), "../secret.bin"),
        "c.gltf": examples.gltf(examples.tree(), "http://127.0.0.1:9/a.bin"),
        "a.3mf": examples.zipped(
            {"3D/3dmodel.model": MODEL, "_rels/.rels": relations, "../../secret.bin": "x"}
        ),
        "b.3mf": examples.zipped({"3D/3dmodel.model": MODEL.replace("<model", entity, 1)}),
    }
    paths = [written(folder, name, content) for name, content in files.items()]
    written(hooks, "sitecustomize.py", HOOK)
    log.touch()
    path = os.pathsep.join([str(hooks), ROOT])
    env = {**os.environ, "PYTHONPATH": path, "AUDIT_LOG": str(log)}
    done = subprocess.run(
        [sys.executable, "-c", READ_ALL, *paths],
        env=env, cwd=tmp_path, check=True, capture_output=True, text=True,
    )  # fmt: skip
    assert done.stderr == ""
    assert done.stdout.split() == ["4", "4", "4", "4", "refused", "refused", "4", "4"]
    events = log.read_text(encoding="utf-8").splitlines()
    assert {line.split()[0] for line in events} == {"open"}
    opened = {line.removeprefix("open ") for line in events}
    ours = {name for name in opened if name.startswith(str(tmp_path)) and "/hooks/" not in name}
    assert ours == {*map(str, paths), str(folder / "good.bin")}
