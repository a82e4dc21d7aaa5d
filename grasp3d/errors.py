"""Exceptions. Every message states what is wrong, where, and what would be right."""


class GraspError(Exception):
    """Base class of errors that a user can cause and correct; printed in one line."""


class SettingError(GraspError):
    """A setting outside its range, or settings that contradict each other."""


class ContactError(GraspError):
    """Contacts or wrenches that do not form a grasp: wrong shapes or non-finite values."""


class MeshError(GraspError):
    """A mesh file or array that cannot be read as a surface."""


class FileUnreadError(GraspError):
    """A file that could not be read this time, for a reason that may lie outside the file."""


class SearchCoverageError(GraspError):
    """A result that would need grasps outside the searched cone."""


class WarningError(GraspError):
    """A warning raised as an error, by `running(strict=True)` or --strict."""


class OutputError(GraspError):
    """A result that cannot be written to the requested path."""
