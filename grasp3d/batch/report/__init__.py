"""The report: a web page of a library of labelled meshes, readable without a network."""

from grasp3d.batch.report.pages import write_report
from grasp3d.batch.report.thumbnails import thumbnail

__all__ = ["thumbnail", "write_report"]
