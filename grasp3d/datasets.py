"""Labelled libraries for training: the objects of a library, one by one, as arrays."""

import io
from pathlib import Path
from typing import Any

import numpy as np

from grasp3d.batch.chunks import VERTICES, Chunk, open_library
from grasp3d.errors import SettingError
from grasp3d.settings.units import METRES
from grasp3d.stability.label import Label
from grasp3d.surface.fields import Array

CHUNKS = 16
"""Number of chunks of a library that are kept in memory."""

_GRASPS = ("label", "score", "critical_angle", "epsilon", "opening", "points", "normals", "pose")
"""Fields of the best grasps that items contain."""


class LabelledObjects:
    """The labelled objects of a library, as a map-style data set of PyTorch.

    An item is a dict. For the vertices of the surface: `points` [m] and outward `normals`, shape
    (V, 3), if the library has surfaces; `label` (0 U, 1 M, 2 S), `critical_angle` and `margin`
    [rad], shape (V,). For the best grasps, in the order of their scores: `grasp_label`,
    `grasp_score`, `grasp_critical_angle`, `grasp_epsilon`, `grasp_opening` [m], shape (k,);
    `grasp_points` and outward `grasp_normals`, shape (k, n, 3); `grasp_pose`, shape (k, 4, 4), from
    the gripper's frame to the mesh's, nan without a gripper. Also `mesh`, the object's name.

    Surfaces are read fastest from a library made with `--surfaces tar`.

    Args:
        folder: Folder of the results of `label_library`, or its address.
        tensors: Whether items contain PyTorch tensors instead of arrays.

    Raises:
        OutputError: There are no labels.
        SettingError: PyTorch is not installed.

    Example:
        >>> import grasp3d
        >>> from grasp3d.datasets import LabelledObjects
        >>> from grasp3d.jobs import ClusterSettings
        >>> import trimesh
        >>> _ = trimesh.creation.box([0.08, 0.05, 0.03]).export("box.stl")
        >>> here = ClusterSettings(workers=0)
        >>> _ = grasp3d.label_library(["box.stl"], "boxes", cluster=here, report=False)
        >>> objects = LabelledObjects("boxes")
        >>> box = objects[0]
        >>> len(objects), box["mesh"], box["points"].shape == (len(box["label"]), 3)
        (1, 'box.stl', True)
    """

    def __init__(self, folder: str | Path, *, tensors: bool = False) -> None:
        self._library, self._tensor = open_library(folder), _from_numpy() if tensors else None
        meshes, table = self._library.meshes, self._library.table(["mesh", "outcome"])
        self._where = sorted(  # in the order of the files, so that each is read once
            meshes[mesh]
            for mesh, outcome in zip(*table.to_pydict().values(), strict=True)
            if outcome == "labelled"
        )
        self._loaded: dict[int, list[dict[str, Any]]] = {}

    def __len__(self) -> int:
        """Number of the objects."""
        return len(self._where)

    def __getitem__(self, index: int) -> dict[str, Any]:
        """Return one object as a dict, see the class."""
        number, row = self._where[index]
        chunk = self._library.chunks[number]
        if number not in self._loaded:
            if len(self._loaded) == CHUNKS:
                del self._loaded[next(iter(self._loaded))]
            self._loaded[number] = _items_of(chunk)
        item = dict(self._loaded[number][row])
        surface = item.pop("surface")
        metres = METRES.get(item.pop("file_unit"), 1.0)
        if surface.endswith(".ply"):
            labels = self._library.labels(item["mesh"])
            item |= {"points": labels.mesh.vertices, "normals": -labels.mesh.normals}
        elif surface:
            [(_, data)] = chunk.surfaces([surface])
            with np.load(io.BytesIO(data)) as arrays:
                factor = metres * float(str(arrays["setting_scale"]))
                item |= {"points": factor * arrays["vertices"], "normals": arrays["normal"]}
        if self._tensor is None:
            return item
        return {
            name: one if isinstance(one, str) else self._tensor(np.array(one))
            for name, one in item.items()
        }

    def shuffled(self, seed: int) -> list[int]:
        """Return the objects' indices in a random order that reads each file once.

        The list can serve as a PyTorch `Sampler`: the files are in random order, and so are the
        objects of each file.

        Args:
            seed: Seed of the random order.
        """
        keys = np.random.default_rng(seed).random((len(self._library.chunks) + len(self), 1))[:, 0]
        files, objects = np.split(keys, [len(self._library.chunks)])
        chunks = np.array([number for number, _ in self._where], dtype=int)
        return [int(one) for one in np.lexsort((objects, files[chunks]))]


def _items_of(chunk: Chunk) -> list[dict[str, Any]]:
    """Contents of an item for each row of a chunk, and the name and unit of its surface."""
    names = ["mesh", "surface", "file_unit"]
    table = chunk.read([*names, *(f"vertex_{name}" for name in VERTICES), "grasps"])
    grasps = table["grasps"].combine_chunks()
    columns = {name: table[name].to_pylist() for name in names}
    columns |= {name: _split(table[f"vertex_{name}"].combine_chunks()) for name in VERTICES}
    starts = grasps.offsets.to_numpy()[1:-1]
    columns |= {
        f"grasp_{name}": np.split(_grasp_values(grasps.flatten(), name), starts) for name in _GRASPS
    }
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def _split(lists: Any) -> list[Array]:
    """The lists of a column as arrays."""
    return np.split(lists.flatten().to_numpy(), lists.offsets.to_numpy()[1:-1])


def _grasp_values(grasps: Any, name: str) -> Array:
    """Values of one field of grasps, one row per grasp."""
    values, count = grasps.field(name), len(grasps)
    if name == "label":
        return np.array([Label[text] for text in values.to_pylist()], dtype=np.int8)
    if name == "pose":
        poses = np.full((count, 16), np.nan)
        poses[values.value_lengths().to_numpy() > 0] = values.flatten().to_numpy().reshape(-1, 16)
        return poses.reshape(-1, 4, 4)
    if name in {"points", "normals"}:
        flat = values.flatten().flatten().to_numpy()
        return flat.reshape(count, -1, 3) if count else np.zeros((0, 2, 3))
    return np.asarray(values.to_numpy())


def _from_numpy() -> Any:
    try:
        import torch  # type: ignore[import-not-found, unused-ignore]
    except ImportError as error:
        text = "tensors need PyTorch, which is not installed; leave them out for NumPy's arrays"
        raise SettingError(text) from error
    return torch.from_numpy
