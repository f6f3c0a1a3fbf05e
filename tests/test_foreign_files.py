"""What pc2cad did not write stays as it is, and what it leaves when it is killed goes."""

from __future__ import annotations

import csv
import hashlib
import json
import os
import random
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hostile_texts import any_text
from hypothesis import HealthCheck, given, settings

from pc2cad.cli.main import main
from pc2cad.errors import FileNotWrittenError, InputError, PointCadError
from pc2cad.export.files import check_target, replacing, sweep, write_atomically
from pc2cad.studies.entries import read_outcome
from pc2cad.studies.journal import NotOursError, StudyDiffersError
from pc2cad.studies.plan import Plan, grid
from pc2cad.studies.run import StudyResult, run_study
from pc2cad.studies.store import open_store
from pc2cad.studies.study import study
from pc2cad.studies.variant import Job, Outcome, Task, file_name
from pc2cad.templates.ranges import read_axis
from pc2cad.trust.names import NameNotAllowedError
from pc2cad.trust.processes import start_of

VALUES = (0.25, 0.5, 0.75)


class Engine:
    """Does the jobs here, without a kernel: a file that holds the variant's name."""

    def __init__(self, task: Task) -> None:
        self._task = task

    def run(self, jobs: Sequence[Job]) -> Iterator[list[Outcome]]:
        for job in jobs:
            data = job.key.encode()
            kinds = self._task.formats
            for kind in kinds:
                open_store(self._task.store).write(file_name(job.key, kind), data)
            yield [
                Outcome(
                    job.key, "built", figures={"volume": job.values["p"]},
                    files={kind: file_name(job.key, kind) for kind in kinds},
                    hashes=dict.fromkeys(kinds, hashlib.sha256(data).hexdigest()),
                )
            ]  # fmt: skip


def engine(task: Task) -> AbstractContextManager[Engine]:
    return nullcontext(Engine(task))


def task(folder: Path, **options: Any) -> Task:
    options = {"formats": ("step",), "store": str(folder / "files"), **options}
    return Task("title = 't'", "t", **options)


def plan(values: Sequence[float] = VALUES) -> Plan:
    return grid([read_axis("p", values)])


def run(folder: Path, values: Sequence[float] = VALUES, **options: Any) -> StudyResult:
    return run_study(plan(values), task(folder), folder, engine, **options)


def contents(folder: Path) -> dict[str, bytes | str]:
    return {
        str(path.relative_to(folder)): os.readlink(path) if path.is_symlink() else path.read_bytes()
        for path in sorted(folder.rglob("*")) if path.is_symlink() or path.is_file()
    }  # fmt: skip


# -- a study's folder ------------------------------------------------------------------------------

FOREIGN: dict[str, bytes] = {
    "journal.jsonl": b"my diary\n", "results.csv": b"mine", "results.parquet": b"mine",
    "contact-sheet.png": b"mine",
}  # fmt: skip
JOURNALS = (
    b"", b"\n", b"{}\n", b"[]\n", b'"study"\n', b"{", b"\x00\x00", b"\xff\n",
    b"[" * 100_000 + b"\n",
    b'{"a": ' * 50_000 + b"\n", b'{"x": ' + b"9" * 5000 + b"}\n", b'{"study": null',
    b"x" * 3_000_000,
    b'{"name": "another program\'s"}\n{"study": 1}\n',
)  # fmt: skip


@pytest.mark.parametrize("name", FOREIGN)
@pytest.mark.parametrize("resume", [False, True])
def test_foreign_files_stop_a_study_before_it_begins(
    name: str, resume: bool, tmp_path: Path
) -> None:
    (tmp_path / name).write_bytes(FOREIGN[name])
    with pytest.raises(NotOursError, match=name):
        run(tmp_path, resume=resume, also=("contact-sheet.png",))
    assert contents(tmp_path) == {name: FOREIGN[name]}
    (tmp_path / name).unlink()
    run(tmp_path, also=("contact-sheet.png",))


@pytest.mark.parametrize("data", JOURNALS, ids=range(len(JOURNALS)))
@pytest.mark.parametrize("resume", [False, True])
def test_a_foreign_journal_stays_as_it_is(data: bytes, resume: bool, tmp_path: Path) -> None:
    (tmp_path / "journal.jsonl").write_bytes(data)
    with pytest.raises(NotOursError, match=r"no journal of pc2cad's"):
        run(tmp_path, resume=resume)
    assert contents(tmp_path) == {"journal.jsonl": data}


def test_files_of_variants_that_are_there_stop_a_study(tmp_path: Path) -> None:
    key = task(tmp_path).key({"p": 0.5})
    (tmp_path / "files").mkdir()
    (tmp_path / "files" / f"{key}.step").write_bytes(b"mine")
    (tmp_path / "files" / "other.step").write_bytes(b"mine")
    with pytest.raises(
        NotOursError, match=f"a file {re.escape(key)}.step is there, and no journal"
    ):
        run(tmp_path)
    assert set(contents(tmp_path)) == {f"files/{key}.step", "files/other.step"}
    (tmp_path / "files" / f"{key}.step").unlink()
    assert run(tmp_path).counts == {"built": 3}
    assert (tmp_path / "files" / "other.step").read_bytes() == b"mine"


LINKED = ("journal.jsonl", "results.csv", "files")


@pytest.mark.parametrize("name", LINKED)
@pytest.mark.parametrize("kind", ["file", "link", "dangling", "folder", "pipe", "loop"])
def test_whatever_has_the_name_of_a_studys_file_is_one_sentence(
    name: str, kind: str, tmp_path: Path
) -> None:
    folder, outside = tmp_path / "s", tmp_path / "outside"
    folder.mkdir()
    outside.write_bytes(b"mine")
    make: dict[str, Callable[[Path], object]] = {
        "file": lambda path: path.write_bytes(b"mine"),
        "link": lambda path: path.symlink_to(outside),
        "dangling": lambda path: path.symlink_to(tmp_path / "nowhere"),
        "folder": Path.mkdir, "pipe": os.mkfifo, "loop": lambda path: path.symlink_to(path),
    }  # fmt: skip
    make[kind](folder / name)
    if (name, kind) == ("files", "folder"):
        return
    if (name, kind) == ("files", "dangling"):
        with pytest.raises(FileNotWrittenError, match="cannot be made"):
            run(folder)
        return
    with pytest.raises(PointCadError):
        run(folder)
    assert os.listdir(folder) == [name]
    assert outside.read_bytes() == b"mine"
    assert sorted(os.listdir(tmp_path)) == ["outside", "s"]


def test_a_link_that_is_put_in_later_is_not_followed(tmp_path: Path) -> None:
    run(tmp_path)
    (tmp_path / "mine").write_bytes(b"mine")
    for name in ("results.csv", f"files/{task(tmp_path).key({'p': 0.5})}.step"):
        (tmp_path / name).unlink()
        (tmp_path / name).symlink_to(tmp_path / "mine")
    with pytest.raises(FileNotWrittenError, match="symbolic link"):
        run(tmp_path, resume=True)
    assert (tmp_path / "mine").read_bytes() == b"mine"


@pytest.mark.parametrize("folder", ["", "a\0b", "x" * 300, "file", "file/s"])
def test_folders_that_cannot_be(
    folder: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_bytes(b"mine")
    assert main(["study", "pyramid_cut", "--vary", "p=.5", "-o", folder]) in (2, 5)
    assert "unexpected" not in capsys.readouterr().err
    assert contents(tmp_path) == {"file": b"mine"}


# -- going on --------------------------------------------------------------------------------------

OTHERS: dict[str, tuple[dict[str, Any], Sequence[float], str]] = {
    "values": ({}, (0.25, 0.5), "variants: it was 3, now 2; values of p: it was 3 from 0.25 to"),
    "order": ({}, (0.5, 0.25, 0.75), "the variants differ"),
    "inner values": ({}, (0.25, 0.6, 0.75), "the variants differ"),
    "formats": ({"formats": ("stl",)}, VALUES, "formats: it was step, now stl"),
    "no formats": ({"formats": ()}, VALUES, "formats: it was step, now none"),
    "tolerance": ({"tolerance": 1e-3}, VALUES, "tolerance: it was not given, now 0.001"),
    "degree": ({"degree": 5}, VALUES, "degree: it was not given, now 5"),
    "max degree": ({"max_degree": 9}, VALUES, "max degree: it was not given, now 9"),
    "profile": ({"profile": "cubic"}, VALUES, "profile: it was compact, now cubic"),
    "thumbnails": ({"thumbnails": True}, VALUES, "thumbnails: it was False, now True"),
    "settings": ({"fixed": {"q": "1/3"}}, VALUES, "-s q: it was not given, now 1/3"),
    "template": ({"template": "title = 'u'"}, VALUES, "the template's text differs"),
}


@pytest.mark.parametrize("what", OTHERS)
def test_going_on_with_another_study_says_what_differs(what: str, tmp_path: Path) -> None:
    run(tmp_path)
    before = contents(tmp_path)
    options, values, words = OTHERS[what]
    other = replace(task(tmp_path), **options)
    with pytest.raises(StudyDiffersError, match="holds another study") as refusal:
        run_study(plan(values), other, tmp_path, engine, resume=True)
    assert words in str(refusal.value)
    assert contents(tmp_path) == before
    assert run(tmp_path, resume=True).built == 0


def test_a_journal_of_another_version_is_told(tmp_path: Path) -> None:
    run(tmp_path)
    path = tmp_path / "journal.jsonl"
    lines = path.read_bytes().splitlines(keepends=True)
    header = json.loads(lines[0])
    others: list[tuple[Any, str]] = [
        ("f" * 32, "another version"), ({}, "pc2cad: it was not given"),
        ({**header["study"], "pc2cad": "\x1b[2J"}, r"it was \x1b[2J"),
    ]  # fmt: skip
    assert len(others) == 3
    for began, words in others:
        path.write_bytes(json.dumps({"study": began}).encode() + b"\n" + b"".join(lines[1:]))
        before = contents(tmp_path)
        with pytest.raises(StudyDiffersError) as refusal:
            run(tmp_path, resume=True)
        assert words in str(refusal.value)
        assert contents(tmp_path) == before


@pytest.mark.parametrize("data", [b"", b"other", None], ids=["emptied", "changed", "gone"])
def test_files_are_as_the_journal_says_after_going_on(data: bytes | None, tmp_path: Path) -> None:
    first = run(tmp_path)
    path = tmp_path / str(first.rows[1]["step"])
    whole = path.read_bytes()
    path.unlink()
    if data is not None:
        path.write_bytes(data)
    again = run(tmp_path, resume=True)
    assert again.built == 1
    assert path.read_bytes() == whole
    assert path.name in again.notes[0]
    aside = path.with_name(f"{path.name}.changed")
    assert (aside.read_bytes() if aside.exists() else None) == data
    with open(tmp_path / "results.csv", newline="") as stream:
        assert [row["status"] for row in csv.DictReader(stream)] == ["built"] * 3
    assert run(tmp_path, resume=True).notes == []


def test_the_command_goes_on_with_the_same_study_only(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pc2cad.studies.study._engine", lambda *_: engine)
    command = ["study", "pyramid_cut", "--workers", "1", "-o", str(tmp_path), "--vary"]
    assert main([*command, "p=.3"]) == 0
    (step,) = (tmp_path / "files").iterdir()
    whole = step.read_bytes()
    step.write_bytes(b"")
    capsys.readouterr()
    assert main([*command, "p=.4", "--resume"]) == 2
    assert "values of p: it was 0.3, now 0.4" in capsys.readouterr().err
    assert main([*command, "p=.3", "--resume"]) == 0
    assert f"set aside and built again: {step.name}.changed" in capsys.readouterr().out
    assert len(step.read_bytes()) == len(whole)


LINES = (
    b"\n", b"7\n", b"null\n", b"{}\n", b'{"key": "a"}\n', b"[" * 100_000 + b"\n", b"\xff\xfe\n",
    b'{"key": "a", "status": "built", "figures": {"volume": NaN}}\n',
    b'{"key": "a", "status": "built", "figures": {"faces": ' + b"9" * 400 + b"}}\n",
    b'{"key": "a", "status": "built", "figures": {"volume": "=1+1"}}\n',
    b'{"key": "a", "status": "built", "figures": {"units": "\\u001b[2J"}}\n',
    b'{"key": "a", "status": "built", "files": {"step": "../../etc/passwd"}}\n',
    b'{"key": "a", "status": "built", "files": {"../x": "a.../x"}}\n',
    b'{"key": "a", "status": "built", "times": {"total": 1e999}}\n',
    b'{"key": "a", "status": "done"}\n', b'{"key": [1], "status": "built"}\n',
    b'{"key": "a", "status": {"a": 1}}\n', b'{"key": "a", "status": "built", "more": 1}\n',
    b'{"own": {"a": 1}}\n', b'{"own": [["a"]]}\n', b"x" * 3_000_000 + b"\n",
)  # fmt: skip


@pytest.mark.parametrize("line", LINES, ids=range(len(LINES)))
def test_lines_that_hold_no_outcome_are_passed_over_and_stay(line: bytes, tmp_path: Path) -> None:
    first = run(tmp_path)
    path = tmp_path / "journal.jsonl"
    lines = path.read_bytes().splitlines(keepends=True)
    data = b"".join([*lines[:2], line, *lines[2:]])
    path.write_bytes(data)
    again = run(tmp_path, resume=True)
    assert (again.built, again.rows) == (0, first.rows)
    assert [line for line in again.notes if "1 lines of the journal" not in line] == []
    assert path.read_bytes() == data


def test_outcomes_of_a_journal_are_what_a_worker_says() -> None:
    good = {
        "key": "a1", "status": "built", "reason": "", "figures": {"volume": 1, "units": "mm"},
        "files": {"step": "a1.step", "thumbnail": "a1.png"}, "hashes": {"step": "0" * 64},
        "times": {"total": 0.5},
    }  # fmt: skip
    assert read_outcome(good) == Outcome(**good)  # type: ignore[arg-type]
    assert read_outcome({**good, "key": "a2"}) is None
    assert read_outcome({**good, "hashes": {"step": "0" * 63}}) is None
    told = read_outcome({"key": "a", "status": "failed", "reason": "a\n\x1b[2Jb"})
    assert told is not None
    assert told.reason == "a [2Jb"


@given(any_text)
@settings(
    deadline=None, max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_formats_are_endings(tmp_path: Path, text: str) -> None:
    with pytest.raises(InputError):
        study("pyramid_cut", tmp_path / "s", vary={"p": [0.5]}, formats=(text,))
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize(
    "text", ["/../../../evil.step", "../evil.step", "x/../../evil.step", "x.step", "step/",
             "a\0.stl", "step\n", "..step"],
)  # fmt: skip
def test_formats_lead_nowhere_else(text: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"ending"):
        study("pyramid_cut", tmp_path / "s", vary={"p": [0.5]}, formats=(text,))
    if not text.endswith(".step") or "/" in text:
        with pytest.raises(NameNotAllowedError):
            open_store(str(tmp_path / "files")).write(f"0.{text}", b"")
    assert list(tmp_path.rglob("*.step")) == []


@pytest.mark.parametrize("name", ["volume", "status", "variant", "step"])
def test_a_parameter_is_no_column_of_the_results(name: str, tmp_path: Path) -> None:
    path = tmp_path / "t.toml"
    path.write_text(f'title = "t"\n[parameters]\n{name} = 1\n[solid]\nx = "u"\ny = "v"\nz = "w"\n')
    with pytest.raises(InputError, match=f"the parameter {name} cannot vary"):
        study(path, tmp_path / "s", vary={name: [1.0, 2.0]})
    assert os.listdir(tmp_path) == ["t.toml"]


def test_a_store_that_cannot_be_is_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["study", "pyramid_cut", "--vary", "p=.5", "-o", str(tmp_path / "s"), "--store"]
    for store in ("a\0b", "x" * 300, "/dev/null"):
        assert main([*command, store]) == 5
        assert "cannot be used" in capsys.readouterr().err
    assert os.listdir(tmp_path / "s") == []


# -- outputs ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("verb", "ending"), [("render", "svg"), ("view", "html"), ("points", "ply"), ("mesh", "vtu")]
)
def test_no_verb_writes_over_its_template(
    verb: str, ending: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / f"t.{ending}"
    path.write_text('title = "t"\n[solid]\nx = "u"\ny = "v"\nz = "w"\n')
    text = path.read_text()
    assert main([verb, str(path), "-o", str(path)]) == 2
    assert "the template" in capsys.readouterr().err
    assert path.read_text() == text


def test_outputs_that_differ_in_capitals_alone_are_one_on_many_systems(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["build", "pyramid", "-o", "Ä.step", "-o", "A\u0308.STEP"]) == 2
    assert "capitals or accents" in capsys.readouterr().err


def test_a_new_file_takes_nobodys_place(tmp_path: Path) -> None:
    path = tmp_path / "a"
    write_atomically(path, b"one", new=True)
    with pytest.raises(FileNotWrittenError, match="has that name already"):
        write_atomically(path, b"two", new=True)
    (tmp_path / "link").symlink_to(tmp_path / "b")
    with pytest.raises(FileNotWrittenError, match="symbolic link"):
        write_atomically(tmp_path / "link", b"two", new=True)
    assert contents(tmp_path) == {"a": b"one", "link": str(tmp_path / "b")}


# -- left-overs ------------------------------------------------------------------------------------

#: writes files of all lengths that say what they hold, until it is killed
WRITER = """
import hashlib, os, random, sys
from pathlib import Path
from pc2cad.export.files import replacing, write_atomically
made = [os.urandom(length) for length in (10, 10**5, 10**7)]
made = [hashlib.sha256(data).hexdigest().encode() + data for data in made]
print("ready", flush=True)
while True:
    data = random.choice(made)
    if random.random() < 0.5:
        write_atomically(sys.argv[1], data)
    else:
        with replacing(sys.argv[1]) as path:
            with open(path, "wb") as stream:
                for start in range(0, len(data), 10**5):
                    stream.write(data[start : start + 10**5])
"""


def left_over(folder: Path) -> list[str]:
    return [name for name in os.listdir(folder) if name.startswith(".pc2cad-")]


def killed_while_writing(process: subprocess.Popen[bytes], folder: Path) -> None:
    """Stops the process again and again until what it has begun lies there, and kills it then."""
    for _ in range(2000):
        os.kill(process.pid, signal.SIGSTOP)
        os.waitid(os.P_PID, process.pid, os.WSTOPPED)
        if left_over(folder):
            return process.kill()
        os.kill(process.pid, signal.SIGCONT)
        time.sleep(0.002)
    pytest.fail("the writer was never seen while it wrote")


@pytest.mark.parametrize("kills", [4, pytest.param(60, marks=pytest.mark.slow)])
def test_nothing_is_torn_or_left_after_kills(kills: int, tmp_path: Path) -> None:
    target, chance, left = tmp_path / "a.bin", random.Random(kills), 0
    for number in range(kills):
        process = subprocess.Popen(
            [sys.executable, "-c", WRITER, str(target)], stdout=subprocess.PIPE
        )
        assert process.stdout is not None
        assert process.stdout.readline() == b"ready\n"
        time.sleep(chance.uniform(0.0, 0.2))
        if number % 2:  # at any moment, or surely in the midst of one file
            killed_while_writing(process, tmp_path)
        else:
            process.kill()
        process.wait()
        process.stdout.close()
        if target.exists():
            data = target.read_bytes()
            assert data[:64].decode() == hashlib.sha256(data[64:]).hexdigest()
        left += len(left_over(tmp_path))
        assert len(left_over(tmp_path)) <= 1, "the next writer has swept what the last one left"
    write_atomically(tmp_path / "other", b"")
    assert left_over(tmp_path) == []
    assert left >= kills // 2, "every second kill strikes while a file is written"


def test_what_others_write_is_not_swept(tmp_path: Path) -> None:
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    gone = f".pc2cad-{dead.pid}-{'0' * 16}.tmp"
    foreign = [".pc2cad-notes.tmp", f".pc2cad-{dead.pid}.tmp", f"{gone}~", ".pc2cad-x-0.tmp",
               f".pc2cad-{os.getpid()}-{'0' * 16}.tmp"]  # fmt: skip
    for name in foreign:
        (tmp_path / name).write_bytes(b"mine")
    (tmp_path / f".pc2cad-{dead.pid}-{'1' * 16}.tmp").mkdir()
    (tmp_path / f".pc2cad-{dead.pid}-{'2' * 16}.tmp").symlink_to("other")
    os.mkfifo(tmp_path / f".pc2cad-{dead.pid}-{'3' * 16}.tmp")
    kept = set(os.listdir(tmp_path))
    (tmp_path / gone).write_bytes(b"ours")
    start = start_of(os.getpid())
    if start:  # of a process that had the number of this one
        (tmp_path / f".pc2cad-{os.getpid()}-{int(start) - 1}-{'4' * 16}.tmp").write_bytes(b"")
    sweep(tmp_path)
    assert set(os.listdir(tmp_path)) == kept


def test_a_file_that_is_locked_is_being_written(tmp_path: Path) -> None:
    fcntl = pytest.importorskip("fcntl")
    path = tmp_path / f".pc2cad-{2**30}-{'0' * 16}.tmp"  # as of another machine
    with open(path, "wb") as stream:
        fcntl.flock(stream, fcntl.LOCK_EX)
        write_atomically(tmp_path / "a", b"")
        assert path.exists()
    check_target(tmp_path / "a")
    write_atomically(tmp_path / "a", b"")
    assert not path.exists()


def test_a_file_being_written_is_not_swept(tmp_path: Path) -> None:
    with replacing(tmp_path / "a") as temporary:
        write_atomically(tmp_path / "b", b"b")
        code = "import sys; from pathlib import Path; from pc2cad.export.files import sweep; "
        subprocess.run([sys.executable, "-c", f"{code}sweep(Path(sys.argv[1]))", str(tmp_path)],
                       check=True)  # fmt: skip
        temporary.write_bytes(b"a")
    assert contents(tmp_path) == {"a": b"a", "b": b"b"}
