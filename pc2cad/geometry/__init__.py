"""The geometry room: carriers as plain data and the ways to get them from functions.

It knows neither the CAD kernel nor which face is next to which.
"""
