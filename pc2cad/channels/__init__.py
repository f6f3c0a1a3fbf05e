"""Channels: sections carried along guides, with walls, as point equations, and what limits them.

`guides`, `frames` and `curves` are the three things that a channel is made of, `channel` puts
them together, `wires` takes guides and sections from the kernel's wires, and `limits` finds how
far bend, wall and clearance are from breaking the solid.
"""
