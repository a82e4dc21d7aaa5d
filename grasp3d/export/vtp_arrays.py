"""Arrays of a VTP."""

from pathlib import Path
from typing import Any

VtpArrays = dict[str, dict[str, Any]]


def vtp_arrays(path: Path) -> VtpArrays:
    """The arrays of a VTP.

    Args:
        path: The file.

    Returns:
        Positions and faces under `surface`, point, cell and field data by name; empty: it is no
        VTP of triangles.
    """
    import numpy as np
    from vtkmodules.vtkCommonCore import vtkObject

    vtkObject.GlobalWarningDisplayOff()
    import pyvista

    data = pyvista.read(path)
    if not isinstance(data, pyvista.PolyData) or not data.is_all_triangles:
        return {}
    faces = np.array(data.faces, dtype=np.int64).reshape(-1, 4)[:, 1:]
    parts = {"points": data.point_data, "cells": data.cell_data, "fields": data.field_data}
    return {
        "surface": {"vertices": np.array(data.points), "faces": faces},
        **{
            part: {name: np.array(arrays[name]) for name in arrays.keys()}  # noqa: SIM118
            for part, arrays in parts.items()
        },
    }
