"""Formats of files of grasp poses, one module for each, named after its format."""
