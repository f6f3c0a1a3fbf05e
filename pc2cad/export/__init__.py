"""Files: one module per format, behind registries of solids, meshes, splines and points.

Importing this package or its registries loads no CAD kernel; a format's module is imported when a
file of that format is written. `files` writes a file whole or not at all.
"""
