"""Make the pictures of README.md and docs/: ``python docs/make_pictures.py [NAME …]``.

Each is what ``pc2cad render`` draws with the arguments that stand beside its name; `readme` is the
part of README.md's first program.
"""

from __future__ import annotations

import os
import re
import sys
import tempfile
from pathlib import Path
from typing import Any

from pc2cad.cli.main import main as pc2cad

FOLDER = Path(__file__).resolve().parent / "pictures"
PYRAMID = ["--size", "640x520"]
CHANNEL = ["--view", "1.6,-0.35,1.0", "--size", "800x520", "--colours"]

#: picture -> template and options
PICTURES: dict[str, list[str]] = {
    "fig1_points": ["pyramid", *PYRAMID, "--points", "20,20,30"],
    "fig1_million": ["pyramid", *PYRAMID, "--points", "100,100,100"],
    "fig2_pyramid": ["pyramid", *PYRAMID, "--colours", "--labels"],
    "fig3_truncated": ["pyramid_truncated", *PYRAMID, "--colours", "--labels"],
    "fig5_cut": ["pyramid_cut", *PYRAMID, "--colours", "--labels"],
    "channel_ellipse": ["channel_ellipse", *CHANNEL],
    "channel_sine": ["channel_sine", *CHANNEL, "--view", "1.7,-0.25,0.9", "--size", "960x640"],
    "channel_contour": ["channel_contour", *CHANNEL],
    "spring": ["spring", *PYRAMID, "--colours"],
    "trefoil": ["trefoil", *PYRAMID, "--colours"],
    "duct": ["duct", *PYRAMID, "--colours"],
    "square_to_round": ["square_to_round", *PYRAMID, "--colours"],
    "layered_pipe": ["layered_pipe", *PYRAMID, "--colours"],
    "figure_of_eight": ["figure_of_eight", *PYRAMID, "--colours"],
    "limit_faces": ["pyramid_cut", *PYRAMID, "--colours", "--labels", "--explode", "0.35"],
    "limit_faces_channel": ["channel_ellipse", *CHANNEL, "--labels", "--explode", "0.3"],
    "parameter_lines": ["turned_ring", "--size", "640x520", "--colours", "--isolines", "9"],
    "bodies": ["pipe_cross", "--size", "640x520", "--colours", "--labels"],
    "bodies_apart": ["pipe_cross", "--size", "640x520", "--colours", "--explode", "0.3"],
    "dished_end": ["dished_end", *PYRAMID, "--colours"],
    "wigley_hull": ["wigley_hull", *PYRAMID, "--colours"],
    "aspheric_lens": ["aspheric_lens", *PYRAMID, "--colours"],
    "naca_wing": ["naca_wing", *PYRAMID, "--colours"],
    "disc_cam": ["disc_cam", *PYRAMID, "--colours"],
    "bellows": ["bellows", *PYRAMID, "--colours"],
    "stellarator_wall": ["stellarator_wall", *PYRAMID, "--colours"],
    "coil": ["coil", *PYRAMID, "--colours"],
    "gerotor": ["gerotor", *PYRAMID, "--colours"],
    "gear": ["gear", *PYRAMID, "--colours"],
    "gear_tooth": ["gear_tooth", *PYRAMID, "--colours"],
    "bolt": ["bolt", *PYRAMID, "--colours"],
    "propeller_blade": ["propeller_blade", *PYRAMID, "--colours"],
    "deviation": ["channel_ellipse", "--view", "1.6,-0.35,1.0", "--map", "deviation"],
    "thickness": ["channel_sine", "--view", "1.7,-0.25,0.9", "--map", "thickness"],
}


def readme() -> None:
    """Run README.md's first program and draw its part."""
    text = (FOLDER.parents[1] / "README.md").read_text()
    found = re.search(r"^```python\n(.*?)^```", text, re.M | re.S)
    assert found is not None
    names: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        exec(found[1], names)
    names["part"].render(FOLDER / "readme.png", view=(-1.2, -1, 0.7), size=(960, 560), colours=True)


def main(names: list[str]) -> int:
    """Make the pictures of these names, all of them without any."""
    FOLDER.mkdir(exist_ok=True)
    for name in names or ["readme", *PICTURES]:
        if name == "readme":
            readme()
            continue
        code = pc2cad(["render", *PICTURES[name], "-o", str(FOLDER / f"{name}.png")])
        if code:
            return code
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
