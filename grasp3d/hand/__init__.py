"""Grippers and hands: their shape, the grasps that they reach, and the scene around them."""
