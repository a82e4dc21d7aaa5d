"""Parquet: the columns of [CSV](#csv), and what JSON states of all grasps in the metadata."""

from dataclasses import replace

from grasp3d.formats.format import register
from grasp3d.formats.grasps.csv import FORMAT

register(
    replace(FORMAT, name="parquet", title="Parquet", suffixes=(".parquet",), about=__doc__ or "")
)
