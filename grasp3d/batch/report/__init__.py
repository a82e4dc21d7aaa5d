"""The report: web pages of a library of labelled meshes, readable without a network."""

from grasp3d.batch.report.index import write_report
from grasp3d.batch.report.objects import write_object

__all__ = ["write_object", "write_report"]
