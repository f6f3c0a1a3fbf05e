"""Several bodies to one solid: Booleans of compiled parts, and what is known of their edges.

`bodies` carries out the Boolean expression of a template step by step and holds every step
against sums of volumes; `intersection_edges` proves how far the kernel's edges are from both
faces.
"""
