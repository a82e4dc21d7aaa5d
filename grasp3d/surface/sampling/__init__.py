"""Candidate grasps through the vertices of a surface."""
