"""Carriers of faces and edges as plain data, splines, and how carriers are recognised.

It knows neither the CAD kernel nor which face is next to which. `carriers` are the surfaces and
curves of CAD as frozen data; `splines` has the spaces, fits and exact changes of basis;
`recognition` finds the carrier from a separable form or from points.
"""
