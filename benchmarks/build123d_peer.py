"""build123d's surface from points, run by the interpreter of its own virtual environment.

    python build123d_peer.py POINTS.npy RESULT.npz [tol=1e-6 min_deg=3 max_deg=8 …]

It needs another build of the kernel's bindings than CadQuery, so it cannot share a process with the
others; its time is taken inside, after imports.
"""

import sys
import time

import numpy as np
from build123d import Face, Vector
from OCP.BRep import BRep_Tool

points = np.load(sys.argv[1]).tolist()
options = {
    name: int(value) if name.endswith("deg") else float(value)
    for name, value in (text.split("=") for text in sys.argv[3:])
}
Face.make_surface_from_array_of_points([[Vector(*p) for p in row[:4]] for row in points[:4]])
start = time.process_time()
face = Face.make_surface_from_array_of_points(
    [[Vector(*p) for p in row] for row in points], **options
)
seconds = time.process_time() - start
surface = BRep_Tool.Surface_s(face.wrapped)
poles = [
    [surface.Pole(i + 1, j + 1) for j in range(surface.NbVPoles())]
    for i in range(surface.NbUPoles())
]
np.savez(
    sys.argv[2],
    seconds=seconds,
    poles=[[(p.X(), p.Y(), p.Z()) for p in row] for row in poles],
    degrees=(surface.UDegree(), surface.VDegree()),
    u=np.repeat(
        [surface.UKnot(i + 1) for i in range(surface.NbUKnots())],
        [surface.UMultiplicity(i + 1) for i in range(surface.NbUKnots())],
    ),
    v=np.repeat(
        [surface.VKnot(i + 1) for i in range(surface.NbVKnots())],
        [surface.VMultiplicity(i + 1) for i in range(surface.NbVKnots())],
    ),
)
