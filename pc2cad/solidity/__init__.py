"""Whether the image is one solid: orientation, self-intersection, winding numbers.

Locally the sign of det J (`orientation`, proved by `jacobian_proof`); globally the boundary, cut
into cells (`face_mesh`) in a hierarchy of boxes and cones (`bounding_volumes`), must not meet
itself (`self_intersection`) and must wind once about inner images (`winding_number`).
"""
