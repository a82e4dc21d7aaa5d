"""The search for grasps on a surface."""
