"""A part as one self-contained page, or served on loopback and recomputed live.

The page stands on three.js (MIT), two unmodified files of its npm package 0.170.0 in `assets`:
the library that web CAD viewers are built on, small enough to travel in every page, and open
enough to cap a section and to say on hover what is known of a face. CadQuery's users know
three-cad-viewer, which stands on it too, but shows neither. No maintained Python package ships
the files.
"""
