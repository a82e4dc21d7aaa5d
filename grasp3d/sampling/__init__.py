"""Candidate grasps through a place on the surface."""
