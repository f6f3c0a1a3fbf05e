"""A file is written whole or not at all, and every reason not to is one clear sentence."""

from __future__ import annotations

import errno
import os
import re
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from pc2cad.errors import FileNotWrittenError, InputError
from pc2cad.export import files, registry
from pc2cad.export.files import check_target, write_atomically
from pc2cad.export.model import ExportOptions

BOTH = pytest.mark.parametrize(
    "attempt", [check_target, lambda path: write_atomically(path, b"new")], ids=["check", "write"]
)


def left_over(folder: Path) -> list[str]:
    return [entry.name for entry in folder.iterdir() if entry.name.startswith(".pc2cad-")]


def refusal(attempt, path) -> str:
    with pytest.raises(FileNotWrittenError) as caught:
        attempt(path)
    sentence = str(caught.value)
    assert sentence.startswith("cannot write")
    assert not sentence.endswith(".")
    assert "\n" not in sentence
    assert len(sentence) < 400
    return sentence


def test_a_new_file_has_the_bytes_and_the_usual_permissions(tmp_path):
    before = os.umask(0o027)
    try:
        write_atomically(tmp_path / "a.step", b"data")
    finally:
        os.umask(before)
    assert (tmp_path / "a.step").read_bytes() == b"data"
    assert stat.S_IMODE((tmp_path / "a.step").stat().st_mode) == 0o640
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.step"]


@pytest.mark.parametrize("mode", [0o600, 0o666, 0o751])
def test_a_replaced_file_keeps_its_permissions(tmp_path, mode):
    path = tmp_path / "a.step"
    path.write_bytes(b"old")
    path.chmod(mode)
    write_atomically(path, b"new")
    assert path.read_bytes() == b"new"
    assert stat.S_IMODE(path.stat().st_mode) == mode


def test_a_symbolic_link_survives_and_its_target_is_replaced(tmp_path):
    (tmp_path / "store").mkdir()
    (tmp_path / "store" / "real.step").write_bytes(b"old")
    link = tmp_path / "link.step"
    link.symlink_to("store/real.step")
    write_atomically(link, b"new")
    assert link.is_symlink()
    assert (tmp_path / "store" / "real.step").read_bytes() == b"new"


def test_a_dangling_link_gets_its_target(tmp_path):
    link = tmp_path / "link.step"
    link.symlink_to("real.step")
    write_atomically(link, b"new")
    assert link.is_symlink()
    assert (tmp_path / "real.step").read_bytes() == b"new"


def test_checking_leaves_no_trace(tmp_path):
    (tmp_path / "old.step").write_bytes(b"old")
    check_target(tmp_path / "old.step")
    check_target(tmp_path / "new.step")
    assert [entry.name for entry in tmp_path.iterdir()] == ["old.step"]
    assert (tmp_path / "old.step").read_bytes() == b"old"


@BOTH
def test_a_missing_folder(attempt, tmp_path):
    path = tmp_path / "missing" / "a.step"
    assert "its folder does not exist; create the folder" in refusal(attempt, path)
    assert str(path) in refusal(attempt, path)


@BOTH
def test_a_file_in_place_of_the_folder(attempt, tmp_path):
    (tmp_path / "file").write_bytes(b"")
    assert "choose another folder" in refusal(attempt, tmp_path / "file" / "a.step")


@BOTH
def test_a_folder_of_that_name(attempt, tmp_path):
    (tmp_path / "a.step").mkdir()
    assert "a folder has that name" in refusal(attempt, tmp_path / "a.step")


@BOTH
def test_a_pipe_or_device(attempt, tmp_path):
    os.mkfifo(tmp_path / "a.step")
    assert "not a file" in refusal(attempt, tmp_path / "a.step")
    assert "not a file" in refusal(attempt, "/dev/null")
    assert stat.S_ISFIFO((tmp_path / "a.step").stat().st_mode)


@BOTH
def test_a_loop_of_links(attempt, tmp_path):
    (tmp_path / "a.step").symlink_to("b.step")
    (tmp_path / "b.step").symlink_to("a.step")
    assert "form a loop" in refusal(attempt, tmp_path / "a.step")


@BOTH
@pytest.mark.parametrize(
    ("name", "part"),
    [
        ("", "its name is empty"),
        ("a\0b.step", "NUL"),
        ("x" * 300 + ".step", "name is too long"),
        ("x/" * 3000 + "a.step", "name is too long"),
        ("half a pair \ud8ff.step", "cannot store"),
    ],
    ids=["empty", "nul", "long name", "long path", "surrogate"],
)
def test_names_that_cannot_be(attempt, name, part, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert part in refusal(attempt, name)
    assert list(tmp_path.iterdir()) == []


@BOTH
def test_a_write_protected_file(attempt, tmp_path, monkeypatch):
    path = tmp_path / "a.step"
    path.write_bytes(b"old")
    # the superuser may write everywhere, so the answer of the system is played
    monkeypatch.setattr(os, "access", lambda target, mode: False)
    assert "write-protected" in refusal(attempt, path)
    assert path.read_bytes() == b"old"


@BOTH
@pytest.mark.parametrize(
    ("number", "part"),
    [
        (errno.EACCES, "no permission"),
        (errno.EROFS, "read-only"),
        (errno.ENOSPC, "disk is full"),
        (errno.EMFILE, "too many files"),
        (errno.EIO, "Input/output error"),
    ],
)
def test_a_folder_that_takes_no_file(attempt, number, part, tmp_path, monkeypatch):
    def no_file(target, mode):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(files, "_create_beside", no_file)
    assert part in refusal(attempt, tmp_path / "a.step")


@pytest.mark.parametrize("step", ["fsync", "replace", "fchmod"])
@pytest.mark.parametrize(
    ("error", "raised"),
    [
        (OSError(errno.ENOSPC, "No space left on device"), FileNotWrittenError),
        (OSError(errno.EDQUOT, "Disk quota exceeded"), FileNotWrittenError),
        (KeyboardInterrupt(), KeyboardInterrupt),
        (MemoryError(), MemoryError),
    ],
    ids=["full", "quota", "ctrl-c", "memory"],
)
def test_the_old_file_survives_any_failure(step, error, raised, tmp_path, monkeypatch):
    path = tmp_path / "a.step"
    path.write_bytes(b"old")

    def fail(*arguments):
        raise error

    with monkeypatch.context() as patch:
        patch.setattr(os, step, fail)
        with pytest.raises(raised):
            write_atomically(path, b"new" * 1000)
    assert path.read_bytes() == b"old"
    assert left_over(tmp_path) == []


LIMITED = """
import resource, signal, sys
sys.dont_write_bytecode = True  # it would be cut off as well
from pc2cad.errors import FileNotWrittenError
from pc2cad.export.files import write_atomically
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (20000, 20000))
try:
    write_atomically(sys.argv[1], b"x" * 50000)
except FileNotWrittenError as error:
    print(error)
"""


def test_a_limit_that_strikes_in_the_middle_of_writing(tmp_path):
    path = tmp_path / "a.step"
    path.write_bytes(b"old")
    root = Path(__file__).parents[1]
    done = subprocess.run(
        [sys.executable, "-c", LIMITED, str(path)],
        cwd=root,
        capture_output=True,
        text=True,
        check=True,
    )
    assert "size limit" in done.stdout
    assert path.read_bytes() == b"old"
    assert left_over(tmp_path) == []


def test_odd_and_long_names_are_shown_on_one_short_line(tmp_path):
    sentence = refusal(check_target, tmp_path / "no" / ("a\nb" + "x" * 300 + ".step"))
    assert "…" in sentence


@pytest.mark.parametrize(
    ("name", "found"),
    [("a.step", "step"), ("b/c.STP", "step"), ("x.y.Stl", "stl"), (Path("a.step"), "step")],
)
def test_the_ending_tells_the_format(name, found):
    assert registry.format_for(name).name == found


@pytest.mark.parametrize("name", ["a.obj", "a", "step", ".step", "a.step.", "a.step "])
def test_an_unknown_ending_is_an_input_error_that_names_the_known_ones(name):
    with pytest.raises(InputError, match=re.escape(".step, .stp, .brep")):
        registry.format_for(name)


def test_check_writable_tells_input_errors_from_file_errors(tmp_path):
    registry.check_writable(tmp_path / "a.stl")
    with pytest.raises(InputError):
        registry.check_writable(tmp_path / "a.xyz")
    with pytest.raises(FileNotWrittenError):
        registry.check_writable(tmp_path / "no" / "a.stl")
    with pytest.raises(FileNotWrittenError, match="empty"):
        registry.check_writable("")


def test_every_format_says_what_it_is():
    endings = [ending for entry in registry.FORMATS for ending in entry.extensions]
    assert len(endings) == len(set(endings))
    for entry in registry.FORMATS:
        assert entry.specification.startswith("https://")
        assert entry.precision
        assert callable(entry.encoder())


def test_the_registry_does_not_load_the_kernel():
    code = (
        "import sys, pc2cad.export, pc2cad.export.registry\n"
        "pc2cad.export.registry.format_for('a.step')\n"
        "print([m for m in sys.modules if m.split('.')[0] in ('OCP', 'cadquery', 'numpy')])"
    )
    root = Path(__file__).parents[1]
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=root, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize(
    "options",
    [
        {"step_schema": "AP203"},
        {"deflection": 0.0},
        {"deflection": float("nan")},
        {"deflection": float("inf")},
        {"angular_deflection": 0.0},
        {"angular_deflection": float("nan")},
    ],
    ids=str,
)
def test_options_that_make_no_sense(options):
    with pytest.raises(InputError):
        ExportOptions(**options)


def test_time_stamps(monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "0")
    assert ExportOptions().time_stamp() == "1970-01-01T00:00:00Z"
    assert ExportOptions(timestamp="2026-01-31").time_stamp() == "2026-01-31"
    with pytest.raises(InputError, match="ISO 8601"):
        ExportOptions(timestamp="yesterday'").time_stamp()
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "9" * 30)
    with pytest.raises(InputError, match="SOURCE_DATE_EPOCH"):
        ExportOptions().time_stamp()
    monkeypatch.delenv("SOURCE_DATE_EPOCH")
    assert re.fullmatch(r"20\d\d-\d\d-\d\dT\d\d:\d\d:\d\dZ", ExportOptions().time_stamp())
