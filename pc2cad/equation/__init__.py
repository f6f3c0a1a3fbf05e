"""Points and vectors of the point calculus, their language, and the point equation over its box.

`Point` carries the weight that tells points from free vectors; `syntax` and `language` turn text
into them, and nothing is ever evaluated by Python. `PointEquation` is what the rest of the
pipeline is given.
"""
