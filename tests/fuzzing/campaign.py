"""Long runs, in tests/: ``python -m fuzzing.campaign --expressions 1000000 --templates 100000``.

Tells, per kind, how many texts were tried and accepted, and the slowest; ends with 1 and the text
at the first one that is neither read nor refused, or that takes longer than the limit.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from random import Random

from fuzzing import grammar, oracles

#: seconds of processor time for one text
LIMIT = 0.5


def run(name: str, count: int, seed: int, make: Callable[[Random], str],
        accepts: Callable[[str], bool]) -> None:  # fmt: skip
    """Try `count` texts; raise SystemExit at the first one that breaks the promise."""
    random = Random(f"{name} {seed}")
    accepted, slowest, begun = 0, 0.0, time.monotonic()
    for _ in range(count):
        text = make(random)
        start = time.process_time()
        try:
            accepted += accepts(text)
        except Exception as error:
            sys.exit(f"{name} {text!r}: {type(error).__name__}: {error}")
        spent = time.process_time() - start
        if spent > LIMIT:
            sys.exit(f"{name} {text!r}: took {spent:.1f} s")
        slowest = max(slowest, spent)
    minutes = (time.monotonic() - begun) / 60
    sys.stdout.write(
        f"{name}: {count} tried, {accepted} accepted, slowest {slowest:.3f} s, {minutes:.1f} min\n"
    )


def main() -> None:
    """Run what the arguments ask for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--expressions", type=int, default=0)
    parser.add_argument("--templates", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    run("expressions", arguments.expressions, arguments.seed, grammar.expression, oracles.read)
    run("templates", arguments.templates, arguments.seed, grammar.template, oracles.read_template)


if __name__ == "__main__":
    main()
