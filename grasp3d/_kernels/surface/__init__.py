"""Surfaces: faces, normals, trees over faces, rays, walks."""
