"""Random options and environment values for every verb; each run ends in a sentence and a code.

Long runs, in tests/: ``python -m fuzzing.options --count 1000 --seed 1``. Ends with 1 and the
arguments at the first run that breaks the promise.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from random import Random

from pc2cad.cli.main import VERBS, main, make_parser

#: exit codes that the command documents
CODES = (0, 2, 3, 4, 5, 6, 130, 141)
CUBE = 'title = "c"\n[parameters]\np = {default = 1, min = 0.5, max = 2}\n[points]\nA = [0, 0, 0]\n'
CUBE += '[solid]\nx = "p*u"\ny = "v"\nz = "w"\n'
FLAT = 'title = "f"\n[solid]\nx = "u"\ny = "v"\nz = "u + v"\n'
#: what numbers and texts of options are; "@" is replaced by a small good value
ODD = (
    "", " ", "0", "-1", "1", "2", "3", "1e-9", "0.5", "nan", "inf", "-inf", "1e400", "1e308",
    "1e-400", "9" * 40, "9" * 5000, "0x10", "1_0", "٣", "²", "1,5", "1/3", "1/0", "9**9**9",
    "pi", "u", "A", "[0,0,0]", "p=", "=1", "p=1", "p=3", "p=nan", "A=[u,0,0]", "A=[1]", "A=9**9**9",
    "p=0.5:1:2", "p=1:0.5:2", "p=0:0:0", "p=1,2", "p=0.6:0.9", "p=1:2:²", "q=1:2:3",
    "p=1:2:" + "9" * 5000,
    "lhs:2", "lhs:0", "sobol:3", "sobol:2", "lhs:" + "9" * 9, "2x2x2", "2,2,2", "-1x2x2",
    "0x0x0", "1x1", "axbxc", "1e9x1x1", "iso", "top", "none", "step", "stl,,step", "x.y", ".",
    "..", "/", "\x00", "\n", "\x1b[31m", "\ud800", "ü", "-", "--", "a" * 5000, "volume:p",
    "p:volume",
    "red", "#fff", "1:2:3", "{}", "tcp://x", "127.0.0.1:1",
)  # fmt: skip
ENVIRONMENT = {
    "SOURCE_DATE_EPOCH": ("", " ", "0", "1700000000", "-1", "1e9", "x", "9" * 30, "٣"),
    "PC2CAD_DEBUG": ("", "0", "x"),
    "COLUMNS": ("", "0", "-1", "x", "9" * 30),
    "LC_ALL": ("C", "", "xx"),
    "TERM": ("", "dumb"),
    "HOME": ("", "/nonexistent"),
    "TMPDIR": ("", "/nonexistent"),
    "NO_COLOR": ("1",),
}
#: options that do not come back, or ask for other machines
LEFT_OUT = ("--serve", "--dask", "--store")


@dataclass(frozen=True)
class Run:
    """Arguments and environment of one run, and what came of it."""

    arguments: tuple[str, ...]
    environment: dict[str, str]
    code: int = 0
    words: str = ""
    seconds: float = 0.0

    @property
    def complaint(self) -> str:
        """What is wrong with the run, '' for nothing."""
        if self.code not in CODES:
            return f"exit code {self.code}"
        if "unexpected error" in self.words or "Traceback" in self.words:
            return "no sentence"
        return "" if self.code == 0 or "pc2cad: " in self.words else "no word"


def _actions(verb: str) -> list[argparse.Action]:
    parser = make_parser()
    verbs = next(a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
    return [a for a in verbs.choices[verb]._actions if "-h" not in a.option_strings]


def _good(action: argparse.Action, folder: Path, verb: str) -> str:
    """Return a value that the option may well have."""
    endings = {
        "build": ".step", "mesh": ".vtu", "render": ".png", "view": ".html", "points": ".ply",
        "spline": ".g2", "study": "",
    }  # fmt: skip
    if action.choices:
        return str(next(iter(action.choices)))
    if action.dest in ("template", "file", "shell"):
        return str(folder / "cube.toml")
    if action.dest in ("output", "outputs", "report"):
        return str(folder / f"out{endings.get(verb, '.txt')}")
    return {"vary": "p=0.6,0.7", "settings": "p=1", "formats": "none"}.get(action.dest, "2")


def random_run(random: Random, folder: Path) -> Run:
    """Return a run that has not been made yet."""
    verb = random.choice(list(VERBS))
    arguments: list[str] = []
    for action in _actions(verb):
        if set(action.option_strings) & set(LEFT_OUT):
            continue
        needed = action.required or not action.option_strings
        if not needed and random.random() < 0.75:
            continue
        if needed and random.random() < 0.03:
            continue
        if action.option_strings:
            arguments.append(random.choice(action.option_strings))
            if action.nargs == 0:
                continue
        odd = random.random() < (0.1 if needed else 0.6)
        arguments.append(random.choice(ODD) if odd else _good(action, folder, verb))
    if verb == "view" and "-o" not in arguments and "--output" not in arguments:
        arguments += ["-o", str(folder / "out.html")]
    if random.random() < 0.1:
        arguments.insert(random.randrange(len(arguments) + 1), random.choice(ODD))
    environment = {
        name: random.choice(values) for name, values in ENVIRONMENT.items() if random.random() < 0.2
    }
    if verb == "study" and "--workers" not in arguments:
        arguments += ["--workers", "1"]
    return Run((verb, *arguments), environment)


def perform(run: Run) -> Run:
    """Run the command in this process and return what came of it."""
    kept = dict(os.environ)
    out, err = io.StringIO(), io.StringIO()
    begun = time.process_time()
    os.environ.update(run.environment)
    os.environ.pop("PC2CAD_DEBUG", None)
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            code = main(list(run.arguments))
    finally:
        os.environ.clear()
        os.environ.update(kept)
    return Run(run.arguments, run.environment, code, err.getvalue(), time.process_time() - begun)


def campaign(count: int, seed: int, folder: Path) -> Counter[int]:
    """Perform runs in a folder of their own; raise AssertionError at the first that is wrong."""
    (folder / "cube.toml").write_text(CUBE)
    random, codes = Random(seed), Counter[int]()
    here = Path.cwd()
    os.chdir(folder)  # relative names of outputs stay there
    try:
        for number in range(count):
            done = perform(random_run(random, folder))
            assert not done.complaint, f"{number}: {done.complaint}: {done!r}"
            codes[done.code] += 1
    finally:
        os.chdir(here)
    return codes


if __name__ == "__main__":
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--count", type=int, default=1000)
    options.add_argument("--seed", type=int, default=1)
    given = options.parse_args()
    with tempfile.TemporaryDirectory() as room:
        sys.stdout.write(f"{campaign(given.count, given.seed, Path(room))}\n")
