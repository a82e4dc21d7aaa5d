"""Pages of a library of labelled meshes, for any browser, without a network."""

from grasp3d.batch.report.objects import object_script
from grasp3d.batch.report.pages import Writable, write_report
from grasp3d.batch.report.thumbnails import thumbnail

__all__ = ["Writable", "object_script", "thumbnail", "write_report"]
