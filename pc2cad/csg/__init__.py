"""Several bodies to one solid: Booleans of compiled parts, and what is known of their edges.

`ways` tries the ways to join bodies in order; `bodies` carries out the Boolean expression of a
template step by step and holds every step against sums of volumes; `own_edges` finds edges between
bodies from both faces, and `intersection_edges` proves how far edges are from both.
"""
