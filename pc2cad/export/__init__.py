"""Files out of a solid: one module per format behind one registry.

Importing this package or its registry loads no CAD kernel; a format's module is imported when a
file of that format is written.
"""
