"""Exceptions. Every message states what is wrong, where, and what would be right."""


class GraspError(Exception):
    """Base class: an error that a user can cause and correct; printed in one line."""


class SettingError(GraspError):
    """A setting outside its range, or settings that contradict each other."""


class ContactError(GraspError):
    """Contacts or wrenches that are no grasp: wrong shapes, or values that are not finite."""


class MeshError(GraspError):
    """A mesh file or array that cannot be read as a surface."""


class FileUnreadError(GraspError):
    """A file that could not be read this time, for a reason that need not lie in the file."""


class SearchCoverageError(GraspError):
    """A result that would need grasps outside the cone that was searched."""


class WarningError(GraspError):
    """What is a warning otherwise, where warnings are errors: `running(strict=True)`, --strict."""


class OutputError(GraspError):
    """A result that cannot be written to the requested path."""
