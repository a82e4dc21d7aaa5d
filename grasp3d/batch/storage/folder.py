"""An output folder on any file system, with atomic writing of its files."""

import os
import tempfile
import time
import weakref
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from grasp3d.batch.storage.files import (
    convert_errors,
    file_system_of,
    list_entries,
    local_path,
    read_bytes,
)
from grasp3d.errors import MeshError, OutputError
from grasp3d.system.files import TEMPORARY_PREFIX, atomic_write
from grasp3d.system.names import printable

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]


class Lock:
    """Exclusive lock of a folder, held until it is closed or garbage-collected."""

    def __init__(self, descriptor: int | None = None) -> None:
        self._release = None if descriptor is None else weakref.finalize(self, os.close, descriptor)

    def close(self) -> None:
        """Release the lock."""
        if self._release is not None:
            self._release()


@dataclass(frozen=True)
class Folder:
    """A folder on any file system, which need not exist; names are relative paths with `/`."""

    url: str
    """Path or address as the user gives it: out, /data/out, s3://bucket/out."""

    @property
    def is_local(self) -> bool:
        """Whether it is on this machine's file system."""
        return local_path(self.url) is not None

    def path(self, name: str) -> str:
        """Return the path or address of a file in the folder."""
        local = local_path(self.url)
        return f"{self.url.rstrip('/')}/{name}" if local is None else str(local / name)

    def write(self, name: str, data: bytes) -> None:
        """Create or replace a file atomically; missing folders are created.

        Raises:
            OutputError: It cannot be written.
        """
        with self.atomic_write(name) as temporary:
            temporary.write_bytes(data)

    def read(self, name: str) -> bytes:
        """Return the content of a file.

        Raises:
            FileNotFoundError: There is no such file.
            OutputError: It cannot be read.
        """
        return read_bytes(self.path(name), OutputError)

    def read_all(self, names: Iterable[str]) -> dict[str, bytes]:
        """Return the contents of several files in one request; missing files are left out.

        Raises:
            OutputError: One cannot be read.
        """
        names = list(names)
        contents = {}
        if self.is_local or len(names) <= 1:
            for name in names:
                with suppress(FileNotFoundError):
                    contents[name] = self.read(name)
            return contents
        with convert_errors(self.url, OutputError, "read"):
            system, root = file_system_of(self.url)
            paths = {f"{root.rstrip('/')}/{name}": name for name in names}
            for path, data in system.cat(list(paths), on_error="return").items():
                if isinstance(data, Exception) and not isinstance(data, FileNotFoundError):
                    raise data
                if not isinstance(data, Exception):
                    contents[paths[path]] = bytes(data)
        return contents

    def names(self, subfolder: str = "") -> list[str]:
        """Return the sorted names of all files in the folder, or in a subfolder.

        Raises:
            OutputError: It cannot be listed.
        """
        return sorted(self.stamps(subfolder))

    def stamps(self, subfolder: str = "") -> dict[str, str]:
        """Return the stamps of all files in the folder, or in a subfolder, from one listing.

        Returns:
            By name, a text that changes when the file changes.

        Raises:
            OutputError: It cannot be listed.
        """
        head = f"{subfolder.strip('/')}/" if subfolder else ""
        try:
            entries = list_entries(self.path(subfolder.strip("/")) if subfolder else self.url)
        except FileNotFoundError:
            return {}
        except MeshError as error:
            raise OutputError(str(error)) from error
        return {
            head + entry.name: entry.stamp
            for entry in entries
            if not entry.name.rpartition("/")[2].startswith(TEMPORARY_PREFIX)
        }

    def remove_all(self, names: Iterable[str]) -> None:
        """Remove several files in one request; missing files are passed over.

        Raises:
            OutputError: A file cannot be removed.
        """
        names = list(names)
        for name in names if self.is_local else ():
            with (
                convert_errors(self.path(name), OutputError, "removed"),
                suppress(FileNotFoundError),
            ):
                Path(self.path(name)).unlink()
        if self.is_local or not names:
            return
        with convert_errors(self.url, OutputError, "removed"):
            system, root = file_system_of(self.url)
            paths = [f"{root.rstrip('/')}/{name}" for name in names]
            try:
                system.rm(paths)
            except FileNotFoundError:
                for path in paths:
                    with suppress(FileNotFoundError):
                        system.rm_file(path)

    def lock(self, name: str) -> Lock:
        """Lock the folder for this process; the operating system releases it with the process.

        An object store has no locks: there the lock has no effect.

        Args:
            name: File to lock, created if it is missing.

        Raises:
            OutputError: Another process holds the lock.
        """
        local = local_path(self.path(name))
        if local is None or fcntl is None:
            return Lock()
        with convert_errors(self.path(name), OutputError, "locked"):
            local.parent.mkdir(parents=True, exist_ok=True)
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
        except OSError:  # a file system without locks
            lock.close()
        return lock

    @contextmanager
    def atomic_write(self, name: str) -> Iterator[Path]:
        """Yield a temporary local path; the file written to it becomes the file `name`.

        Raises:
            OutputError: It cannot be written.
        """
        target = local_path(self.path(name))
        with ExitStack() as stack:
            if target is not None:
                temporary = stack.enter_context(
                    atomic_write(target, temporary_folder=self._temporary_folder(target))
                )
            else:
                folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="grasp3d-"))
                temporary = Path(folder, name.rpartition("/")[2])
            try:
                yield temporary
            except OutputError as error:
                message = str(error).replace(str(temporary), printable(self.path(name)))
                raise OutputError(message) from error
            if target is None:
                with convert_errors(self.path(name), OutputError, "written"):
                    system, path = file_system_of(self.path(name))
                    system.put_file(str(temporary), path)

    def remove_temporary_files(self, older: float, *, wait: bool = False) -> None:
        """Remove temporary files that killed processes left behind.

        Args:
            older: Least age [s]; younger files may still be written to.
            wait: Wait until the younger files are so old, unless they are written to meanwhile.
        """
        root = local_path(self.url)
        if root is None:
            return
        younger = False
        for path in list(root.glob(f"{TEMPORARY_PREFIX}*")):
            with suppress(OSError):
                if time.time() - path.stat().st_mtime > older:
                    path.unlink()
                else:
                    younger = True
        if younger and wait:
            time.sleep(older)
            self.remove_temporary_files(older)

    def _temporary_folder(self, target: Path) -> Path | None:
        """Create the folder of a file, and return the folder for its temporary file.

        That is this folder if it is on the same file system, so that listings of subfolders never
        contain temporary files.
        """
        parent, root = target.parent, Path(self.path(""))
        try:
            if not parent.is_dir():
                parent.mkdir(parents=True, exist_ok=True)
            same = root.stat().st_dev == parent.stat().st_dev
        except OSError as error:
            raise OutputError(
                f"{printable(str(parent))}: cannot be created ({error.strerror})"
            ) from error
        return root if same else None
