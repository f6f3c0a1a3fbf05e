"""Volume meshes of the equation's own grid, with named sides, and tetrahedra of the solid.

`hexahedra` maps a (u, v, w) grid and merges what the solid closes, `ogrid` has hexahedra only,
`quality` refuses inverted elements, `tetrahedra` asks gmsh.
"""
