"""The equation room: text and Python expressions become one frozen tree, and nothing else does.

The tree is the only truth: NumPy evaluation, derivatives and exact polynomial forms are read off
it. This room never sees the CAD kernel.
"""
