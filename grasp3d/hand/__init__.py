"""Grippers: their shape, what they can reach, and what they stand beside."""
