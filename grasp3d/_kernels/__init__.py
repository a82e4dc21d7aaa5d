"""Compiled loops: arrays in, arrays out; no checks, no meshes, no random numbers."""
