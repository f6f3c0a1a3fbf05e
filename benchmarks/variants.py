"""What a variant of a study costs in a worker that is warm, in shares of a bare ``import OCP``.

    python -m benchmarks.variants [--rounds 9] [--each 20]

A worker's own `run_variant`, STEP file included, of parameters that did not occur before, and with
what a study of many variants proves beforehand over their ranges; CPU seconds. Each round first
loads the kernel's library in processes of its own, so that both see the machine as it is then: the
table has medians over the rounds, and the median of their quotients.
"""

from __future__ import annotations

import argparse
import random
import tempfile
import time
from statistics import median

from benchmarks.imports import cpu
from pc2cad.studies.over_ranges import packed, prove_over
from pc2cad.studies.variant import BUILT, Job, Task, run_variant
from pc2cad.studies.worker import warm_up
from pc2cad.templates.shipped import template_paths

#: template -> ranges of its parameters
VARIED = {
    "channel_ellipse": {"delta": (0.2, 0.6), "s": (0.0, 1.0)},
    "pyramid_cut": {"p": (0.2, 0.8), "q": (0.2, 0.8)},
}
#: variants that are not counted, and processes that load the library in a round
WARM, LOADS = 5, 3


def stream(name: str, folder: str, generator: random.Random):
    """Yield the CPU seconds of one variant after the other."""
    text = template_paths()[name].read_text(encoding="utf-8")
    known = packed(prove_over(name, VARIED[name]))
    task = Task(text, name, ("step",), folder, known=known)
    while True:
        values = {key: generator.uniform(*ends) for key, ends in VARIED[name].items()}
        start = time.process_time()
        outcome = run_variant(task, Job(task.key(values), values))
        took = time.process_time() - start
        if outcome.status != BUILT:
            raise SystemExit(f"{name} {values}: {outcome.reason}")
        yield took


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--each", type=int, default=20, help="variants of a template in a round")
    options = parser.parse_args()
    warm_up()
    generator = random.Random(1)
    with tempfile.TemporaryDirectory() as folder:
        streams = {name: stream(name, folder, generator) for name in VARIED}
        for one in streams.values():
            for _ in range(WARM):
                next(one)
        rows = []
        for _ in range(options.rounds):
            bare = median(cpu("import OCP") for _ in range(LOADS))
            each = {k: median(next(one) for _ in range(options.each)) for k, one in streams.items()}
            rows.append((bare, each))
    print("| template | a variant, ms | import OCP, ms | share |\n|---|---|---|---|")
    for name in VARIED:
        own, bare = median(each[name] for _, each in rows), median(bare for bare, _ in rows)
        share = median(each[name] / bare for bare, each in rows)
        print(f"| `{name}` | {1e3 * own:.1f} | {1e3 * bare:.0f} | {share:.4f} |")


if __name__ == "__main__":
    main()
