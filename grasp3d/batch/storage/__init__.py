"""Access to files by path or address, on this machine or an object store such as S3."""

from grasp3d.batch.storage.files import (
    Entry,
    find_entry,
    list_entries,
    local_copy,
    local_path,
    name_matcher,
    read_text,
)
from grasp3d.batch.storage.folder import Folder, Lock

__all__ = [
    "Entry",
    "Folder",
    "Lock",
    "find_entry",
    "list_entries",
    "local_copy",
    "local_path",
    "name_matcher",
    "read_text",
]
