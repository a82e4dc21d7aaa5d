"""Parquet: the columns of [CSV](#csv), with the header of JSON in the metadata."""

from dataclasses import replace

from grasp3d.formats.format import register
from grasp3d.formats.grasps.csv import FORMAT

register(
    replace(FORMAT, name="parquet", title="Parquet", suffixes=(".parquet",), about=__doc__ or "")
)
