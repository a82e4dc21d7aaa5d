"""The one family of errors: each message says what is wrong, where, and what would be right."""


class GraspError(Exception):
    """Anything that a user can cause and mend; the command line prints it as one line."""


class SettingError(GraspError):
    """A setting outside its range, or settings that contradict each other."""


class ContactError(GraspError):
    """Contacts, or wrenches, that are no grasp: wrong shapes, numbers that are none."""


class MeshError(GraspError):
    """A mesh file or array that cannot be read as a surface."""


class MeshUnreadError(MeshError):
    """A mesh that could not be read this time; nothing says that it is the mesh's fault."""


class SearchCoverageError(GraspError):
    """A question that the grasps searched so far cannot answer."""


class OutputError(GraspError):
    """A result that cannot be written where it was asked for."""
