"""Wan & Howe 2018 recomputed: figures, numbers, and differences from the paper."""
