"""A STEP file held against itself and against its equation, without the kernel that wrote it.

`receipt` reads a file of anybody's; `verification` holds it against a point equation. Everything is
read and computed here, from the file's own text: no module that makes such files is imported.
"""
