"""Studies: plans, workers that die, journals that are cut short, tables that stay right."""

from __future__ import annotations

import asyncio
import csv
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import pc2cad as pc
from pc2cad.cli.main import main
from pc2cad.errors import InputError
from pc2cad.studies.journal import Journal, JournalInUseError, StudyDiffersError
from pc2cad.studies.local import Limits, LocalEngine, WorkerNotStartedError
from pc2cad.studies.plan import Plan, PlanError, grid, sample
from pc2cad.studies.run import NothingBuiltError, Progress, StudyResult, run_study
from pc2cad.studies.table import rows
from pc2cad.studies.variant import Job, Outcome, Task
from pc2cad.studies.variants_table import read_table
from pc2cad.templates.ranges import RangeError, read_axis
from tests import hostile_folder as hostile

FAULTY = str(Path(__file__).parent / "faulty_worker.py")
BRICK = """
title = "Brick"
[parameters]
p = { default = 0.5, min = 0.01, max = 1 }
[solid]
x = "4*p*u"
y = "2*v"
z = "3*w"
"""


def task(folder: Path, formats: tuple[str, ...] = ()) -> Task:
    return Task(BRICK, "brick", formats, str(folder / "files"))


def plan(values: Sequence[float]) -> Plan:
    return grid([read_axis("p", values)])


def study(folder: Path, values: Sequence[float], **options: object) -> StudyResult:
    def engine(task: Task) -> LocalEngine:
        return LocalEngine(task, 1, Limits(seconds=30))

    return run_study(plan(values), task(folder, ("step",)), folder, engine, **options)  # type: ignore[arg-type]


# -- plans -------------------------------------------------------------------------------------


def test_a_range_holds_decimals_and_not_their_neighbours() -> None:
    values = read_axis("p", "0.1:0.9:17").values
    assert values == tuple(float(f"{0.1 + 0.05 * i:.2f}") for i in range(17))
    assert read_axis("p", "1/3, 2/3").values == (1 / 3, 2 / 3)


def test_a_grid_runs_its_last_axis_fastest() -> None:
    variants = grid([read_axis("a", "1,2"), read_axis("b", "3:5:3")]).variants
    assert variants == ((1, 3), (1, 4), (1, 5), (2, 3), (2, 4), (2, 5))


@pytest.mark.parametrize("method", ["lhs:16", "sobol:16"])
def test_a_sample_puts_one_variant_into_each_stratum(method: str) -> None:
    axes = [read_axis("a", "2:6"), read_axis("b", "10,20")]
    drawn = sample(axes, method, seed=3)
    assert drawn == sample(axes, method, seed=3) != sample(axes, method, seed=4)
    assert sorted(int((a - 2) * 4) for a, _ in drawn.variants) == list(range(16))
    assert sorted(b for _, b in drawn.variants) == [10] * 8 + [20] * 8


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ("0:1:1000000000000", "more than"), ("0:1:0", "whole number"), ("0:1:2.5", "whole number"),
        ("1:1:5", "equal ends"), ("1:0", "empty"), ("1,5;2", "2"), ("nan", "nan"),
        ("1e999", "1e999"), ("0:1:3:4", "LOW:HIGH:COUNT"), ("__import__('os')", "__import__"),
        ("0x10", "0x10"), ("", "empty"),
    ],
)  # fmt: skip
def test_values_that_make_no_axis_are_refused(given: str, reason: str) -> None:
    with pytest.raises(RangeError, match=reason):
        read_axis("p", given)


def test_what_cannot_be_laid_out_is_counted_first() -> None:
    axes = [read_axis(name, "0:1:1000") for name in "abcd"]
    with pytest.raises(PlanError, match="1000000000000 variants"):
        grid(axes)
    with pytest.raises(PlanError, match="needs a count"):
        grid([read_axis("p", "0:1")])
    with pytest.raises(PlanError, match="sobol:64 or sobol:128"):
        sample([read_axis("p", "0:1")], "sobol:100")
    with pytest.raises(PlanError, match="twice"):
        grid([read_axis("p", "1"), read_axis("p", "2")])


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("p,q\n1,2\n3\n", "row 3 has 1 values"), ("p;q\n1;2\n", "semicolons"), ("", "empty"),
        ("p,p\n1,2\n", "twice"), ("p\n=1+1\n", "row 2, p"), ("p\n2026-11-21 10:00\n", "row 2, p"),
        ('p\n"1\n', "not a table"), ("p\n", "0 variants"), ("p\nnan\n", "nan"),
    ],
)  # fmt: skip
def test_tables_with_mistakes_are_refused(tmp_path: Path, text: str, reason: str) -> None:
    path = tmp_path / "variants.csv"
    path.write_text(text)
    with pytest.raises((PlanError, RangeError), match=reason):
        read_table(path)


def test_a_results_table_is_a_table_of_variants(tmp_path: Path) -> None:
    path = tmp_path / "variants.csv"
    path.write_bytes(b"\xef\xbb\xbfp, q\r\n0.25,1/2\r\n\r\n0.5,2\r\n")
    assert read_table(path) == Plan(("p", "q"), ((0.25, 0.5), (0.5, 2.0)))


# -- workers -----------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_worker_that_fails_loses_its_own_variant_only(tmp_path: Path) -> None:
    limits = Limits(seconds=5, memory=1024**3 // 4)

    def engine(task: Task) -> LocalEngine:
        return LocalEngine(task, 2, limits, (FAULTY, str(tmp_path)))

    values = [0.05 * i for i in range(1, 17)] + [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7]
    values = sorted({round(value, 2) for value in values})
    result = run_study(plan(values), task(tmp_path), tmp_path, engine)
    reasons = {row["p"]: row["reason"] for row in result.rows if row["status"] != "built"}
    assert set(reasons) == {0.1, 0.2, 0.3, 0.4, 0.7}
    assert "SIGSEGV" in reasons[0.1]
    assert "time limit of 5 s" in reasons[0.2]
    assert "memory limit of 0.25 GiB" in reasons[0.3]
    assert "exit code 7" in reasons[0.4]
    assert (tmp_path / "tried").exists(), "the crash that another try mends was not provoked"
    built = [row for row in result.rows if row["status"] == "built"]
    assert len(built) == len(values) - 5 == 11
    assert all(row["volume"] == 24 * row["p"] for row in built), "rows are their own variants'"


#: a worker that answers at once with a number
ANSWERING = """
import json, os, sys
print(json.dumps({{'ready': 0}}), flush=True)
for line in sys.stdin:
    key = json.loads(line)['job']['key']
    answer = {{'key': key, 'status': 'built', 'figures': {{'faces': {number}}}}}
    print(json.dumps(answer), flush=True)
"""


def test_a_worker_is_replaced_after_so_many_jobs(tmp_path: Path) -> None:
    def engine(task: Task) -> LocalEngine:
        return LocalEngine(task, 1, Limits(jobs=2), ("-c", ANSWERING.format(number="os.getpid()")))

    values = [0.1, 0.2, 0.3, 0.4, 0.5]
    result = run_study(plan(values), task(tmp_path), tmp_path, engine)
    assert [row["status"] for row in result.rows] == ["built"] * 5
    first, second, third, fourth, fifth = (row["faces"] for row in result.rows)
    assert first == second != third == fourth != fifth != first


def test_answers_to_a_run_that_was_left_are_not_those_of_the_next(tmp_path: Path) -> None:
    jobs = [Job(str(i), {}) for i in range(4)]
    command = ("-c", ANSWERING.format(number="0"))
    with LocalEngine(task(tmp_path), 1, Limits(), command) as engine:
        left = engine.run(jobs[:2])
        assert [outcome.key for outcome in next(left)] == ["0"]
        left.close()
        assert [outcome.key for batch in engine.run(jobs[2:]) for outcome in batch] == ["2", "3"]


def test_workers_keep_their_memory_below_a_dask_nanny(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MALLOC_TRIM_THRESHOLD_", "65536")
    number = "sum(name.startswith('MALLOC') for name in os.environ)"

    def engine(task: Task) -> LocalEngine:
        return LocalEngine(task, 1, Limits(), ("-c", ANSWERING.format(number=number)))

    assert run_study(plan([0.5]), task(tmp_path), tmp_path, engine).rows[0]["faces"] == 0


def test_workers_that_cannot_start_end_the_study(tmp_path: Path) -> None:
    def engine(task: Task) -> LocalEngine:
        return LocalEngine(task, 1, Limits(), ("-c", "raise SystemExit(1)"))

    with pytest.raises(WorkerNotStartedError, match="before it was ready"):
        run_study(plan([0.5]), task(tmp_path), tmp_path, engine)


def test_a_study_in_which_nothing_is_built_stops(tmp_path: Path) -> None:
    with pytest.raises(NothingBuiltError, match="first 3 variants"):
        study(tmp_path, [5, 6, 7, 8, 9, 10], stop_after=3)


# -- journal and table -------------------------------------------------------------------------


def test_table_and_files_are_those_of_the_plan(tmp_path: Path) -> None:
    result = study(tmp_path, [0.25, 2.0, 0.5])
    with open(tmp_path / "results.csv", newline="") as stream:
        read = list(csv.DictReader(stream))
    assert [row["status"] for row in read] == ["built", "bad input", "built"]
    assert "outside its range" in read[1]["reason"]
    assert [float(row["volume"]) for row in (read[0], read[2])] == pytest.approx([6, 12], rel=1e-14)
    for row in (read[0], read[2]):
        assert (tmp_path / row["step"]).read_bytes().startswith(b"ISO-10303-21;")
    assert result.counts == {"built": 2, "bad input": 1}
    pytest.importorskip("pyarrow")
    from pyarrow import parquet

    table = parquet.read_table(tmp_path / "results.parquet").to_pylist()
    assert [row["volume"] for row in table] == [row["volume"] for row in result.rows]


@pytest.mark.slow
def test_a_finished_study_is_not_done_again(tmp_path: Path) -> None:
    first = study(tmp_path, [0.25, 0.5])
    assert [row["volume"] for row in first.rows] == pytest.approx([6, 12], rel=1e-14)
    with pytest.raises(StudyDiffersError, match="--resume"):
        study(tmp_path, [0.25, 0.5])
    again = study(tmp_path, [0.25, 0.5], resume=True)
    assert (first.built, again.built) == (2, 0)
    assert again.rows == first.rows


@pytest.mark.slow
def test_another_study_does_not_write_into_the_folder(tmp_path: Path) -> None:
    study(tmp_path, [0.25])
    other = Task(BRICK.replace("3*w", "4*w"), "brick", (), str(tmp_path / "files"))
    with pytest.raises(StudyDiffersError, match="another study"):
        run_study(plan([0.25]), other, tmp_path, LocalEngine, resume=True)


@pytest.mark.slow
def test_two_processes_do_not_share_a_study(tmp_path: Path) -> None:
    study(tmp_path, [0.25])
    fcntl = pytest.importorskip("fcntl")
    with open(tmp_path / "journal.jsonl", "ab") as stream:
        fcntl.flock(stream, fcntl.LOCK_EX)
        with pytest.raises(JournalInUseError):
            study(tmp_path, [0.25], resume=True)


@pytest.mark.parametrize("torn", [b'{"key": "abc", "sta', b"\x00\x00\x00\x00", b"{}"])
def test_a_torn_line_is_cut_off(tmp_path: Path, torn: bytes) -> None:
    with Journal(tmp_path, "study", resume=False) as journal:
        journal.add([Outcome("one", "built", figures={"volume": 0.1})])
        journal.add([Outcome("two", "failed", "because")])
    path = tmp_path / "journal.jsonl"
    whole = path.read_bytes()
    path.write_bytes(whole + torn)
    with Journal(tmp_path, "study", resume=True) as journal:
        assert set(journal.outcomes) == {"one", "two"}
        assert journal.outcomes["one"].figures["volume"] == 0.1
        assert path.read_bytes() == whole
        journal.add([Outcome("three", "built")])
    assert path.read_bytes().startswith(whole)
    assert path.read_bytes().count(b"\n") == 4


@pytest.mark.slow
def test_equal_variants_are_built_once(tmp_path: Path) -> None:
    repeated = Plan(("p",), ((0.25,), (0.5,), (0.25,), (0.250,)))

    def engine(task: Task) -> LocalEngine:
        return LocalEngine(task, 1)

    result = run_study(repeated, task(tmp_path), tmp_path, engine)
    assert result.built == 2
    assert [row["volume"] for row in result.rows] == pytest.approx([6, 12, 6, 6], rel=1e-14)


@pytest.mark.slow
def test_any_number_of_workers_gives_the_same_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    marks = hostile.fill(tmp_path / "here")
    monkeypatch.chdir(tmp_path / "here")
    contents = []
    for workers in (1, 2):
        folder = tmp_path / str(workers)
        result = pc.study(
            "pyramid_cut", folder, vary={"p": "0.2:0.8:4"}, formats=("step", "stl"), workers=workers
        )
        rows = [
            {name: cell for name, cell in row.items() if not name.startswith("seconds")}
            for row in result.rows
        ]
        files = {path.name: path.read_bytes() for path in sorted((folder / "files").iterdir())}
        contents.append((rows, files))
    assert contents[0] == contents[1]
    assert len(contents[0][1]) == 8
    assert hostile.marked(marks) == [], "workers import from the current folder"


@pytest.mark.slow
def test_a_killed_study_loses_and_repeats_nothing(tmp_path: Path) -> None:
    folder = tmp_path / "study"
    command = [
        sys.executable, "-m", "pc2cad.cli.main", "study", "pyramid_cut", "--vary", "p=0.1:0.9:30",
        "-o", str(folder), "--workers", "2", "--resume",
    ]  # fmt: skip
    journal = folder / "journal.jsonl"
    for more in (3, 11):
        process = subprocess.Popen(command, stderr=subprocess.PIPE)
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline and process.poll() is None:
            if journal.exists() and journal.read_bytes().count(b"\n") > more:
                break
            time.sleep(0.005)
        process.send_signal(signal.SIGKILL)
        process.wait()
        assert process.returncode == -signal.SIGKILL, process.stderr and process.stderr.read()
        assert process.stderr is not None
        process.stderr.close()
        with open(folder / "results.csv", newline="") as stream:
            assert len(list(csv.DictReader(stream))) == 30, "the table is whole at every moment"
    _no_orphans()
    subprocess.run(command, check=True, timeout=120, stdout=subprocess.DEVNULL)
    keys = [json.loads(line).get("key") for line in journal.read_bytes().splitlines()[1:]]
    assert len(keys) == len(set(keys)) == 30
    with open(folder / "results.csv", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert all(row["status"] == "built" for row in rows)
    for row in rows:
        exact = 31.5 * (1 - float(row["p"]) * 0.25 * 0.75)
        assert float(row["volume"]) == pytest.approx(exact, rel=1e-14)
    assert not list((folder / "files").glob(".pc2cad-*"))


def _no_orphans() -> None:
    """Wait for the workers of a killed study to end, which the system sees to."""
    if sys.platform != "linux":
        return
    deadline = time.monotonic() + 10
    while time.monotonic() < deadline:
        alive = []
        for folder in Path("/proc").iterdir():
            try:
                line = (folder / "cmdline").read_bytes() if folder.name.isdigit() else b""
                parent = (folder / "stat").read_text().split()[3] if line else "0"
            except OSError:
                continue
            if b"pc2cad.studies.worker" in line and parent == "1":
                alive.append(folder.name)
        if not alive:
            return
        time.sleep(0.1)
    pytest.fail(f"workers outlive their study: {alive}")


# -- Dask and addresses ------------------------------------------------------------------------


@pytest.mark.slow
def test_dask_gives_the_same_rows(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed")
    local = study(tmp_path / "local", [0.25, 0.5, 2.0, 0.75])
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=2, processes=False, dashboard_address=":0"
    ) as cluster:
        from pc2cad.studies.dask import DaskEngine

        def engine(task: Task) -> DaskEngine:
            return DaskEngine(task, cluster)

        folder = tmp_path / "dask"
        shared = run_study(plan([0.25, 0.5, 2.0, 0.75]), task(folder, ("step",)), folder, engine)
    assert len(local.rows) == 4
    for a, b in zip(local.rows, shared.rows, strict=True):
        assert a["volume"] == b["volume"]
        assert (a["status"], a["reason"], a["step"]) == (b["status"], b["reason"], b["step"])


@pytest.mark.slow
def test_a_dask_worker_that_is_killed_costs_nothing_but_time(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed")
    values = [0.02 * i for i in range(1, 41)]
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=":0"
    ) as cluster:
        from pc2cad.studies.dask import DaskEngine

        def engine(task: Task) -> DaskEngine:
            return DaskEngine(task, cluster)

        def kill(state: Progress) -> None:
            if killed or state.finished < 8:  # from then on there are bundles
                return
            nanny = next(iter(cluster.workers.values()))
            killed.append(nanny.process.pid)
            os.kill(nanny.process.pid, signal.SIGKILL)

        killed: list[int] = []
        result = run_study(plan(values), task(tmp_path), tmp_path, engine, progress=kill)
    assert killed
    assert result.counts == {"built": 40}
    lines = (tmp_path / "journal.jsonl").read_text().splitlines()[1:]
    assert len({json.loads(line)["key"] for line in lines}) == len(lines) == 40


def test_bundles_are_as_long_as_pays_and_end_with_single_jobs() -> None:
    pytest.importorskip("distributed")
    from pc2cad.studies.dask import BUNDLE, Supply

    jobs = [Job(str(i), {}) for i in range(1000)]
    supply = Supply(jobs)
    first = [supply.bundle(threads=2) for _ in range(4)]
    assert [len(bundle) for bundle in first] == [1] * 4, "nobody knows how long they take"
    supply.note(Outcome(job.key, "built", times={"total": BUNDLE / 50}) for (job,) in first)
    bundles = list(iter(lambda: supply.bundle(threads=2), []))
    assert [job for bundle in [*first, *bundles] for job in bundle] == jobs
    sizes = [len(bundle) for bundle in bundles]
    assert sizes[:10] == [50] * 10
    assert sizes == sorted(sizes, reverse=True)
    assert all(size <= max(1, sum(sizes[i:]) / 4) for i, size in enumerate(sizes))
    assert sizes[-4:] == [1] * 4


Guarded = Callable[[Sequence[Job]], Iterator[list[Outcome]]]


@pytest.fixture
def on_dask(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Callable[[Guarded, int], Any]]:
    """Yield a maker of engines on clusters in this process; a function runs their bundles."""
    distributed = pytest.importorskip("distributed")
    from pc2cad.studies import dask

    with ExitStack() as stack:

        def make(run: Guarded, workers: int) -> dask.DaskEngine:
            monkeypatch.setattr(dask, "_guarded", lambda task, limits: SimpleNamespace(run=run))
            cluster = stack.enter_context(
                distributed.LocalCluster(
                    n_workers=workers, threads_per_worker=1, processes=False, dashboard_address=":0"
                )
            )
            return stack.enter_context(dask.DaskEngine(task(tmp_path), cluster))

        yield make


JOBS = [Job(str(i), {}) for i in range(60)]


def built(job: Job) -> list[Outcome]:
    return [Outcome(job.key, "built", times={"total": 0.1})]


def test_what_became_of_a_job_is_told_before_its_bundle_ends(on_dask: Any) -> None:
    known: dict[str, threading.Event] = defaultdict(threading.Event)
    lengths = []

    def run(bundle: Sequence[Job]) -> Iterator[list[Outcome]]:
        lengths.append(len(bundle))
        for job in bundle:
            yield built(job)
            assert known[job.key].wait(3), "nobody knows of it before its bundle ends"

    engine = on_dask(run, 1)
    told = []
    for outcomes in engine.run(JOBS):
        told += [outcome.key for outcome in outcomes]
        for outcome in outcomes:
            known[outcome.key].set()
    assert told == [job.key for job in JOBS]
    assert max(lengths) > 10


def test_what_was_not_told_comes_with_its_bundle(
    on_dask: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pc2cad.studies.dask.DaskEngine._listen", lambda engine, event: None)
    engine = on_dask(lambda bundle: map(built, bundle), 1)
    assert [outcome.key for batch in engine.run(JOBS) for outcome in batch] == [
        job.key for job in JOBS
    ]


def test_the_bundle_of_a_lost_worker_is_counted_once(on_dask: Any) -> None:
    ran: list[str] = []
    lost = threading.Event()

    def run(bundle: Sequence[Job]) -> Iterator[list[Outcome]]:
        from distributed import get_worker

        for job in bundle:
            ran.append(job.key)
            yield built(job)
            if job in bundle[2:3] and not lost.is_set():
                lost.set()
                worker = get_worker()
                worker.loop.add_callback(worker.batched_stream.abort)
                worker.loop.add_callback(worker.close, executor_wait=False)
                time.sleep(0.3)

    engine = on_dask(run, 2)
    told = [outcome.key for outcomes in engine.run(JOBS) for outcome in outcomes]
    assert lost.is_set()
    assert sorted(told) == sorted(job.key for job in JOBS)
    assert len(ran) > len(told), "no bundle was run again"


def test_a_bundle_that_nobody_waits_for_goes_no_further(on_dask: Any) -> None:
    left, went_on = threading.Event(), []

    def run(bundle: Sequence[Job]) -> Iterator[list[Outcome]]:
        for job in bundle:
            if left.wait(0.1 if len(bundle) > 5 else 0):
                time.sleep(0.1)  # until the worker has been told
                went_on.append(job.key)
            yield built(job)

    engine = on_dask(run, 1)
    for outcomes in engine.run(JOBS):
        if int(outcomes[-1].key) >= 5:
            break
    engine.__exit__(None, None, None)
    left.set()
    time.sleep(0.4)
    assert len(went_on) <= 1


def test_of_a_bundle_that_fails_each_job_is_tried_alone(on_dask: Any) -> None:
    def run(bundle: Sequence[Job]) -> Iterator[list[Outcome]]:
        for job in bundle:
            if job.key == "20":
                raise WorkerNotStartedError("no kernel")
            yield built(job)

    engine = on_dask(run, 1)
    told = {outcome.key: outcome for outcomes in engine.run(JOBS) for outcome in outcomes}
    assert set(told) == {job.key for job in JOBS}
    assert [key for key, outcome in told.items() if outcome.status != "built"] == ["20"]
    assert told["20"].reason == "the cluster gave it up: no kernel"


def test_a_worker_with_another_version_is_one_sentence(
    on_dask: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    from pc2cad.studies import dask

    engine = on_dask(lambda bundle: iter(()), 1)
    monkeypatch.setattr(dask, "__version__", "9.9")
    with pytest.raises(dask.ClusterDiffersError, match=r"has pc2cad \d.*the study has 9\.9"):
        next(engine.run(JOBS))


def test_a_cluster_that_is_lost_ends_the_study_with_what_had_come(on_dask: Any) -> None:
    from pc2cad.studies.dask import ClusterLostError

    lost = threading.Event()

    def run(bundle: Sequence[Job]) -> Iterator[list[Outcome]]:
        for job in bundle:
            if job.key == "9":
                lost.wait(10)
            yield built(job)

    engine = on_dask(run, 1)
    told = []

    def follow() -> None:
        for outcomes in engine.run(JOBS):
            told.extend(outcome.key for outcome in outcomes)
            if len(told) == 9:
                client = engine._client
                client.loop.add_callback(client.scheduler_comm.comm.abort)

    with pytest.raises(ClusterLostError, match="--resume"):
        follow()
    lost.set()
    assert told == [str(i) for i in range(9)]


def sentence_of(capsys: pytest.CaptureFixture[str], folder: Path, address: str) -> tuple[int, str]:
    """Return exit code and message of a study on a cluster."""
    pytest.importorskip("distributed")
    arguments = ["study", "pyramid_cut", "--vary", "p=.2,.3", "-o", str(folder / "s")]
    code = main([*arguments, "--dask", address])
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1, said.err
    return code, said.err


@pytest.mark.parametrize(
    "address",
    ["nonsense", "", "tcp://", "tcp://127.0.0.1", "tcp://127.0.0.1:port", "http://127.0.0.1:1",
     "/etc/passwd", "tcp://127.0.0.1:", "tcp://[::1"],
)  # fmt: skip
def test_what_is_no_address_of_a_scheduler_is_one_sentence(
    address: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, said = sentence_of(capsys, tmp_path, address)
    assert code == 2
    assert f"--dask: '{address}' is no address of a Dask scheduler" in said


#: what somebody who listens on a port may do with a connection
LISTENERS: dict[str, Callable[[socket.socket], object]] = {
    "silent": lambda connection: None,
    "web": lambda connection: connection.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n"),
    "endless": lambda connection: connection.sendall((10**6).to_bytes(8, "little") + b"a"),
    "noise": lambda connection: connection.sendall((16).to_bytes(8, "little") + bytes(16)),
    "closed": lambda connection: connection.close(),
}


@pytest.mark.parametrize("kind", LISTENERS)
def test_who_listens_but_is_no_scheduler_is_one_sentence_soon(
    kind: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("pc2cad.studies.scheduler.SILENCE", 0.4)
    connections = []

    def listen() -> None:
        with suppress(OSError):
            while True:
                connections.append(listener.accept()[0])
                LISTENERS[kind](connections[-1])

    with socket.create_server(("127.0.0.1", 0)) as listener:
        threading.Thread(target=listen, daemon=True).start()
        begun = time.monotonic()
        address = f"tcp://127.0.0.1:{listener.getsockname()[1]}"
        code, said = sentence_of(capsys, tmp_path, address)
    assert time.monotonic() - begun < 10
    assert connections
    assert "Dask" in said
    assert address in said
    assert code == 5
    for connection in connections:
        connection.close()


def test_a_port_without_anybody_is_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pc2cad.studies.scheduler.SILENCE", 0.4)
    code, said = sentence_of(capsys, tmp_path, "tcp://127.0.0.1:1")
    assert code == 5
    assert "the Dask cluster tcp://127.0.0.1:1 cannot be reached" in said


def test_a_worker_is_no_scheduler(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], on_dask: Any
) -> None:
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=1, processes=False, protocol="tcp", dashboard_address=":0"
    ) as cluster:
        code, said = sentence_of(capsys, tmp_path, cluster.workers[0].address)
    assert code == 2
    assert "is a Dask Worker, no scheduler" in said


def test_limits_of_silence_are_within_what_is_promised() -> None:
    from pc2cad.studies import dask, scheduler

    assert 2 * scheduler.SILENCE + scheduler.FAREWELL < 15
    assert dask.LOOK + scheduler.SILENCE + scheduler.FAREWELL < 15
    assert Limits().wait + 2 * dask.LOOK + scheduler.FAREWELL < 15


def test_a_cluster_without_workers_is_one_sentence(
    on_dask: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    from pc2cad.studies import dask

    monkeypatch.setattr(dask, "LOOK", 0.1)
    engine = on_dask(lambda bundle: iter(()), 0)
    engine._limits = Limits(wait=0.3)
    with pytest.raises(dask.NoWorkersError, match=r"no worker for 0\.3 s.*--resume"):
        list(engine.run(JOBS))


def test_a_cluster_that_loses_its_workers_keeps_what_had_come(
    on_dask: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    from pc2cad.studies import dask

    monkeypatch.setattr(dask, "LOOK", 0.1)
    lost = threading.Event()

    def run(bundle: Sequence[Job]) -> Iterator[list[Outcome]]:
        from distributed import get_worker

        for job in bundle:
            if job.key == "3" and not lost.is_set():
                lost.set()
                worker = get_worker()
                worker.loop.add_callback(worker.batched_stream.abort)
                worker.loop.add_callback(worker.close, executor_wait=False)
                time.sleep(0.3)
            yield built(job)

    engine = on_dask(run, 1)
    engine._limits = Limits(wait=0.5)
    told: list[str] = []

    def follow() -> None:
        for outcomes in engine.run(JOBS):
            told.extend(outcome.key for outcome in outcomes)

    with pytest.raises(dask.NoWorkersError):
        follow()
    assert 1 <= len(told) <= 4
    assert told == [str(i) for i in range(len(told))]


def test_a_scheduler_that_falls_silent_ends_the_study_with_what_had_come(
    on_dask: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is still connected, and answers nothing any more, as when its machine is gone."""
    from pc2cad.studies import dask, scheduler

    monkeypatch.setattr(dask, "LOOK", 0.1)
    monkeypatch.setattr(scheduler, "SILENCE", 0.5)
    fallen, left = threading.Event(), threading.Event()

    def run(bundle: Sequence[Job]) -> Iterator[list[Outcome]]:
        for job in bundle:
            if job.key == "9":
                left.wait(10)
            yield built(job)

    engine = on_dask(run, 1)
    told = []

    async def nothing(*_: Any, **__: Any) -> None:
        fallen.set()
        await asyncio.sleep(60)

    def follow() -> None:
        for outcomes in engine.run(JOBS):
            told.extend(outcome.key for outcome in outcomes)
            if len(told) == 9:
                engine._client.cluster.scheduler.handlers["ncores"] = nothing

    begun = time.monotonic()
    with pytest.raises(dask.ClusterLostError, match="does not answer any more"):
        follow()
    left.set()
    assert fallen.is_set()
    assert told == [str(i) for i in range(9)]
    assert time.monotonic() - begun < 10


SCHEDULER = """
import asyncio, sys
from distributed import Scheduler, Worker
async def main():
    async with Scheduler(host="127.0.0.1", port=0, dashboard_address=":0") as scheduler:
        async with Worker(scheduler.address, nthreads=1):
            print(scheduler.address, flush=True)
            await scheduler.finished()
asyncio.run(main())
"""


@pytest.mark.slow
@pytest.mark.parametrize("number", ["SIGKILL", "SIGTERM", "SIGSTOP"])
def test_a_scheduler_that_is_killed_is_one_sentence(number: str, tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    command = [sys.executable, "-P", "-c", SCHEDULER]
    scheduler = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
        start_new_session=True, cwd=tmp_path,
    )  # fmt: skip
    assert scheduler.stdout is not None
    try:
        address = scheduler.stdout.readline().strip()
        study = subprocess.Popen(
            [sys.executable, "-P", "-m", "pc2cad", "study", "pyramid_cut", "--vary",
             "p=0.1:0.9:200", "-o", str(tmp_path / "s"), "--dask", address],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        journal = tmp_path / "s" / "journal.jsonl"
        deadline = time.monotonic() + 120
        while not (journal.exists() and journal.read_bytes().count(b"\n") > 5):
            assert time.monotonic() < deadline
            assert study.poll() is None
            time.sleep(0.02)
        scheduler.send_signal(getattr(signal, number))
        begun = time.monotonic()
        out, err = study.communicate(timeout=60)
        assert time.monotonic() - begun < 15
    finally:
        with suppress(ProcessLookupError):
            os.killpg(scheduler.pid, signal.SIGKILL)
        scheduler.communicate()
    assert (study.returncode, out) == (5, "")
    assert err.count("\n") == 1, err
    assert "the Dask cluster has ended, or does not answer any more; go on with --resume" in err
    assert journal.read_bytes().count(b"\n") > 5


@pytest.mark.slow
def test_files_go_to_an_address(tmp_path: Path) -> None:
    pytest.importorskip("fsspec")
    address = f"file://{tmp_path / 'elsewhere'}"
    result = pc.study("pyramid_cut", tmp_path / "s", vary={"p": [0.5]}, store=address, workers=1)
    name = Path(str(result.rows[0]["step"])).name
    assert (tmp_path / "elsewhere" / name).read_bytes().startswith(b"ISO-10303-21;")
    assert pc.study(
        "pyramid_cut", tmp_path / "s", vary={"p": [0.5]}, store=address, workers=1, resume=True
    ).built == 0  # fmt: skip


# -- the command -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "code", "reason"),
    [
        (["--vary", "p=0.1:0.9:3", "--formats", "doc"], 2, "'.doc'"),
        (["--vary", "z=0.1:0.9:3"], 2, "no parameter 'z'"),
        (["--vary", "p"], 2, "NAME=LOW:HIGH:COUNT"),
        ([], 2, "at least one parameter"),
        (["--vary", "p=1,2", "--table", "x.csv"], 2, "a table gives the variants"),
        (["--vary", "p=1,2", "--workers", "-1"], 2, "positive"),
        (["--vary", "p=1,2", "-s", "q=__import__"], 2, "of parameter q"),
    ],
)
def test_mistakes_are_told_before_any_worker_starts(
    arguments: list[str], code: int, reason: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "study"
    assert main(["study", "pyramid_cut", "-o", str(folder), *arguments]) == code
    assert reason in capsys.readouterr().err
    assert not folder.exists()


def test_a_folder_that_cannot_be_made_is_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    arguments = ["study", "pyramid_cut", "--vary", "p=0.5", "-o", str(tmp_path / "file" / "x")]
    assert main(arguments) == 5
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize("device", ["/dev/full", "/dev/zero"])
def test_a_device_is_no_journal(
    device: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if not os.path.exists(device):
        pytest.skip(f"this system has no {device}")
    (tmp_path / "journal.jsonl").symlink_to(device)
    assert main(["study", "pyramid_cut", "--vary", "p=0.5", "-o", str(tmp_path)]) == 5
    assert "is a device" in capsys.readouterr().err


def test_a_full_disk_under_the_journal_is_one_sentence(tmp_path: Path) -> None:
    resource = pytest.importorskip("resource")
    script = (
        "import resource, signal; signal.signal(signal.SIGXFSZ, signal.SIG_IGN);"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (600, 600));"
        "import sys; sys.dont_write_bytecode = True;"  # it would be cut off as well
        "from pc2cad.cli.main import main; sys.exit(main(sys.argv[1:]))"
    )
    assert resource
    done = subprocess.run(
        [sys.executable, "-c", script, "study", "pyramid_cut", "--vary", "p=0.5,0.6,0.7",
         "--formats", "none", "-o", str(tmp_path / "s"), "--workers", "1"],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 5
    assert "cannot be written" in done.stderr or "cannot write" in done.stderr
    assert done.stderr.count("\n") == 1


def test_plots_show_columns_and_refuse_others(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    from pc2cad.studies.overview import plot

    outcomes = {"a": Outcome("a", "built", figures={"volume": 2.0, "evidence": "exact"}),
                "b": Outcome("b", "not a solid", "it folds")}  # fmt: skip
    table = rows(plan([0.25, 0.5, 1.0]), ["a", "b", "c"], outcomes, ())
    assert [row["status"] for row in table] == ["built", "not a solid", "waiting"]
    assert plot(table, "volume", "p").startswith(b"\x89PNG")
    with pytest.raises(InputError, match="no column of numbers 'evidence'"):
        plot(table, "evidence", "p")


@pytest.mark.slow
def test_a_contact_sheet_shows_parts_and_refusals(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    result = pc.study(
        "pyramid_cut", tmp_path, vary={"p": [0.5, 7.0]}, formats=(), thumbnails=True, workers=1
    )
    assert [row["status"] for row in result.rows] == ["built", "bad input"]
    picture = (tmp_path / str(result.rows[0]["thumbnail"])).read_bytes()
    sheet = (tmp_path / "contact-sheet.png").read_bytes()
    assert picture.startswith(b"\x89PNG")
    assert sheet.startswith(b"\x89PNG")
    assert len(sheet) > len(picture), "the sheet holds the picture and the titles"
