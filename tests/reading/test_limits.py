"""Limits of reading: memory, time, archives, and files outside the folder."""

import os
import signal
import struct
import subprocess
import sys
import time
import zipfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import psutil
import pytest

import grasp3d
from grasp3d.cli import begin_processes
from grasp3d.errors import MeshError, MeshUnreadError
from grasp3d.reading import archives
from grasp3d.reading.mesh_files import read_mesh
from grasp3d.system.isolation import CallFailedError, CallFailure, call, end_idle
from tests.helpers import mesh_files
from tests.helpers.mesh_files import DATA, VERTICES, written

ROOT = str(Path(grasp3d.__file__).parents[1])
posix = pytest.mark.skipif(os.name != "posix", reason="signals and limits of POSIX")


def good(folder: Path, name: str = "good.glb") -> Path:
    return written(folder, name, mesh_files.glb(mesh_files.tree()))


def slow(folder: Path, nodes: int = 400) -> Path:
    """A file that takes seconds to read: each of its nodes has as many parts."""
    tree = mesh_files.tree()
    tree["nodes"] = [{"mesh": 0} for _ in range(nodes)]
    tree["scenes"] = [{"nodes": [*range(nodes)]}]
    tree["meshes"][0]["primitives"] *= nodes
    return written(folder, "slow.glb", mesh_files.glb(tree))


def large(folder: Path, parts: int) -> Path:
    """A small file with overlapping numbers, one starting at each byte, used by every part."""
    count = 600_000
    tree = mesh_files.tree()
    tree["bufferViews"] = [{"buffer": 0, "byteLength": count + 12, "byteStride": 1}]
    positions = {"bufferView": 0, "componentType": 5126, "count": count, "type": "VEC3"}
    tree["accessors"] = [positions] * parts
    rows = [{"attributes": {"POSITION": k}} for k in range(parts)]
    tree["meshes"] = [{"primitives": rows}]
    return written(folder, "large.glb", mesh_files.glb(tree, bytes(count + 12)))


def is_read(path: Path) -> bool:
    return np.array_equal(read_mesh(path).vertices, VERTICES)


def children() -> set[int]:
    return {child.pid for child in psutil.Process().children()}


@pytest.mark.slow
def test_the_process_that_reads_a_file_can_be_begun_before(tmp_path: Path) -> None:
    path, direct = good(tmp_path), written(tmp_path, "part.stl", mesh_files.stl_text().encode())
    end_idle()
    before = children()
    begin_processes(tmp_path / "missing.glb", pictures=5)
    begin_processes(direct)
    assert children() == before  # nothing to read, or nothing that another process reads
    begin_processes(path)
    begun = children() - before
    assert len(begun) == 1
    assert call(eval, "'trimesh' in __import__('sys').modules")
    assert is_read(path)
    assert children() - before == begun


@pytest.mark.slow
@posix
@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="limits of Linux")
def test_a_file_that_needs_more_memory_than_allowed_is_rejected(tmp_path: Path) -> None:
    path = large(tmp_path, 60)
    assert path.stat().st_size < 1_000_000
    with pytest.raises(
        MeshError, match=r"max_memory, 0\.5 GB \(--max-memory\).*STL or PLY"
    ) as info:
        read_mesh(path, max_memory=0.5)
    assert "\n" not in str(info.value)
    assert len(read_mesh(large(tmp_path, 7), max_memory=2.0).faces) == 7 * 200_000
    assert is_read(good(tmp_path))


@pytest.mark.slow
def test_a_file_that_takes_too_long_is_rejected(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = slow(tmp_path)
    assert is_read(good(tmp_path))
    monkeypatch.setattr("grasp3d.reading.mesh_files.SECONDS", 0.2)
    with pytest.raises(MeshError, match="reading it took more than"):
        read_mesh(path)
    monkeypatch.undo()
    assert is_read(good(tmp_path))


@pytest.mark.slow
@posix
def test_after_an_interrupt_the_next_file_gets_its_own_answer(tmp_path: Path) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    path = slow(tmp_path)
    assert is_read(good(tmp_path))
    before = signal.signal(signal.SIGALRM, interrupt)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.3)
        with pytest.raises(KeyboardInterrupt):
            read_mesh(path)
    finally:
        signal.signal(signal.SIGALRM, before)
    tree = mesh_files.tree()
    tree["nodes"][0]["scale"] = [3, 3, 3]
    path = written(tmp_path, "other.glb", mesh_files.glb(tree))
    assert np.array_equal(read_mesh(path).vertices, 3 * VERTICES)


TRY_AGAIN = "; try again, or export the mesh as STL or PLY"
EXPORT = "; export the mesh again, as STL or PLY"


@pytest.mark.parametrize(
    ("kind", "error", "message"),
    [
        (CallFailure.KILLED, MeshUnreadError, "the process that reads it was ended" + TRY_AGAIN),
        (CallFailure.OUT_OF_TIME, MeshUnreadError, "reading it took more than 15 s" + EXPORT),
        (CallFailure.OUT_OF_MEMORY, MeshError, r"than max_memory, 2 GB \(--max-memory\)" + EXPORT),
        (CallFailure.CRASHED, MeshError, r"\(--max-memory\), or crashed the reader" + EXPORT),
    ],
)
def test_each_failure_of_the_process_that_reads_has_its_message(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    kind: CallFailure,
    error: type[MeshError],
    message: str,
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise CallFailedError(kind, "was ended")

    monkeypatch.setattr("grasp3d.reading.mesh_files.call", fail)
    with pytest.raises(MeshError, match=message + "$") as caught:
        read_mesh(good(tmp_path), max_memory=2.0)
    assert type(caught.value) is error


def test_threads_can_read_at_the_same_time(tmp_path: Path) -> None:
    paths = []
    for k in range(24):
        tree = mesh_files.tree()
        tree["nodes"][0]["translation"] = [k, 0, 0]
        paths.append(written(tmp_path, f"{k}.glb", mesh_files.glb(tree)))
        paths.append(
            written(tmp_path, f"{k}.stl", mesh_files.stl_text().replace("vertex 0", f"vertex {k}"))
        )
    with ThreadPoolExecutor(8) as pool:
        found = list(pool.map(read_mesh, paths))
    for k in range(24):
        assert found[2 * k].vertices.min(axis=0).tolist() == [k, 0, 0]
        assert found[2 * k + 1].vertices[:, 0].max() == max(k, 1)


def run(
    code: str, *args: object, flags: tuple[str, ...] = ("-P",), **options: object
) -> subprocess.CompletedProcess[str]:
    """Run a script in a fresh interpreter that imports this package."""
    env = {**os.environ, "PYTHONPATH": ROOT}
    return subprocess.run(  # type: ignore[call-overload,no-any-return]
        [sys.executable, *flags, "-c", code, *map(str, args)],
        check=False,
        **{"capture_output": True, "text": True, "timeout": 60, "env": env, **options},
    )


READ = """
import sys; sys.path.insert(0, sys.argv.pop(1)) if sys.flags.isolated else None
from pathlib import Path
from grasp3d.reading.mesh_files import read_mesh
print(len(read_mesh(Path(sys.argv[1])).faces))
"""


@pytest.mark.slow
def test_no_process_and_no_warning_remains(tmp_path: Path) -> None:
    script = READ + "import psutil; print(psutil.Process().children()[0].pid)"
    done = run(script, good(tmp_path), flags=("-P", "-W", "error", "-X", "dev"))
    assert (done.returncode, done.stderr) == (0, "")
    faces, pid = done.stdout.split()
    assert faces == "4"
    assert not psutil.pid_exists(int(pid))


ENDED = """
import os, sys, signal, time
from pathlib import Path
import psutil
from grasp3d.reading.mesh_files import read_mesh
read_mesh(Path(sys.argv[1]))
print(psutil.Process().children()[0].pid, flush=True)
if not os.fork():  # a process that lives on without pipes of its parent
    os.close(1)
    os.close(2)
    time.sleep(15.0)
    os._exit(0)
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.slow
@posix
def test_the_process_ends_when_its_parent_is_killed_though_a_fork_lives_on(tmp_path: Path) -> None:
    done = run(ENDED, good(tmp_path))
    assert done.returncode == -signal.SIGKILL
    pid, end = int(done.stdout), time.monotonic() + 8.0
    while psutil.pid_exists(pid) and psutil.Process(pid).status() != psutil.STATUS_ZOMBIE:
        assert time.monotonic() < end
        time.sleep(0.05)


FORKED = """
import os, sys, threading, time
from pathlib import Path
from grasp3d.reading.mesh_files import read_mesh
good, slow, text = map(Path, sys.argv[1:])
read_mesh(good)
thread = threading.Thread(target=read_mesh, args=(slow,))
for _ in range(2):  # first while the reader is busy, then while it is idle
    if not thread.ident:
        thread.start()
        time.sleep(0.3)
    pid = os.fork()
    if not pid:
        read_mesh(text)
        print(len(read_mesh(good).faces), flush=True)
        sys.exit(7)
    assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 7
    thread.join()
    print(len(read_mesh(good).faces), flush=True)
"""


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_forked_process_reads_while_its_parent_reads(tmp_path: Path) -> None:
    flags = ("-P", "-X", "dev", "-W", "error::ResourceWarning")
    text = written(tmp_path, "a.stl", mesh_files.stl_text())
    done = run(FORKED, good(tmp_path), slow(tmp_path, 200), text, flags=flags)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.split() == ["4"] * 4


MARKER = "open(__file__ + '.imported', 'w')\n"


@pytest.mark.slow
def test_modules_of_the_working_folder_are_not_imported(tmp_path: Path) -> None:
    for name in ("json", "trimesh", "numpy", "struct", "signal", "typing"):
        written(tmp_path, f"{name}.py", MARKER)
    (tmp_path / "grasp3d").mkdir()
    written(tmp_path / "grasp3d", "__init__.py", MARKER)
    good(tmp_path)
    done = run(READ, "good.glb", cwd=tmp_path)
    assert (done.stdout, done.stderr) == ("4\n", "")
    assert not list(tmp_path.rglob("*.imported"))
    done = run(READ, ROOT, "good.glb", flags=("-I",), cwd=tmp_path)
    assert (done.stdout, done.stderr) == ("4\n", "")
    enter = f"import os; import grasp3d.reading.mesh_files; os.chdir({str(tmp_path)!r})\n"
    env = {**os.environ, "PYTHONPATH": ROOT + os.pathsep}  # an empty entry is the working folder
    done = run(enter + READ, "good.glb", cwd=ROOT, env=env)
    assert (done.stdout, done.stderr) == ("4\n", "")
    assert not list(tmp_path.rglob("*.imported"))


@pytest.mark.slow
@posix
def test_files_are_read_after_the_working_folder_was_deleted(tmp_path: Path) -> None:
    (tmp_path / "gone").mkdir()
    leave = f"import os; os.chdir({str(tmp_path / 'gone')!r}); os.rmdir(os.getcwd())"
    done = run(leave + READ, good(tmp_path))
    assert (done.stdout, done.stderr) == ("4\n", "")


@posix
def test_a_file_name_that_is_not_unicode(tmp_path: Path) -> None:
    name = os.fsdecode(b"\xff\n.glb")
    assert is_read(good(tmp_path, name))
    with pytest.raises(MeshError, match=r"\\udcff\\n\.glb: a chunk declares") as caught:
        read_mesh(written(tmp_path, name, mesh_files.glb(mesh_files.tree())[:20]))
    assert "\n" not in str(caught.value)


def test_deeply_nested_json_and_objects_are_rejected(tmp_path: Path) -> None:
    text = b'{"asset": ' + b"[" * 500_000
    with pytest.raises(MeshError, match="its JSON cannot be read"):
        read_mesh(written(tmp_path, "a.gltf", text))
    rows = [mesh_files.xml_object(0)]
    rows += [mesh_files.xml_components(k + 1, f'objectid="{k}"') for k in range(3000)]
    data = mesh_files.three_mf("".join(rows), '<item objectid="3000"/>')
    with pytest.raises(MeshError, match="its parts are nested in a cycle or too deeply"):
        read_mesh(written(tmp_path, "a.3mf", data))


@pytest.mark.parametrize("suffix", ["stl", "ply", "obj", "off"])
def test_a_large_file_is_rejected_before_it_is_read(tmp_path: Path, suffix: str) -> None:
    path = written(tmp_path, f"a.{suffix}", "solid")
    os.truncate(path, 10**9)
    with pytest.raises(MeshError, match=r"max_memory is 0\.5 GB; simplify .*--max-memory"):
        read_mesh(path, max_memory=0.5)


def test_running_out_of_memory_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_: Path) -> bytes:
        raise MemoryError

    monkeypatch.setattr(Path, "read_bytes", refuse)
    with pytest.raises(MeshError, match="needs more memory than is available"):
        read_mesh(written(tmp_path, "a.stl", mesh_files.stl_binary()))


MODEL = mesh_files.xml_model(mesh_files.xml_object(1), '<item objectid="1"/>')
DECLARED = MODEL.replace("<model", '<!DOCTYPE model [<!ENTITY a "aa">]><model', 1)
PACKED = mesh_files.zipped({"3D/3dmodel.model": MODEL})
ARCHIVES: dict[str, tuple[bytes, str]] = {
    "entities.3mf": (mesh_files.zipped({"3D/3dmodel.model": DECLARED}), "declares a document type"),
    "wide.3mf": (
        mesh_files.zipped(
            {"3D/3dmodel.model": DECLARED.replace("UTF-8", "UTF-16").encode("utf-16")}
        ),
        "declares a document type",
    ),
    "strange.3mf": (
        mesh_files.zipped({"3D/3dmodel.model": MODEL.replace("UTF-8", "rot13")}),
        "its XML cannot be read",
    ),
    "bomb.3mf": (
        mesh_files.zipped({"3D/3dmodel.model": MODEL, "a.png": bytes(20_000_000)}),
        "more than 100 times its size",
    ),
    "liar.3mf": (
        PACKED.replace(struct.pack("<I", len(MODEL)), struct.pack("<I", 400)),
        "cannot be read as 3MF",
    ),
    "many.3mf": (
        mesh_files.zipped({f"{k}.txt": "" for k in range(archives.MOST_ENTRIES + 1)}),
        "contains 10,001 files",
    ),
    "lzma.3mf": (
        mesh_files.zipped({"3D/3dmodel.model": MODEL}, zipfile.ZIP_LZMA),
        "compression method is not supported",
    ),
    "cut.3mf": (PACKED[:-9], "cannot be read as 3MF"),
    "flipped.3mf": (PACKED[:80] + b"\xff\xff\xff\xff" + PACKED[84:], "cannot be read as 3MF"),
    "prose.3dxml": (b"prose", "cannot be read as 3DXML"),
    "empty.3dxml": (mesh_files.zipped({"a.xml": "<a/>"}), "cannot be read as 3DXML"),
    "entities.xaml": (DECLARED.encode(), "declares a document type"),
    "prose.xaml": (b"prose", "its XML cannot be read"),
    "model.xaml": (MODEL.encode(), "cannot be read as XAML"),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", ARCHIVES)
def test_malicious_archives_and_documents_are_rejected(tmp_path: Path, name: str) -> None:
    data, message = ARCHIVES[name]
    with pytest.raises(MeshError, match=message) as caught:
        read_mesh(written(tmp_path, name, data))
    assert "\n" not in str(caught.value)


def test_an_archive_that_needs_too_much_memory_unpacked_is_rejected(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).bytes(60_000_000)
    data = mesh_files.zipped({"3D/3dmodel.model": MODEL, "a.png": noise}, zipfile.ZIP_STORED)
    with pytest.raises(MeshError, match=r"max_memory is 0\.5 GB"):
        read_mesh(written(tmp_path, "a.3mf", data), max_memory=0.5)


def test_a_xaml_is_read(tmp_path: Path) -> None:
    corners = " ".join(",".join(map(str, row)) for row in VERTICES.tolist())
    text = (
        '<Viewport3D xmlns="http://schemas.microsoft.com/winfx/2006/xaml/presentation">'
        "<GeometryModel3D><DiffuseMaterial/><MeshGeometry3D "
        f'Positions="{corners}" Normals="{corners}" TriangleIndices="0,2,1 0,1,3 1,2,3 0,3,2"/>'
        "</GeometryModel3D></Viewport3D>"
    )
    assert is_read(written(tmp_path, "a.xaml", text))


OUTSIDE = (
    "../secret.bin", "a/../../secret.bin", "%2e%2e/secret.bin", "%2E%2E%2Fsecret.bin",
    "..\\secret.bin", "/etc/passwd", "file:///etc/passwd", "FILE:secret.bin", "C:\\secret.bin",
    "http://127.0.0.1:9/a.bin", "//127.0.0.1/a.bin", "\\\\host\\a.bin", "good.bin\0", "good%00.bin",
    "", ".", "folder", "out.bin", "deep/out.bin", "http:good.bin", "data.bin\n", "[", "gone.bin",
)  # fmt: skip


def make_folder(tmp_path: Path) -> Path:
    """A folder beside a secret file, with links to the secret and to a file inside."""
    folder = tmp_path / "folder"
    (folder / "folder").mkdir(parents=True)
    (folder / "deep").symlink_to(tmp_path)
    for name in ("secret.bin", "out.bin", "folder/good.bin"):
        (tmp_path / name).write_bytes(DATA)
    (folder / "out.bin").symlink_to(tmp_path / "secret.bin")
    (folder / "in.bin").symlink_to(folder / "good.bin")
    return folder


@posix
@pytest.mark.parametrize("uri", OUTSIDE)
def test_a_gltf_cannot_read_files_outside_its_folder(tmp_path: Path, uri: str) -> None:
    path = written(make_folder(tmp_path), "a.gltf", mesh_files.gltf(mesh_files.tree(), uri))
    with pytest.raises(MeshError, match=r"refers to|is missing|is not a file") as caught:
        read_mesh(path)
    assert "\n" not in str(caught.value)


@posix
def test_links_inside_the_folder_are_followed(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    assert is_read(written(folder, "a.gltf", mesh_files.gltf(mesh_files.tree(), "in.bin")))


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
from grasp3d.reading.mesh_files import read_mesh
for name in sys.argv[1:]:
    try:
        print(len(read_mesh(Path(name)).faces))
    except GraspError as error:
        print("refused")
"""


@pytest.mark.slow
@posix
def test_only_the_files_of_the_mesh_are_opened(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    secret = (tmp_path / "secret.bin").as_uri()
    written(folder, "a.mtl", f"newmtl red\nmap_Kd {tmp_path}/secret.bin\n")
    lines = f"mtllib a.mtl\nmtllib {tmp_path}/secret.bin\nusemtl red\nmap_Kd ../secret.bin\n"
    comment = "comment TextureFile ../secret.bin\nelement vertex"
    tree = mesh_files.tree()
    tree["images"] = [{"uri": "../secret.bin"}, {"uri": "http://127.0.0.1:9/a.png"}]
    tree["textures"], tree["materials"] = (
        [{"source": 0}],
        [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
    )
    tree["meshes"][0]["primitives"][0]["material"] = 0
    relations = (
        f'<Relationships><Relationship Target="{secret}" TargetMode="External"/></Relationships>'
    )
    files = {
        "a.obj": lines + mesh_files.obj_text(),
        "a.ply": mesh_files.ply_text().replace("element vertex", comment),
        "a.glb": mesh_files.glb(tree),
        "a.gltf": mesh_files.gltf(mesh_files.tree(), "good.bin"),
        "b.gltf": mesh_files.gltf(mesh_files.tree(), "../secret.bin"),
        "c.gltf": mesh_files.gltf(mesh_files.tree(), "http://127.0.0.1:9/a.bin"),
        "a.3mf": mesh_files.zipped(
            {"3D/3dmodel.model": MODEL, "_rels/.rels": relations, "../../secret.bin": "x"}
        ),
    }
    paths = [written(folder, name, content) for name, content in files.items()]
    hooks, log = tmp_path / "hooks", tmp_path / "log"
    hooks.mkdir()
    written(hooks, "sitecustomize.py", HOOK)
    log.touch()
    path = os.pathsep.join([str(hooks), ROOT])
    env = {**os.environ, "PYTHONPATH": path, "AUDIT_LOG": str(log)}
    done = run(READ_ALL, *paths, env=env)
    assert done.stderr == ""
    assert done.stdout.split() == ["4", "4", "4", "4", "refused", "refused", "4"]
    events = log.read_text(encoding="utf-8").splitlines()
    assert {line.split()[0] for line in events} == {"open"}
    opened = {line.removeprefix("open ") for line in events}
    ours = {name for name in opened if name.startswith(str(tmp_path)) and "/hooks/" not in name}
    assert ours == {*map(str, paths), str(folder / "good.bin")}
    roots = {sys.prefix, sys.base_prefix, ROOT, str(hooks), "/proc/", os.devnull, "__editable__"}
    roots |= {str(Path(root).resolve()) for root in (sys.prefix, sys.base_prefix)}
    assert [name for name in opened - ours if not name.startswith(tuple(roots))] == []
