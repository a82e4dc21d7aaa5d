"""Cameras, lights and colours of rendered pictures, and whether OpenGL is there to render them."""
