"""Template files: the format, its strict reader, parameters, bodies, and the shipped ones.

`Template.bind` gives a `PointEquation` for values of the parameters; `BodiesTemplate` several,
with the Booleans that join them. `coordinatewise` writes a template out coordinate by coordinate,
as the paper does.
"""
