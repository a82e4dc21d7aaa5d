import json
from pathlib import Path

import duckdb
import numpy as np
import pandas as pd
import polars as pl
import pyarrow.parquet as pq
import pytest

from grasp3d import GraspModel, Sampling, label_surface, load_mesh
from grasp3d.errors import OutputError
from grasp3d.formats import write_fields
from grasp3d.formats.surface_files import writer_for
from grasp3d.surface.vertex_fields import Reason
from tests.formats.test_writing import labels
from tests.helpers import shapes

NUMBERS = (
    "critical_angle", "critical_angle_best", "max_resolution", "margin", "epsilon", "epsilon_min",
    "epsilon_max", "opening", "grip",
)  # fmt: skip


@pytest.mark.slow
def test_other_libraries_read_a_row_for_each_vertex(tmp_path: Path) -> None:
    path = tmp_path / "out.parquet"
    writer_for(path)(path, labels())
    mesh = labels().mesh
    table = duckdb.read_parquet(str(path))
    for read in (pd.read_parquet(path), pl.read_parquet(path), table.df()):
        for k, axis in enumerate("xyz"):
            assert np.array_equal(np.asarray(read[axis]), mesh.file_points[:, k])
            assert np.asarray(read[f"n{axis}"]) == pytest.approx(-mesh.normals[:, k], abs=1e-6)
            partner = np.asarray(read[f"partner_2_{axis}"])
            assert np.array_equal(partner, labels().partners[:, 0, k], equal_nan=True)
            normal = np.asarray(read[f"partner_2_n{axis}"])
            known = -labels().partner_normals[:, 0, k]
            assert np.array_equal(normal, known, equal_nan=True)
        assert np.asarray(read["area"]).sum() == pytest.approx(mesh.vertex_areas.sum())
        for name in NUMBERS:
            known = getattr(labels(), name)
            assert np.array_equal(np.asarray(read[name]), known, equal_nan=True)
        codes = [{"U": 0, "M": 1, "S": 2}[label] for label in read["label"]]
        assert np.array_equal(codes, labels().label)
        reasons = [Reason[reason.upper()] for reason in read["reason"]]
        assert np.array_equal(reasons, labels().reason)


@pytest.mark.slow
def test_the_schema_has_small_codes_all_digits_and_the_settings(tmp_path: Path) -> None:
    write_fields(tmp_path / "out.parquet", labels())
    file = pq.ParquetFile(tmp_path / "out.parquet")
    kinds = {field.name: str(field.type) for field in file.schema_arrow}
    assert list(kinds)[:8] == ["x", "y", "z", "nx", "ny", "nz", "area", "label"]
    assert (kinds["x"], kinds["epsilon"], kinds["grip"]) == ("double", "double", "int8")
    assert kinds["label"].startswith("dictionary<values=string")
    assert file.metadata.row_group(0).column(0).compression == "ZSTD"
    written = json.loads(file.schema_arrow.metadata[b"grasp3d"])
    assert (written["friction"], written["unit"], written["max_opening"]) == (0.75, "cm", 0.003)
    assert sum(file.read().column(name).null_count for name in kinds) == 0


def test_every_other_finger_has_its_own_columns(tmp_path: Path) -> None:
    mesh = load_mesh(shapes.sphere(1), max_edge=0.5)
    found = label_surface(mesh, GraspModel(fingers=3), sampling=Sampling(candidates=16))
    write_fields(tmp_path / "out.parquet", found)
    read = pd.read_parquet(tmp_path / "out.parquet")
    for finger in (2, 3):
        columns = [f"partner_{finger}_{axis}" for axis in "xyz"]
        assert np.array_equal(read[columns], found.partners[:, finger - 2], equal_nan=True)
    with pytest.raises(OutputError, match="cannot be written"):
        write_fields(tmp_path / "no" / "out.parquet", found)
