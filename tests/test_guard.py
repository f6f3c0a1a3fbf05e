"""Commands whose work crashes, hangs or grows: one sentence, an exit code, nothing left behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")

#: the work of `pc2cad build pyramid -o FOLDER/p.step ...` replaced by a line that goes wrong
SCRIPT = """
import os, resource, signal, sys, time
resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
from pc2cad.cli import build, main
def run(arguments):
    {work}
    return 0
build.run = run
sys.exit(main.main())
"""
#: a file as `pc2cad.export.files` makes it beside its target
HALF = "open(sys.argv[4].replace('p.step', f'.pc2cad-{os.getpid()}-half.tmp'), 'w').close()"


def command(folder: Path, work: str, *options: str) -> list[str]:
    target = str(folder / "p.step")
    return [sys.executable, "-c", SCRIPT.format(work=work), "build", "pyramid", "-o", target,
            *options]  # fmt: skip


def guarded(folder: Path, work: str, *options: str) -> tuple[int, str, float]:
    """Return the exit code, what stderr says and the seconds that it took."""
    begun = time.monotonic()
    done = subprocess.run(
        command(folder, work, *options), capture_output=True, text=True, timeout=60, check=False
    )
    return done.returncode, done.stderr, time.monotonic() - begun


@pytest.mark.parametrize(
    ("work", "options", "words"),
    [
        ("os.kill(os.getpid(), signal.SIGSEGV)", [], ["SIGSEGV", "kernel"]),
        ("os.abort()", [], ["SIGABRT", "kernel"]),
        ("os.kill(os.getpid(), signal.SIGKILL)", [], ["SIGKILL", "lack of memory"]),
        ("time.sleep(60)", ["--time-limit", "0.3"], ["time limit of 0.3 s", "--time-limit"]),
        ("import ctypes; ctypes.PyDLL(None).sleep(60)", ["--time-limit", "0.3"], ["time limit"]),
        (
            "hog = [bytearray(os.urandom(1)) * 2**28]; time.sleep(60)",
            ["--memory-limit", "0.2"],
            ["memory limit of 0.2 GiB", "--memory-limit"],
        ),
    ],
    ids=["crash", "abort", "kill", "wait", "hang in C", "memory"],
)
def test_what_goes_wrong_below_is_one_sentence(
    tmp_path: Path, work: str, options: list[str], words: list[str]
) -> None:
    code, said, seconds = guarded(tmp_path, f"{HALF}; {work}", *options)
    assert code == 5
    assert said.startswith("pc2cad: pyramid: ")
    assert said.count("\n") == 1
    assert all(word in said for word in words), said
    assert os.listdir(tmp_path) == [], "nothing is left half written"
    assert seconds < 30, "it did not wait for the work"


@pytest.mark.parametrize("code", [0, 3])
def test_the_exit_code_is_that_of_the_work(tmp_path: Path, code: int) -> None:
    assert guarded(tmp_path, f"return {code}")[:2] == (code, "")


def test_a_signal_ends_the_work_and_looks_like_a_signal(tmp_path: Path) -> None:
    mark = tmp_path / "child"
    work = f"open({str(mark)!r}, 'w').write(str(os.getpid())); time.sleep(60)"
    process = subprocess.Popen(command(tmp_path, work), stderr=subprocess.PIPE)
    while not (mark.exists() and mark.read_text()):
        assert process.poll() is None, "it ended before its work began"
        time.sleep(0.01)
    process.send_signal(signal.SIGTERM)
    assert process.communicate(timeout=30)[1] == b""
    assert process.returncode == -signal.SIGTERM
    with pytest.raises(ProcessLookupError):
        os.kill(int(mark.read_text()), 0)


def test_limits_must_be_sensible(tmp_path: Path) -> None:
    code, said, _ = guarded(tmp_path, "return 0", "--time-limit", "-1")
    assert code == 2
    assert "--time-limit" in said
