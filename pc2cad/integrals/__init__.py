"""Volume, area, centroid and inertia of the solid, integrated from the equation itself.

`exact` for polynomial maps over the fractions, `quadrature` by adaptive Gauss rules elsewhere;
the quadrature watches det J at every node that it sees, unless its sign is proved.
"""
