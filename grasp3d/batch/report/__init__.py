"""The report: web pages of a library of labelled meshes, readable without a network."""

from grasp3d.batch.report.objects import object_script
from grasp3d.batch.report.pages import write_report
from grasp3d.batch.report.thumbnails import thumbnail

__all__ = ["object_script", "thumbnail", "write_report"]
