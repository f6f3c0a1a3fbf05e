"""What the command loads before it builds, beside a bare ``import OCP, numpy``: CPU seconds.

    python -m benchmarks.imports [--runs 9]

Both in processes of their own, turn and turn about; the table has the least of each, and the ratio
in the middle of those of neighbours.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
from statistics import median

#: prints what a command has loaded of ours
COMMAND = """
import contextlib, io, os, sys, tempfile
from pc2cad.cli.main import main
with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
    main(["build", "channel_ellipse", "-o", os.path.join(folder, "a.step")])
print(*(name for name in sys.modules if name.split(".")[0] == "pc2cad"))
"""
#: loads the same as the command does, which begins so
OURS = """
from pc2cad.cli import main as command
command.main = lambda: None  # the command's first steps, and none of its work
from pc2cad.__main__ import start
start()
for name in {names!r}.split():
    __import__(name)
"""


def cpu(code: str) -> float:
    """Return the CPU seconds of a process that runs some code."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-c", code], check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=9)
    runs = parser.parse_args().runs
    done = subprocess.run(
        [sys.executable, "-c", COMMAND], check=True, capture_output=True, text=True
    )
    ours = OURS.format(names=done.stdout.strip())
    rows = [(cpu("import OCP, numpy"), cpu(ours)) for _ in range(runs)]
    bare, whole = (min(column) for column in zip(*rows, strict=True))
    ratio = median(b / a for a, b in rows)
    print("| import OCP, numpy | what `build` loads | ratio |\n|---|---|---|")
    print(f"| {bare:.2f} | {whole:.2f} | {ratio:.3f} |")


if __name__ == "__main__":
    main()
