"""A folder for results on any file system; each file in it is there whole or not at all."""

import os
import tempfile
import time
import weakref
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from grasp3d.errors import MeshError, OutputError
from grasp3d.storage.addresses import failures_told, local_path, system_of
from grasp3d.storage.listing import entries
from grasp3d.system.files import PART, written_whole
from grasp3d.system.names import printable

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]


class Lock:
    """Keeps others out of a folder until it is closed, or dropped."""

    def __init__(self, descriptor: int | None = None) -> None:
        self._end = None if descriptor is None else weakref.finalize(self, os.close, descriptor)

    def close(self) -> None:
        """Let others in."""
        if self._end is not None:
            self._end()


@dataclass(frozen=True)
class Folder:
    """A folder on any file system; it need not exist. Names in it are relative, with `/`."""

    url: str
    """As a user would write it: out, /data/out, s3://bucket/out."""

    @property
    def is_local(self) -> bool:
        """Whether it is on this machine's file system."""
        return local_path(self.url) is not None

    def path(self, name: str) -> str:
        """Where a file of it is, as a user would write it."""
        local = local_path(self.url)
        return f"{self.url.rstrip('/')}/{name}" if local is None else str(local / name)

    def write(self, name: str, data: bytes) -> None:
        """Make or replace a file, whole or not at all; folders are made.

        Raises:
            OutputError: It cannot be written.
        """
        local = local_path(self.path(name))
        if local is not None:
            with written_whole(local, room=self._room(local)) as part:
                part.write_bytes(data)
            return
        with failures_told(self.path(name), OutputError, "written"):
            system, path = system_of(self.path(name))
            system.pipe_file(path, data)

    def read(self, name: str) -> bytes:
        """Content of a file.

        Raises:
            FileNotFoundError: There is none.
            OutputError: It cannot be read.
        """
        with failures_told(self.path(name), OutputError, "read"):
            local = local_path(self.path(name))
            if local is not None:
                return local.read_bytes()
            system, path = system_of(self.path(name))
            return bytes(system.cat_file(path))

    def read_all(self, names: Iterable[str]) -> dict[str, bytes]:
        """Content of several files, asked for at once; those that are missing are left out.

        Raises:
            OutputError: One cannot be read.
        """
        names = list(names)
        found = {}
        if self.is_local or len(names) <= 1:
            for name in names:
                with suppress(FileNotFoundError):
                    found[name] = self.read(name)
            return found
        with failures_told(self.url, OutputError, "read"):
            system, root = system_of(self.url)
            paths = {f"{root.rstrip('/')}/{name}": name for name in names}
            for path, data in system.cat(list(paths), on_error="return").items():
                if isinstance(data, Exception) and not isinstance(data, FileNotFoundError):
                    raise data
                if not isinstance(data, Exception):
                    found[paths[path]] = bytes(data)
        return found

    def names(self, below: str = "") -> list[str]:
        """Names of all files below a folder of it, or below itself, in order.

        Raises:
            OutputError: It cannot be listed.
        """
        return sorted(self.stamps(below))

    def stamps(self, below: str = "") -> dict[str, str]:
        """What the file system says of the state of all files below, by name: one listing.

        Raises:
            OutputError: It cannot be listed.
        """
        head = f"{below.strip('/')}/" if below else ""
        try:
            found = entries(self.path(below.strip("/")) if below else self.url)
        except FileNotFoundError:
            return {}
        except MeshError as error:
            raise OutputError(str(error)) from error
        return {
            head + entry.name: entry.stamp
            for entry in found
            if not entry.name.rpartition("/")[2].startswith(PART)
        }

    def remove(self, name: str) -> None:
        """Remove a file; where it is missing, nothing.

        Raises:
            OutputError: It cannot be removed.
        """
        self.remove_all([name])

    def remove_all(self, names: Iterable[str]) -> None:
        """Remove several files at once; those that are missing are no matter.

        Raises:
            OutputError: One cannot be removed.
        """
        names = list(names)
        for name in names if self.is_local else ():
            with (
                failures_told(self.path(name), OutputError, "removed"),
                suppress(FileNotFoundError),
            ):
                Path(self.path(name)).unlink()
        if self.is_local or not names:
            return
        with failures_told(self.url, OutputError, "removed"):
            system, root = system_of(self.url)
            paths = [f"{root.rstrip('/')}/{name}" for name in names]
            try:
                system.rm(paths)
            except FileNotFoundError:
                for path in paths:
                    with suppress(FileNotFoundError):
                        system.rm_file(path)

    def locked(self, name: str) -> Lock:
        """Lock the folder for this process; a lock is gone with its process, whatever ends it.

        Of an object store there is no lock.

        Args:
            name: File that is locked, made where it is missing.

        Raises:
            OutputError: Another one has it.
        """
        local = local_path(self.path(name))
        if local is None or fcntl is None:
            return Lock()
        with failures_told(self.path(name), OutputError, "locked"):
            descriptor = os.open(local, os.O_RDWR | os.O_CREAT, 0o666)
        lock = Lock(descriptor)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            lock.close()
            raise OutputError(
                f"{printable(self.url)}: another run is writing to it; wait for its end, or name "
                "another folder"
            ) from error
        except OSError:  # a file system that knows no locks
            lock.close()
        return lock

    @contextmanager
    def making(self, name: str) -> Iterator[Path]:
        """Give a temporary path of this machine to write a file to, which is put there whole.

        Raises:
            OutputError: It cannot be written.
        """
        target = local_path(self.path(name))
        with ExitStack() as stack:
            if target is not None:
                part = stack.enter_context(written_whole(target, room=self._room(target)))
            else:
                folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="grasp3d-"))
                part = Path(folder, name.rpartition("/")[2])
            try:
                yield part
            except OutputError as error:
                told = str(error).replace(str(part), printable(self.path(name)))
                raise OutputError(told) from error
            if target is None:
                with failures_told(self.path(name), OutputError, "written"):
                    system, path = system_of(self.path(name))
                    system.put_file(str(part), path)

    def remove_parts(self, older: float) -> None:
        """Remove what writers that were killed left behind.

        Args:
            older: Time since it was written to [s]; what is younger may be in work.
        """
        root = local_path(self.url)
        if root is not None:
            now = time.time()
            for path in list(root.glob(f"{PART}*")):
                with suppress(OSError):
                    if now - path.stat().st_mtime > older:
                        path.unlink()

    def _room(self, target: Path) -> Path | None:
        """Make a file's folder; where it is written until it is whole, so that none reads it."""
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            root = Path(self.path(""))
            same = root.stat().st_dev == target.parent.stat().st_dev
        except OSError as error:
            raise OutputError(
                f"{printable(str(target.parent))}: cannot be made ({error.strerror})"
            ) from error
        return root if same else None
