"""Surfaces: faces, normals, trees over faces, rays, patches, walks."""
