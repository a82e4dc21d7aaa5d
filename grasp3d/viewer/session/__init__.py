"""A viewer session, independent of the display."""
