"""Files on any file system: this machine's, or an object store such as S3, by its address."""

from grasp3d.storage.addresses import local_path
from grasp3d.storage.copies import local_copy, read_text
from grasp3d.storage.folder import Folder, Lock
from grasp3d.storage.listing import Entry, entries, look, named_like

__all__ = [
    "Entry",
    "Folder",
    "Lock",
    "entries",
    "local_copy",
    "local_path",
    "look",
    "named_like",
    "read_text",
]
