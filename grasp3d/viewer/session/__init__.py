"""A viewer without a window: what is chosen, computed and said."""
