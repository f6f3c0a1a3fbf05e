"""The CAD kernel: our plain data to kernel objects, and what the kernel's solid really holds.

`to_kernel` and `build` make the solid, `from_kernel` reads curves and surfaces back, `integrals`
integrates over what was read, `booleans` joins solids and keeps the names of faces, `triangles`
meshes the boundary and holds the mesh against the solid.
"""
