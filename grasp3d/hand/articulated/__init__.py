"""Hands with joints: their links, motions and contacts."""
