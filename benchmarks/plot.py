"""Draw accuracy against time: the table of whole solids, one panel for each.

python -m benchmarks.plot docs/benchmarks.md docs/pictures/benchmarks.svg
"""

from __future__ import annotations

import sys
from pathlib import Path

#: how a route begins in the table -> what it is called, its colour and its mark
ROUTES = {
    "pc2cad, faces fitted, built": ("pc2cad, faces fitted and built", "tab:blue", "o"),
    "pc2cad, derived": ("pc2cad, derived, proved and built", "tab:blue", "D"),
    "pc2cad, everything": ("pc2cad, everything", "tab:blue", "s"),
    "Frenet pipes, inner": ("pipe cut from pipe", "tab:orange", "v"),
    "Frenet pipes, caps": ("pipes sewn to caps", "tab:orange", "^"),
    "Solid.sweep": ("Solid.sweep", "tab:brown", "x"),
    "makeSplineApprox": ("makeSplineApprox, sewn", "tab:green", "P"),
    "GeomAPI": ("interpolation, sewn", "tab:red", "X"),
    "parametricSurface, tight": ("parametricSurface, tight, sewn", "tab:purple", "p"),
    "parametricSurface, sewn": ("parametricSurface, sewn", "tab:purple", "1"),
}
Place = tuple[float, float]


def read(text: str) -> dict[str, dict[str, list[Place]]]:
    """Return of each solid the seconds and deviations of each route."""
    rows = text.partition("## Whole solids at equal deviation")[2].partition("\n## ")[0]
    found: dict[str, dict[str, list[Place]]] = {}
    waiting: list[tuple[str, float]] = []
    for line in rows.splitlines():
        cells = [cell.strip() for cell in line.strip()[1:-1].split("|")]
        if len(cells) != 11 or cells[0] in ("solid", "---"):
            continue
        solid, route, seconds = cells[0], cells[2], float(cells[3])
        name = next((key for key in ROUTES if route.startswith(key)), None)
        if not cells[8]:  # the first steps of the row below: its deviation
            waiting += [(name, seconds)] * (name is not None)
            continue
        if name is None:
            raise SystemExit(f"no mark for the route {route!r}")
        deviation = float(cells[8].split()[0])
        for key, spent in [*waiting, (name, seconds)]:
            found.setdefault(solid, {}).setdefault(key, []).append((spent, deviation))
        waiting = []
    return found


def draw(found: dict[str, dict[str, list[Place]]], path: Path) -> None:
    import matplotlib as mpl

    mpl.use("svg")
    mpl.rcParams |= {"svg.hashsalt": "pc2cad", "svg.fonttype": "none"}
    from matplotlib import pyplot

    figure, panels = pyplot.subplots(
        1, len(found), figsize=(11, 5), sharex=True, sharey=True, layout="constrained"
    )
    for panel, (solid, routes) in zip(panels, found.items(), strict=True):
        for key, (name, colour, mark) in ROUTES.items():
            seconds, deviations = zip(*sorted(routes[key]), strict=True)
            panel.loglog(seconds, deviations, mark, color=colour, label=name, alpha=0.8)
        panel.set(title=solid, xlabel="CPU seconds")
        panel.grid(alpha=0.3)
    panels[0].set_ylabel("largest deviation measured")
    handles, names = panels[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=4, frameon=False)
    figure.savefig(path, metadata={"Date": None})


if __name__ == "__main__":
    draw(read(Path(sys.argv[1]).read_text()), Path(sys.argv[2]))
