"""Which sides of the parameter box bound the solid, and how they meet: the boundary complex.

It asks yes/no questions about the map (`questions`) and knows no coordinates. `quotient` glues
what coincides, drops what collapses and keeps what bounds; `complex` is the result as plain data.
"""
