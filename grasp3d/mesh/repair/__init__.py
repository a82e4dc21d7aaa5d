"""Mesh repair: welding, removal of degenerate faces, winding, hole filling, union of bodies."""
