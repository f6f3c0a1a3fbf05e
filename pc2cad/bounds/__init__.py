"""Proved bounds: intervals and Taylor models of trees, and how far trees are from splines.

`taylor_models` encloses trees on polydiscs, `deviation` bounds the distance between a function
and a spline at equal parameters, `slices` does so for volumes, `edge_bounds` for edges between
bodies. Everything here rounds outwards.
"""
