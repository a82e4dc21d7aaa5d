"""Grippers: collisions, reach, and jaws that close on a surface."""
