"""Which plane, quadric, torus, revolution, extrusion or conic a function lies on, and the proof."""
