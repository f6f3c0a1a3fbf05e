"""How time and memory grow with faces, poles, modes of a Fourier series, layers and bodies.

    python -m benchmarks.sizes [--quick] [--plot FILE.svg]

Each row is one compilation in a process of its own, without the imports: CPU seconds, and the
largest memory above that of an empty process; garbage is collected as the command has it. The slope
is that in the table, log of the time over log of the size since the row above: 1 where the cost is
linear. How much of it is the CAD kernel's is told by a second compilation under a profiler: seconds
within its functions, and within the modules of which hardly anything else is left (making an object
of the kernel is no call to it).
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
#: splines of degree 2 are of no use but for this: they need many poles, as tolerance^(-2/3)
OPTIONS = {"poles": lambda count: {"tolerance": 42 / count**1.5, "degree": 2}}
#: modules that are hardly anything else than what they have the kernel do
KERNEL = ("brep/checker.py", "brep/inspect.py", "brep/booleans.py", "brep/build.py")


def faces(count: int):
    """Return a tube on a polygon, of so many plane faces: walls in and out, and two ends."""
    import pc2cad as pc

    u, v, w = pc.parameters()
    x, y = pc.regular_polygon((count - 2) // 2, 10, v)
    return pc.point(x * (1 + w / 5), y * (1 + w / 5), 20 * u)


def poles(count: int):
    """Return a channel whose walls take about so many poles with `OPTIONS`."""
    from pc2cad.templates.file import read_template
    from pc2cad.templates.shipped import find_template

    return read_template(find_template("channel_ellipse")).bind({})


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
    import cProfile
    import resource
    import time
    from math import prod

    from pc2cad.compiler import compile_equation, compile_part
    from pc2cad.trust.processes import collect_rarely

    collect_rarely()
    compile_part(faces(10))  # loads what is loaded late
    if kind == "bodies":
        compile_part(bodies(2))
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    options = OPTIONS.get(kind, lambda count: {})(size)
    equation = globals()[kind](size)
    begun = time.process_time()
    report = compile_equation(equation, **options).report
    spent = time.process_time() - begun
    above = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024 - memory
    profile = cProfile.Profile(time.process_time)
    profile.runcall(compile_equation, globals()[kind](size), **options)
    within = sum(entry.inlinetime for entry in profile.getstats() if _is_kernel(entry.code))
    count = sum(prod(face.poles) for face in report.faces if face.poles)
    return {
        "size": count if kind == "poles" else size, "faces": len(report.faces), "s": spent,
        "kernel": within, "MB": above,
    }  # fmt: skip


def _is_kernel(code) -> bool:
    return "OCP." in code if isinstance(code, str) else code.co_filename.endswith(KERNEL)


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
    print("| of | size | faces | s | of it the kernel | MB more | slope |\n|" + "---|" * 7)
    for kind, sizes in SIZES.items():
        rows = found.setdefault(kind, [])
        for size in sizes[:-1] if options.quick else sizes:
            command = [sys.executable, "-m", "benchmarks.sizes", "--one", kind, str(size)]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if done.returncode:
                reason = (done.stderr.strip().splitlines() or ["killed"])[-1]
                print(f"| {kind} | {size} | {reason.partition(':')[0][:60]} | - | - | - | - |")
                continue
            row = json.loads(done.stdout)
            count, spent, slope = row["size"], row["s"], "-"
            if rows:
                known, before = rows[-1]
                slope = f"{math.log(spent / before['s']) / math.log(count / known):.2f}"
            rows.append((count, row))
            print(
                f"| {kind} | {count} | {row['faces']} | {spent:.2f} | {row['kernel']:.2f} "
                f"| {row['MB']:.0f} | {slope} |",
                flush=True,
            )
    if options.plot:
        plot(found, options.plot)


def plot(found: dict[str, list[tuple[int, dict[str, float]]]], path: Path) -> None:
    """Draw seconds and memory over sizes, on logarithmic scales."""
    import matplotlib as mpl

    mpl.use("svg")
    mpl.rcParams |= {"svg.hashsalt": "pc2cad", "svg.fonttype": "none"}
    from matplotlib import pyplot

    figure, panels = pyplot.subplots(1, 2, figsize=(10, 4.2), layout="constrained")
    for axes, key, name, floor in zip(
        panels, ("s", "MB"), ("CPU seconds", "largest memory, MB more than for nothing"), (0, 1),
        strict=True,
    ):  # fmt: skip
        for kind, rows in found.items():
            sizes, values = [size for size, _ in rows], [max(row[key], floor) for _, row in rows]
            axes.loglog(sizes, values, "o-", label=kind)
        low, high = axes.get_xlim()
        middle = math.sqrt(math.prod(axes.get_ylim()))
        bottom, top = axes.get_ylim()
        for scale in (middle / 300, middle / 3e4):
            axes.loglog([low, high], [low * scale, high * scale], "k:", lw=1)
        axes.set(xlabel="how many (dotted: linear)", ylabel=name, xlim=(low, high),
                 ylim=(bottom, top))  # fmt: skip
    panels[0].legend()
    figure.savefig(path, metadata={"Date": None})


if __name__ == "__main__":
    main()
