"""Files of grasp poses: the project's own, and those of robots, simulators and data sets."""

from grasp3d.grasps.pose_files.files import SUFFIXES, holds_poses, read_poses, write_poses

__all__ = ["SUFFIXES", "holds_poses", "read_poses", "write_poses"]
