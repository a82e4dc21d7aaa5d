"""The formats of files of grasp poses: a module for each, called as its format."""
