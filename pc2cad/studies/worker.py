"""A worker process: takes one job after another from stdin and answers on stdout.

Started as `isolation.running` says. The kernel prints to file descriptor 1, so that one is
pointed to nowhere and the answers go through a copy of it. The worker ends with its parent: when
stdin is closed, or, where the system can, at once.
"""

from __future__ import annotations

import json
import os
import signal
import sys
from dataclasses import asdict
from typing import Any

from pc2cad.trust.processes import end_with_parent, keep_what_is_loaded


def main() -> None:
    """Answer jobs until stdin ends: a line in, a line out."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides what Ctrl-C means
    end_with_parent()
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)

    from pc2cad.studies.variant import Job, Task, run_variant

    warm_up()
    task: Task | None = None
    answers.write(json.dumps({"ready": os.getpid()}) + "\n")
    answers.flush()
    for line in sys.stdin:
        order: dict[str, Any] = json.loads(line)
        if "task" in order:
            task = Task(**{**order["task"], "formats": tuple(order["task"]["formats"])})
        assert task is not None
        outcome = run_variant(task, Job(**order["job"]))
        answers.write(json.dumps(asdict(outcome)) + "\n")
        answers.flush()


def warm_up() -> None:
    """Load the kernel before the first job, whose time would tell of nothing else."""
    import pc2cad.compiler
    import pc2cad.export.step  # noqa: F401

    keep_what_is_loaded()


if __name__ == "__main__":
    main()
