"""Nothing is imported from the current folder: by no verb, worker or server."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import urllib.request
from pathlib import Path

import pytest
from plain_step import box

from pc2cad.cli.main import VERBS
from pc2cad.trust import isolation
from tests import hostile_folder as hostile

#: one call of each verb, and whether it loads the kernel
CALLS = {
    "build": (["pyramid", "-o", "p.step"], True),
    "check": (["pyramid"], True),
    "sensitivities": (["cone"], True),
    "adjust": (["ball", "--vary", "R=1:5", "--until", "volume=200"], True),
    "study": (["pyramid_cut", "--vary", "p=.5", "-o", "s", "--workers", "1"], True),
    "mesh": (["pyramid", "-o", "m.vtu", "--cells", "2x2x2"], True),
    "render": (["pyramid", "-o", "r.png"], True),
    "view": (["pyramid", "-o", "v.html"], True),
    "points": (["pyramid", "-o", "p.ply", "--count", "5"], True),
    "spline": (["pyramid", "-o", "s.g2"], True),
    "show": (["pyramid"], False),
    "templates": ([], False),
    "new": (["x.toml"], False),
    "completion": (["bash"], False),
    "verify": (["box.step"], False),
}
MARKS = [pytest.param(verb, marks=[pytest.mark.slow] * CALLS.get(verb, ([], False))[1])
         for verb in VERBS]  # fmt: skip


def call(folder: Path, *arguments: str, safe: bool = False) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, *["-P"] * safe, "-m", "pc2cad", *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300)


@pytest.mark.parametrize("verb", MARKS)
def test_no_verb_imports_from_the_current_folder(verb: str, tmp_path: Path) -> None:
    assert verb in CALLS, f"say in CALLS how '{verb}' is called"
    marks = hostile.fill(tmp_path / "here", hostile.read_by_python())
    (tmp_path / "here" / "box.step").write_text(box())
    done = call(tmp_path / "here", verb, *CALLS[verb][0])
    assert hostile.marked(marks) == []
    assert (done.returncode, done.stderr) == (0, "")


def test_an_empty_entry_of_pythonpath_is_forgotten_as_well(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", os.pathsep)
    marks = hostile.fill(tmp_path / "here", hostile.read_by_python() | hostile.STARTUP)
    done = call(tmp_path / "here", "templates", safe=True)
    assert (done.returncode, hostile.marked(marks)) == (0, [])


def test_with_p_not_even_python_itself_does(tmp_path: Path) -> None:
    marks = hostile.fill(tmp_path / "here")
    done = call(tmp_path / "here", "templates", safe=True)
    assert (done.returncode, hostile.marked(marks)) == (0, [])
    assert len(hostile.read_by_python()) < 60 < len(hostile.names())


def test_the_files_do_leave_marks(tmp_path: Path) -> None:
    marks = hostile.fill(tmp_path)
    subprocess.run([sys.executable, "-c", "import json"], cwd=tmp_path, capture_output=True)
    assert hostile.marked(marks) == ["json"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "files"),
    [
        (["mesh", "pyramid", "-o", "../t.msh", "--tetrahedra"], [".petscrc", "petscrc"]),
        (["build", "pyramid", "-o", "../p.step"], ["XSTEP.us", "SHAPE.us"]),
    ],
    ids=["PETSc in gmsh", "messages of the kernel"],
)
def test_libraries_read_nothing_there_either(
    arguments: list[str], files: list[str], tmp_path: Path
) -> None:
    """What they open has no writer, so that they would wait for ever."""
    (tmp_path / "here").mkdir()
    for name in files:
        os.mkfifo(tmp_path / "here" / name)
    done = call(tmp_path / "here", *arguments, "--time-limit", "60")
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.slow
def test_a_study_is_resumed_in_its_own_folder(tmp_path: Path) -> None:
    folder = tmp_path / "s"
    vary = ["--vary", "p=.3,.5", "--workers", "1", "--quiet"]
    assert call(tmp_path, "study", "pyramid_cut", *vary, "-o", "s").returncode == 0
    marks = hostile.fill(folder, hostile.read_by_python())
    for path in (folder / "files").iterdir():
        path.unlink()
    done = call(folder, "study", "pyramid_cut", *vary, "-o", ".", "--resume")
    assert (done.returncode, done.stderr, hostile.marked(marks)) == (0, "", [])
    assert len(list((folder / "files").iterdir())) == 2


@pytest.mark.slow
def test_the_server_and_its_worker_import_nothing_from_there(tmp_path: Path) -> None:
    marks = hostile.fill(tmp_path / "here", hostile.read_by_python())
    command = [sys.executable, "-m", "pc2cad", "view", "pyramid_cut", "--serve"]
    process = subprocess.Popen(
        command, cwd=tmp_path / "here", stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout is not None
        address = process.stdout.readline().split()[0]
        with urllib.request.urlopen(f"{address}part?p=0.3", timeout=60) as answer:
            assert len(answer.read()) > 100
    finally:
        process.terminate()
        assert process.communicate(timeout=30)[1] == ""
    assert hostile.marked(marks) == []


@pytest.mark.parametrize("given", ["", ":", ".", "lib", "{kept}:", ":{kept}", ".:{kept}:lib"])
def test_a_fresh_python_keeps_of_pythonpath_what_names_a_place(
    given: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    marks = hostile.fill(tmp_path / "here")
    (tmp_path / "here" / "lib").mkdir()
    (tmp_path / "here" / "lib" / "sitecustomize.py").write_text(f"open({str(marks)!r}, 'w')")
    monkeypatch.chdir(tmp_path / "here")
    kept = str(tmp_path / "kept")
    monkeypatch.setenv("PYTHONPATH", given.format(kept=kept).replace(":", os.pathsep))
    monkeypatch.setenv("PYTHONUSERBASE", "")
    monkeypatch.setenv("PYTHONSTARTUP", str(tmp_path / "here" / "json.py"))
    script = "import json, sys; print(json.dumps(sys.path))"
    done = subprocess.run(
        [*isolation.interpreter(), "-c", script], env=isolation.environment(),
        capture_output=True, text=True,
    )  # fmt: skip
    assert (done.stderr, marks.exists()) == ("", False)
    path = json.loads(done.stdout)
    assert (kept in path) == ("kept" in given)
    assert not [folder for folder in path if folder.startswith(str(tmp_path / "here"))]


@pytest.mark.parametrize("entry", ["''", "os.getcwd()", "'lib'", "'.'"])
def test_a_worker_has_its_parents_path_and_its_pc2cad(entry: str, tmp_path: Path) -> None:
    """The parent is any program, whose own path is its own business."""
    marks = hostile.fill(tmp_path / "here", {"pc2cad"})
    package = tmp_path / "elsewhere" / "pc2cad"
    package.mkdir(parents=True)
    (package / "__init__.py").touch()
    (package / "isolation.py").write_text(Path(isolation.__file__).read_text())
    (package / "work.py").write_text(
        "def main():\n    import json, sys\n    print(json.dumps([__file__, sys.path]))\n"
    )
    program = (
        "import os, subprocess, sys\n"
        "sys.path.insert(0, sys.argv[1]); from pc2cad import isolation; del sys.path[0]\n"
        f"sys.path[:0] = [{entry}, sys.argv[2]]\n"
        "command = [*isolation.interpreter(), *isolation.running('pc2cad.work')]\n"
        "subprocess.run(command, env=isolation.environment(), check=True)\n"
    )
    done = subprocess.run(
        [sys.executable, "-P", "-c", program, str(package.parent), str(tmp_path / "more")],
        cwd=tmp_path / "here", capture_output=True, text=True,
    )  # fmt: skip
    assert (done.stderr, hostile.marked(marks)) == ("", [])
    file, path = json.loads(done.stdout)
    assert Path(file) == package / "work.py"
    assert str(tmp_path / "more") in path
    assert not [p for p in path if not os.path.isabs(p) or p.startswith(str(tmp_path / "here"))]


@pytest.mark.parametrize(
    ("arguments", "whole", "answer"),
    [
        (["-m"], ["python", "-m", "pc2cad"], True),
        (["-m", "check", "x"], ["python", "-Wi", "-mpc2cad.cli.main", "check", "x"], True),
        (["-m", "-m", "pc2cad"], ["python", "-m", "mine", "-m", "pc2cad"], False),
        (["-m"], ["python", "-m", "pc2cadder"], False),
        (["/usr/bin/pc2cad", "check"], ["python", "/usr/bin/pc2cad", "check"], True),
        (["mine.py"], ["python", "mine.py"], False),
        (["-c"], ["python", "-c", "..."], False),
        ([""], ["python"], False),
    ],
)
def test_only_the_command_forgets_the_current_folder(
    arguments: list[str], whole: list[str], answer: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", arguments)
    monkeypatch.setattr(sys, "orig_argv", whole)
    assert isolation.is_command() is answer
