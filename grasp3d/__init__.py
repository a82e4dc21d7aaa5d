"""Where on an object is a grasp reliable for a tactile fingertip of known resolution?

Conventions: positions in the mesh's frame, lengths in metres, angles in radians, normals inward.

This module exports the names for everyday use, which `__init__.pyi` lists. Import the others from
their packages: `grasp3d.contact`, `quality`, `stability`, `mesh`, `surface`, `grasps`, `diagnosis`,
`planar`, `sweeps`, `formats`, `batch`, `viewer` and `errors`.
"""

from lazy_loader import attach_stub

from grasp3d.system.documents import package_version

# Names are imported when they are first used, which keeps `grasp3d --help` fast.
_public_name, _, __all__ = attach_stub(__name__, __file__)
__all__ += ["__version__"]


def __getattr__(name: str) -> object:
    return package_version() if name == "__version__" else _public_name(name)


def __dir__() -> list[str]:
    return __all__
