"""Cameras and lights of rendered pictures, and whether OpenGL is there to render them."""
