"""How time and memory grow with faces, poles, modes of a Fourier series, layers and bodies.

    python -m benchmarks.sizes [--quick] [--plot FILE.svg]

Each row is one compilation in a process of its own, without the imports: CPU seconds, and the
largest memory above that of an empty process. The last column is the slope in the table, log of
the time over log of the size since the row above: 1 where the cost is linear.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
from pathlib import Path

#: what grows -> its sizes; the last one is left out with --quick
SIZES = {
    "faces": (10, 40, 160, 500, 2000),
    "poles": (1_000, 10_000, 100_000, 1_000_000),
    "modes": (10, 30, 100, 300, 1000),
    "layers": (2, 5, 10, 20, 30),
    "bodies": (2, 6, 20, 60, 200),
}


def faces(count: int):
    """Return a tube on a polygon, of so many plane faces: walls in and out, and two ends."""
    import pc2cad as pc

    u, v, w = pc.parameters()
    x, y = pc.regular_polygon((count - 2) // 2, 10, v)
    return pc.point(x * (1 + w / 5), y * (1 + w / 5), 20 * u)


def poles(count: int):
    """Return the shipped elliptic channel; see `_options` for how many poles it takes."""
    from pc2cad.templates.file import read_template
    from pc2cad.templates.shipped import find_template

    return read_template(find_template("channel_ellipse")).bind()


def _options(kind: str, size: int) -> dict[str, float]:
    """Return the options: splines of degree 2 need about tolerance^(-2/3) poles, and many."""
    return {"tolerance": 4.1e-8 * (1e6 / size) ** 1.5, "degree": 2} if kind == "poles" else {}


def modes(count: int):
    """Return a part of a torus's wall with a section of so many modes, which decay."""
    import pc2cad as pc

    u, v, w = pc.parameters()
    most = math.ceil(math.sqrt(count / 2)) + 1
    pairs = sorted(
        ((m, n) for m in range(most) for n in range(-most, most + 1) if m or n > 0),
        key=lambda pair: pair[0] ** 2 + pair[1] ** 2,
    )[:count]
    rows = [(m, n, 0.1 * math.exp(-0.5 * math.hypot(m, n))) for m, n in pairs]
    theta, phi = 2 * pc.pi * u, pc.pi / 2 * v
    r = (2 + pc.fourier(cos=rows)(theta, phi)) * (1 + w / 5)
    rho = 10 + r * pc.cos(theta)
    return pc.point(rho * pc.cos(phi), rho * pc.sin(phi), r * pc.sin(theta))


def layers(count: int):
    """Return a wavy pipe in so many layers."""
    names = "\n".join(f'l{i} = "1 + 0.1*sin(2*pi*u)"' for i in range(count))
    return _template(
        f'title = "layers"\n[layers]\n{names}\n[let]\nr = "100 + depth(w)"\n[solid]\n'
        'x = "r*cos(2*pi*v)"\ny = "r*sin(2*pi*v)"\nz = "300*u"\n'
    )


def bodies(count: int):
    """Return a disc with so many pins round it, one compiled and all joined."""
    disc = (
        '[[bodies]]\nname = "disc"\n[bodies.solid]\nM = "[r*w*cos(2*pi*u), r*w*sin(2*pi*u), 3*v]"\n'
    )
    pin = '[[bodies]]\nname = "pin"\n[bodies.solid]\nM = "[r + 4*u - 2, 2*v - 1, 1 + w]"\n'
    return _template(
        f'title = "pins"\nresult = "union(disc, polar(pin, {count}))"\n[parameters]\n'
        f"r = {{ default = {10 + count}, min = 1 }}\n{disc}{pin}"
    )


def _template(text: str):
    import tempfile

    from pc2cad.templates.file import read_template

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "t.toml")
        path.write_text(text)
        return read_template(path).bind()


def one(kind: str, size: int) -> dict[str, float]:
    """Return what one compilation takes, in this process."""
    import resource
    import time

    from pc2cad.compiler import compile_part

    compile_part(faces(10))  # loads what is loaded late
    if kind == "bodies":
        compile_part(bodies(2))
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    equation = globals()[kind](size)
    begun = time.process_time()
    part = compile_part(equation, **_options(kind, size))
    spent = time.process_time() - begun
    above = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024 - memory
    found = part.report.faces
    if kind == "poles":
        size = sum(math.prod(face.poles) for face in found if face.poles)
    return {"size": size, "faces": len(found), "s": spent, "MB": above}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--plot", type=Path)
    parser.add_argument("--one", nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        print(json.dumps(one(options.one[0], int(options.one[1]))))
        return
    found: dict[str, list[tuple[int, dict[str, float]]]] = {}
    print("| of | size | faces | s | MB more | slope |\n|---|---|---|---|---|---|")
    for kind, sizes in SIZES.items():
        rows = found.setdefault(kind, [])
        for size in sizes[:-1] if options.quick else sizes:
            command = [sys.executable, "-m", "benchmarks.sizes", "--one", kind, str(size)]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if done.returncode:
                reason = (done.stderr.strip().splitlines() or ["killed"])[-1]
                print(f"| {kind} | {size} | {reason.partition(':')[0][:60]} | - | - | - |")
                continue
            row = json.loads(done.stdout)
            size = row["size"]
            slope = "-"
            if rows:
                known, before = rows[-1]
                slope = f"{math.log(row['s'] / before['s']) / math.log(size / known):.2f}"
            rows.append((size, row))
            count, spent, above = row["faces"], row["s"], row["MB"]
            print(
                f"| {kind} | {size} | {count} | {spent:.2f} | {above:.0f} | {slope} |", flush=True
            )
    if options.plot:
        plot(found, options.plot)


def plot(found: dict[str, list[tuple[int, dict[str, float]]]], path: Path) -> None:
    """Draw seconds over sizes, both on logarithmic scales."""
    import matplotlib as mpl

    mpl.use("svg")
    mpl.rcParams |= {"svg.hashsalt": "pc2cad", "svg.fonttype": "none"}
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(6.4, 4.2), layout="constrained")
    for kind, rows in found.items():
        axes.loglog([size for size, _ in rows], [row["s"] for _, row in rows], "o-", label=kind)
    low, high = axes.get_xlim()
    axes.loglog([low, high], [low / 100, high / 100], "k:", lw=1, label="linear")
    axes.set(xlabel="how many", ylabel="CPU seconds", xlim=(low, high))
    axes.legend()
    figure.savefig(path, metadata={"Date": None})


if __name__ == "__main__":
    main()
