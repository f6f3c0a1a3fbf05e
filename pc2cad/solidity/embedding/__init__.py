"""Proof that built faces meet nowhere but where they are joined.

The faces are sheets of Bézier patches, whose control points' convex hulls hold them. Pairs of
parts are separated by planes, or, where they are joined along an edge or in a vertex, shown to meet
there only; what is neither is halved.
"""
