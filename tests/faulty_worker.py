"""A worker process whose jobs fail in the ways that kernels and machines fail; see test_studies."""

import os
import signal
import sys
import time
from pathlib import Path

from pc2cad.studies import variant, worker


def good(_: variant.Task, job: variant.Job) -> variant.Outcome:
    """What a sound job is, without the kernel, which workers that start so often load slowly."""
    return variant.Outcome(job.key, "built", figures={"volume": 24 * float(job.values["p"])})


def run_variant(task: variant.Task, job: variant.Job) -> variant.Outcome:
    folder = Path(sys.argv[1])
    match job.values.get("p"):
        case 0.1:
            os.kill(os.getpid(), signal.SIGSEGV)
        case 0.2:
            time.sleep(600)
        case 0.3:
            hog = []
            while True:
                hog.append(bytearray(os.urandom(64)) * 1_000_000)
        case 0.4:
            os._exit(7)
        case 0.5:
            os.write(1, b"kernel statistics\n" * 100_000)
        case 0.6:
            mark = folder / "tried"
            if not mark.exists():
                mark.touch()
                os.kill(os.getpid(), signal.SIGABRT)
        case 0.7:
            raise RecursionError
    return good(task, job)


if __name__ == "__main__":
    variant.run_variant = run_variant
    worker.warm_up = lambda: None
    worker.main()
