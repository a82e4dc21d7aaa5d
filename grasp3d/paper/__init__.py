"""Wan & Howe 2018 recomputed: their figures, their numbers, and where ours differ."""
