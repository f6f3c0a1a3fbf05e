"""Meshes: triangles of the solid's boundary."""
