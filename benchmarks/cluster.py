"""What a variant costs beyond one machine: ``python benchmarks/cluster.py costs|dask``.

``costs`` builds a few variants and lays out a hundred thousand rows: bytes sent and stored,
seconds and memory of the supervisor. ``dask`` runs the study's own Dask engine against Dask's own
scheduler and its own workers, two hundred of them in a second process; only the build is replaced,
by a sleep. Some variants take twenty times as long, some workers are slow, and some are lost.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import logging
import math
import pickle
import random
import subprocess
import sys
import tempfile
import time
import tracemalloc
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pc2cad as pc
from pc2cad.studies import dask as engine
from pc2cad.studies.journal import Journal
from pc2cad.studies.local import Limits
from pc2cad.studies.plan import Plan, grid, read_axis
from pc2cad.studies.run import run_study
from pc2cad.studies.table import rows, to_csv, to_parquet
from pc2cad.studies.variant import Job, Outcome, Task

TEMPLATE = "channel_ellipse"
LAID_OUT = 100_000


def received(line: bytes, key: str, number: int) -> Outcome:
    """Return an outcome as it comes from a worker, with figures of its own."""
    outcome = Outcome.from_dict(json.loads(line))
    figures = {**outcome.figures, "volume": number / math.pi, "area": number / math.e}
    return replace(outcome, key=key, figures=figures, files={"step": f"{key}.step"})


def costs() -> None:
    """Print what one variant costs to send, to store and to keep."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        result = pc.study(TEMPLATE, folder, vary={"delta": "0.2:0.6:8"}, workers=1)
        own = sum(row["seconds"] for row in result.rows) / len(result.rows)
        step = sum((folder / row["step"]).stat().st_size for row in result.rows) / len(result.rows)
        line = (folder / "journal.jsonl").read_bytes().splitlines()[-1]
    task = Task("", TEMPLATE, ("step",), "/files")
    plan = grid([read_axis("delta", f"0.2:0.6:{LAID_OUT}")])
    order = pickle.dumps(Job("0" * 32, plan.values(0)))
    begun = time.process_time()
    keys = [task.key(plan.values(i)) for i in range(LAID_OUT)]
    named = time.process_time() - begun
    tracemalloc.start()
    outcomes = {key: received(line, key, i) for i, key in enumerate(keys)}
    kept = tracemalloc.get_traced_memory()[0]
    tracemalloc.reset_peak()
    table = rows(plan, keys, outcomes, ("step",))
    peak = tracemalloc.get_traced_memory()[1] - kept
    tracemalloc.stop()
    begun = time.process_time()
    table = rows(plan, keys, outcomes, ("step",))
    csv = to_csv(table)
    spent_csv = time.process_time() - begun
    parquet = to_parquet(table, plan, ("step",))
    spent = time.process_time() - begun
    with tempfile.TemporaryDirectory() as place, Journal(Path(place), "x", False) as journal:
        batches = [list(outcomes.values())[100 * i : 100 * i + 100] for i in range(50)]
        start, cpu = time.perf_counter(), time.process_time()
        for batch in batches:
            journal.add(batch)
        together = (time.perf_counter() - start, time.process_time() - cpu)
        start = time.perf_counter()
        for one in batches[0][:50]:
            journal.add([one])
        alone = time.perf_counter() - start
    micro, parquet_row = 1e6 / LAID_OUT, len(parquet) / LAID_OUT
    print(f"| | a variant | a million |\n|---|---|---|\n"
          f"| build and write, on a worker | {own:.2f} s | {own * 1e6 / 3600:.0f} h of one core |\n"
          f"| STEP file | {step / 1e3:.0f} kB | {step / 1e3:.0f} GB |\n"
          f"| job sent (pickled) | {len(order)} B | {len(order)} MB |\n"
          f"| outcome told, line of the journal | {len(line) + 1} B | {len(line) + 1} MB |\n"
          f"| results.csv | {len(csv) / LAID_OUT:.0f} B | {len(csv) / LAID_OUT:.0f} MB |\n"
          f"| results.parquet | {parquet_row:.0f} B | {parquet_row:.0f} MB |\n"
          f"| name by content hash | {named * micro:.0f} µs | {named * micro:.0f} s |\n"
          f"| journal line, alone | {alone / 50 * 1e3:.2f} ms | {alone / 50 * 1e6:.0f} s |\n"
          f"| journal line, 100 at once | {together[0] / 5000 * 1e6:.0f} µs "
          f"| {together[0] / 5000 * 1e6:.0f} s |\n"
          f"| both tables once | {spent * micro:.0f} µs (CSV {spent_csv * micro:.0f}) "
          f"| {spent * micro:.0f} s |\n"
          f"| memory of the supervisor | {kept / LAID_OUT / 1e3:.1f} kB "
          f"(while a table is written {peak / LAID_OUT / 1e3:.1f} kB more) "
          f"| {(kept + peak) / LAID_OUT / 1e3:.1f} GB |")  # fmt: skip


# -- Dask's own scheduler, with workers that sleep -------------------------------------------------


def seconds_of(job: Job, mean: float, stragglers: float) -> float:
    """Return how long a variant takes: log-normal, a share of them twenty times as long."""
    dice = random.Random(job.key)
    long = 20.0 if dice.random() < stragglers else 1.0
    return mean * long * dice.lognormvariate(-0.125, 0.5)


class Sleeping:
    """Stands in for a guarded process: the task's fields say how long variants take."""

    def __init__(self, task: Task, limits: Limits) -> None:
        self._mean, self._stragglers = task.tolerance or 0.0, float(task.fixed["stragglers"])

    def run(self, jobs: Sequence[Job]) -> Iterator[list[Outcome]]:
        """Sleep once for every job."""
        from distributed import get_worker

        slow = 5.0 if get_worker().name.endswith("slow") else 1.0
        for job in jobs:
            seconds = slow * seconds_of(job, self._mean, self._stragglers)
            if seconds:
                time.sleep(seconds)
            yield [Outcome(job.key, "built", figures={"volume": 1.0}, times={"total": seconds})]


async def host(address: str, count: int, slow: int, lose: int, every: float) -> None:
    """Run workers in this process, and lose some of them without a farewell."""
    import dask
    from distributed import Worker

    # two hundred workers in one process watch themselves less often than one does
    dask.config.set({
        "distributed.worker.profile.enabled": False,
        "distributed.admin.tick.interval": "10s",
        "distributed.admin.system-monitor.interval": "60s",
    })  # fmt: skip
    engine._guarded = Sleeping
    names = [f"{i}-slow" if i < slow else str(i) for i in range(count)]
    workers = [
        Worker(
            address, nthreads=1, name=name, dashboard=False, memory_limit=0, heartbeat_interval="5s"
        )
        for name in names
    ]
    await asyncio.gather(*workers)
    print("ready", flush=True)
    for worker in workers[slow : slow + lose]:
        await asyncio.sleep(every)
        worker.batched_stream.abort()  # as when its machine is switched off
        await worker.close(executor_wait=False, reason="lost")
    await asyncio.sleep(3600)


@contextmanager
def cluster(count: int, slow: int, lose: int, every: float) -> Iterator[Any]:
    """Yield Dask's scheduler in this process, its workers in another."""
    from distributed import LocalCluster

    with LocalCluster(n_workers=0, dashboard_address=":0", protocol="tcp") as scheduler:
        command = [sys.executable, __file__, "host", scheduler.scheduler_address, str(count),
                   str(slow), str(lose), str(every)]  # fmt: skip
        with subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
        ) as hosting:
            try:
                assert hosting.stdout is not None
                assert hosting.stdout.readline() == b"ready\n"
                yield scheduler
            finally:
                hosting.kill()


def simulate(
    title: str, variants: int, count: int, mean: float, stragglers: float = 0.0,
    slow: int = 0, lose: int = 0,
) -> None:  # fmt: skip
    """Run a study of sleeping variants and print its row."""
    plan = Plan(("delta",), tuple((i / variants,) for i in range(variants)))
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        # the length of a template
        task = Task(
            " " * 1500, TEMPLATE, (), str(folder), mean or None, fixed={"stragglers": stragglers}
        )
        times = [seconds_of(Job(task.key(plan.values(i)), {}), mean, stragglers)
                 for i in range(variants)]  # fmt: skip
        ideal = max(sum(times) / (count - lose / 2 - 0.8 * slow), max(times))
        every = 0.7 * ideal / max(lose, 1)
        with cluster(count, slow, lose, every) as scheduler:
            begun, cpu = time.perf_counter(), time.process_time()
            result = run_study(plan, task, folder, lambda task: engine.DaskEngine(task, scheduler))
            wall, cpu = time.perf_counter() - begun, time.process_time() - cpu
            left = len(scheduler.scheduler_info["workers"])
        keys = [json.loads(line)["key"] for line in
                (folder / "journal.jsonl").read_text().splitlines()[1:]]  # fmt: skip
    built = result.counts.get("built", 0)
    ratio = f"{wall / ideal:.2f}" if mean else "–"
    print(f"| {title} | {variants} | {count} → {left} | {wall:.1f} s | {ratio} "
          f"| {1000 * cpu / variants:.2f} ms | {built} built, {variants - built} not, "
          f"{len(keys) - len(set(keys))} twice |", flush=True)  # fmt: skip


def on_dask(variants: int, count: int) -> None:
    """Print the table of the simulations."""
    logging.disable(logging.CRITICAL)  # Dask tells of every lost worker
    print("| | variants | workers | wall | / ideal | CPU of supervisor and scheduler | rows |")
    print("|---|---|---|---|---|---|---|")
    simulate("nothing to do: the scheduler's limit", 5 * variants, count, 0.0)
    simulate("all alike, of 0.1 s", 5 * variants, count, 0.1)
    simulate("all alike, of 0.5 s", 5 * variants, count, 0.5)
    simulate("all alike, of 2 s", variants, count, 2.0)
    simulate("1 % take 20 times as long", variants, count, 2.0, stragglers=0.01)
    simulate("a tenth of the workers 5 times slower", variants, count, 2.0, slow=count // 10)
    simulate("a tenth of the workers lost", variants, count, 2.0, lose=count // 10)
    simulate("all of it", variants, count, 2.0, 0.01, count // 10, count // 10)


def main() -> None:
    """Run what the arguments ask for."""
    parser = argparse.ArgumentParser(description=__doc__)
    verbs = parser.add_subparsers(dest="verb", required=True)
    verbs.add_parser("costs")
    verb = verbs.add_parser("dask")
    verb.add_argument("--variants", type=int, default=4000)
    verb.add_argument("--workers", type=int, default=200)
    verb = verbs.add_parser("host")
    for name, kind in (("address", str), ("count", int), ("slow", int), ("lose", int)):
        verb.add_argument(name, type=kind)
    verb.add_argument("every", type=float)
    arguments = parser.parse_args()
    if arguments.verb == "costs":
        costs()
    elif arguments.verb == "dask":
        on_dask(arguments.variants, arguments.workers)
    else:
        asyncio.run(
            host(
                arguments.address, arguments.count, arguments.slow, arguments.lose, arguments.every
            )
        )


if __name__ == "__main__":
    main()
