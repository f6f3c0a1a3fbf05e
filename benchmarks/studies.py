"""A study on one worker, on two, and on Dask: ``python benchmarks/studies.py --variants 1000``.

Prints, per engine, the wall time, the time per variant beyond the build itself, and the ratio to
one worker; then what is left of a study that is killed at random moments and resumed.
"""

from __future__ import annotations

import argparse
import csv
import json
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pc2cad as pc

TEMPLATE = "channel_ellipse"


def measure(name: str, count: int, workers: int, cluster: object = None) -> tuple[float, float]:
    """Run a study; return its wall time and the sum of its variants' own seconds."""
    with tempfile.TemporaryDirectory() as folder:
        begun = time.perf_counter()
        result = pc.study(
            TEMPLATE, folder, vary={"delta": f"0.2:0.6:{count}"}, workers=workers, cluster=cluster
        )
        wall = time.perf_counter() - begun
    assert result.counts == {"built": count}, result.counts
    work = sum(row["seconds"] for row in result.rows)
    over = 1000 * (wall * max(workers, 1) - work) / count
    print(f"{name:28} {wall:8.1f} s  {1000 * work / count:8.1f} ms a variant, {over:6.2f} ms more")
    return wall, work


def killed(count: int, times: int) -> None:
    """Kill a study at random moments, resume it, and count its rows."""
    with tempfile.TemporaryDirectory() as folder:
        command = [
            sys.executable, "-m", "pc2cad.cli.main", "study", TEMPLATE, "--vary",
            f"delta=0.2:0.6:{count}", "-o", folder, "--resume", "--workers", "2",
        ]  # fmt: skip
        for _ in range(times):
            process = subprocess.Popen(command)
            time.sleep(random.uniform(3, 3 + 0.1 * count))
            process.send_signal(signal.SIGKILL)
            process.wait()
        subprocess.run(command, check=True)
        lines = (Path(folder) / "journal.jsonl").read_text().splitlines()[1:]
        keys = [json.loads(line)["key"] for line in lines]
        with open(Path(folder) / "results.csv", newline="") as stream:
            rows = list(csv.DictReader(stream))
        right = sum(row["status"] == "built" for row in rows)
        print(f"killed {times} times: {len(rows)} rows, {right} built, {len(keys)} in the journal, "
              f"{len(keys) - len(set(keys))} twice")  # fmt: skip


def main() -> None:
    """Run what the arguments ask for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--variants", type=int, default=1000)
    parser.add_argument("--kills", type=int, default=5)
    arguments = parser.parse_args()
    one, _ = measure("one worker", arguments.variants, 1)
    two, _ = measure("two workers", arguments.variants, 2)
    from distributed import LocalCluster

    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        shared, _ = measure("Dask, two workers", arguments.variants, 2, cluster)
    print(f"two workers: {one / two:.2f} x one; Dask: {one / shared:.2f} x one")
    killed(arguments.variants, arguments.kills)


if __name__ == "__main__":
    main()
