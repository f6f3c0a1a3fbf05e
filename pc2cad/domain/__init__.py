"""The map M on arrays, its restrictions to sides and edges, and the analysis of its boundary.

`map` evaluates M and its derivatives, `analysis` answers the topology room's questions,
`restrictions` is M on one cell of the box, as a function that can be fitted, recognised and
bounded.
"""
