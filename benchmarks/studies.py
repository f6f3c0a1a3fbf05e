"""A study on one worker, on two, and on Dask, and one that is killed again and again.

``python benchmarks/studies.py FOLDER --variants 1000 --minutes 20`` prints the rows of the tables
in docs/studies.md. What is finished is kept in FOLDER: run again, it goes on with what is left.
"""

from __future__ import annotations

import argparse
import csv
import json
import random
import shutil
import signal
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pc2cad as pc
from pc2cad.studies.run import Progress

TEMPLATE = "channel_ellipse"
#: docs/studies.md: a cluster on the processors that also work
QUIET = {
    "distributed.worker.profile.enabled": False,
    "distributed.worker.memory.monitor-interval": "1s",
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "10s",
}
#: how long all stages take together, in times of the first one
STAGES = 2.8


def measure(folder: Path, count: int, workers: int, cluster: object = None) -> dict[str, float]:
    """Run a study afresh; return its wall time, its variants' own seconds, and its start."""
    shutil.rmtree(folder, ignore_errors=True)
    first: list[float] = []

    def note(state: Progress) -> None:
        if not first:
            first.append(state.seconds)

    begun = time.perf_counter()
    result = pc.study(
        TEMPLATE, folder, vary={"delta": f"0.2:0.6:{count}"}, workers=workers, cluster=cluster,
        progress=note,
    )  # fmt: skip
    wall = time.perf_counter() - begun
    assert result.counts == {"built": count}, result.counts
    work = sum(row["seconds"] for row in result.rows)
    return {"wall": wall, "work": work, "start": first[0] - result.rows[0]["seconds"]}


def on_dask(folder: Path, count: int) -> dict[str, float]:
    """Run the study on a cluster of two workers, which is there before."""
    import dask
    from distributed import LocalCluster

    dask.config.set(QUIET)
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as cluster:
        return measure(folder, count, 2, cluster)


def killed(folder: Path, count: int, times: int, wall: float) -> dict[str, Any]:
    """Kill a study at random moments, resume it, and hold its rows against `folder`/two."""
    target = folder / "killed"
    shutil.rmtree(target, ignore_errors=True)
    command = [
        sys.executable, "-m", "pc2cad.cli.main", "study", TEMPLATE, "--vary",
        f"delta=0.2:0.6:{count}", "-o", str(target), "--resume", "--workers", "2", "--quiet",
    ]  # fmt: skip
    moments = sorted(random.uniform(0, wall) for _ in range(times))
    for before, after in zip([0.0, *moments], moments, strict=False):
        process = subprocess.Popen(command)
        time.sleep(max(2.0, after - before))
        process.send_signal(signal.SIGKILL)
        process.wait()
    subprocess.run(command, check=True)
    lines = (target / "journal.jsonl").read_text().splitlines()[1:]
    keys = [json.loads(line)["key"] for line in lines]
    rows, wanted = (figures(path / "results.csv") for path in (target, folder / "two"))
    return {"times": times, "rows": len(rows), "right": sum(
        row == other for row, other in zip(rows, wanted, strict=True)
    ), "twice": len(keys) - len(set(keys))}  # fmt: skip


def figures(path: Path) -> list[dict[str, str]]:
    """Return the rows of a table without its times."""
    with open(path, newline="") as stream:
        return [
            {name: cell for name, cell in row.items() if not name.startswith("seconds")}
            for row in csv.DictReader(stream)
        ]


def ceiling(times: int = 3) -> float:
    """Return how much faster two processes that share nothing do two loops here than one does."""
    loop = "sum(i * i for i in range(20_000_000))"
    walls: dict[int, list[float]] = {1: [], 2: []}
    for _ in range(times):
        for count, seen in walls.items():
            begun = time.perf_counter()
            running = [subprocess.Popen([sys.executable, "-c", loop]) for _ in range(count)]
            for process in running:
                process.wait()
            seen.append(time.perf_counter() - begun)
    return 2 * statistics.median(walls[1]) / statistics.median(walls[2])


def fitting(folder: Path, wanted: int, minutes: float) -> int:
    """Return how many variants fit into the time, by a look at twenty."""
    tried = measure(folder / "tried", 20, 1)
    each = (tried["wall"] - tried["start"]) / 20
    fits = int((60 * minutes - 60) / (STAGES * each))
    return wanted if fits >= wanted else max(20, fits - fits % 10)


def main() -> None:
    """Run what is left and print the rows of the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--variants", type=int, default=1000)
    parser.add_argument("--minutes", type=float, default=60.0, help="fewer variants where it must")
    parser.add_argument("--kills", type=int, default=5)
    arguments = parser.parse_args()
    folder: Path = arguments.folder
    folder.mkdir(parents=True, exist_ok=True)
    kept = folder / "state.json"
    state: dict[str, Any] = json.loads(kept.read_text()) if kept.exists() else {}
    count = state.setdefault("count", fitting(folder, arguments.variants, arguments.minutes))
    stages: dict[str, Callable[[], Any]] = {
        "one": lambda: measure(folder / "one", count, 1),
        "two": lambda: measure(folder / "two", count, 2),
        "dask": lambda: on_dask(folder / "dask", count),
        "ceiling": ceiling,
        "killed": lambda: killed(folder, count, arguments.kills, state["two"]["wall"]),
    }
    for name, stage in stages.items():
        if name not in state:
            state[name] = stage()
        kept.write_text(json.dumps(state, indent=1))
    print(f"\n{count} variants of {TEMPLATE}\n")
    print("| engine | wall | a variant's own time | more per variant | of it the start | speed |")
    print("|---|---|---|---|---|---|")
    engines = (("one", "one worker", 1), ("two", "two workers", 2), ("dask", "Dask, two", 2))
    for name, title, workers in engines:
        wall, work, start = (state[name][key] for key in ("wall", "work", "start"))
        print(f"| {title} | {wall:.1f} s | {1000 * work / count:.1f} ms "
              f"| {1000 * (wall * workers - work) / count:.1f} ms "
              f"| {1000 * start * workers / count:.1f} ms "
              f"| {state['one']['wall'] / wall:.2f} |")  # fmt: skip
    print(f"\ntwo plain loops at a time: {state['ceiling']:.2f} times as fast as one by one")
    fate = state["killed"]
    print(f"\nkilled {fate['times']} times at random moments and resumed: {fate['rows']} rows, "
          f"{fate['right']} of them bit for bit those of the undisturbed study, "
          f"{fate['twice']} done twice")  # fmt: skip


if __name__ == "__main__":
    main()
