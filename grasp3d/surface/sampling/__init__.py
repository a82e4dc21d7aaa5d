"""Search for the best grasps through the vertices of a surface."""
