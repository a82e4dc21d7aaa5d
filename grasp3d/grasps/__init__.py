"""Whole grasps on a surface: given or found, evaluated, chosen, read and written."""
