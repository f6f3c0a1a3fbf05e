"""The command as a user has it: a process with arguments, two streams and an exit code."""

from __future__ import annotations

import json
import os
import pty
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest

from pc2cad.cli.main import VERBS, main
from pc2cad.templates import shipped

COMMAND = [sys.executable, "-m", "pc2cad.cli.main"]
#: modules of ours that a verb may load which needs no array, of more than 400
MOST_MODULES = 90
HEAVY = ("OCP", "cadquery", "sympy", "numpy", "scipy")


def run(*arguments: str, cwd: Path, **options) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*COMMAND, *arguments], cwd=cwd, capture_output=True, text=True, timeout=120, **options
    )


def only_sentence(stderr: str) -> str:
    """Return the one sentence that stderr consists of."""
    assert stderr.startswith("pc2cad: ")
    assert stderr.endswith("\n")
    assert stderr.count("\n") == 1
    assert "Traceback" not in stderr
    return stderr


def test_build_writes_files_and_nothing_but_results_on_stdout(tmp_path):
    done = run(
        "build", "pyramid", "-o", "p.step", "-o", "p.stl", "--report", "p.json", cwd=tmp_path
    )
    assert (done.returncode, done.stderr) == (0, "")
    triangles = "; written as 4 triangles, deflection 0.0104 mm, volume 31.5 mm^3 (+0 %)"
    assert done.stdout.splitlines() == [
        f"{name}: volume 31.5 mm^3, area 72.49105919 mm^2, 4 faces, exact{loss}"
        for name, loss in (("p.step", ""), ("p.stl", triangles))
    ]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["p.json", "p.step", "p.stl"]
    report = json.loads((tmp_path / "p.json").read_text())
    assert report["evidence"] == "exact"
    assert report["equation"]["volume"] == pytest.approx(31.5, rel=1e-12)


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (("build", "pyramd", "-o", "a.step"), 2),
        (("build", "pyramid_cut", "-s", "p=1", "-s", "q=1", "-s", "r=1", "-o", "a.step"), 3),
        (("build", "channel_ellipse", "--tolerance", "1e-14", "-o", "a.step"), 4),
        (("build", "pyramid", "-o", "missing/a.step"), 5),
    ],
)
def test_exit_codes_of_the_process(arguments, code, tmp_path):
    done = run(*arguments, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (code, "")
    only_sentence(done.stderr)
    assert list(tmp_path.iterdir()) == []


def test_a_new_file_builds(tmp_path):
    assert run("new", "own.toml", cwd=tmp_path).returncode == 0
    done = run("build", "own.toml", "-s", "wall=4", "-o", "own.step", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "own.step").stat().st_size > 1000
    again = run("new", "own.toml", cwd=tmp_path)
    assert again.returncode == 2
    assert "exists already" in only_sentence(again.stderr)


LIGHT = [
    (("--help",), 0),
    (("--version",), 0),
    (("build", "--help"), 0),
    (("templates",), 0),
    (("new", "n.toml"), 0),
    (("show", "channel_contour"), 0),
    (("show", "channel_contour", "--latex"), 0),
    ((), 2),
    (("build", "pyramid"), 2),
    (("build", "pyramd", "-o", "a.step"), 2),
    (("build", "pyramid_cut", "-s", "p=2", "-o", "a.step"), 2),
    (("build", "pyramid", "-o", "a.xyz"), 2),
    (("build", "pyramid", "-o", "missing/a.step"), 5),
    (("check", "bad.toml"), 2),
]


@pytest.mark.parametrize(("arguments", "code"), LIGHT)
def test_light_verbs_and_bad_input_load_nothing_heavy(arguments, code, tmp_path):
    (tmp_path / "bad.toml").write_text('title = "x"\n[solid]\nM = "A*u"\n')
    program = (
        "import sys; from pc2cad.cli.main import main; code = main(sys.argv[1:]); "
        f"loaded = [m for m in {HEAVY} if m in sys.modules]; "
        "ours = [m for m in sys.modules if m.split('.')[0] == 'pc2cad']; "
        f"loaded += ours if len(ours) > {MOST_MODULES} else []; "
        "sys.exit(f'loaded {loaded}' if loaded else code)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, *arguments], cwd=tmp_path, capture_output=True, text=True
    )
    assert "loaded" not in done.stderr
    assert done.returncode == code


@pytest.mark.slow
def test_works_without_stdin_and_with_an_ascii_locale(tmp_path):
    (tmp_path / "t.toml").write_text(
        'title = "Größe ∫"\n[solid]\nx = "u"\ny = "v"\nz = "w"\n', encoding="utf-8"
    )
    ascii_only = os.environ | {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0",
                               "PYTHONIOENCODING": "ascii:strict"}  # fmt: skip
    for arguments in (("show", "t.toml"), ("check", "t.toml")):
        command = [*COMMAND, *arguments]
        done = subprocess.run(
            ["sh", "-c", 'exec "$@" <&-', "sh", *command], cwd=tmp_path, env=ascii_only,
            capture_output=True,
        )  # fmt: skip
        assert (done.returncode, done.stderr) == (0, b"")
        assert done.stdout.startswith(b"t: Gr??e ?\n")


@pytest.mark.parametrize(
    ("redirection", "code"), [(">&-", 0), ("2>&-", 0), ("> /dev/full", 5), ("| true", 0)]
)
def test_streams_that_are_closed_full_or_not_read(redirection, code, tmp_path):
    done = subprocess.run(
        ["sh", "-c", f'"$@" {redirection}', "sh", *COMMAND, "show", "channel_sine"],
        cwd=tmp_path, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == code
    if code:
        assert "No space left" in only_sentence(done.stderr)
    else:
        assert done.stderr == ""


def test_a_broken_pipe_ends_quietly(tmp_path):
    reading, writing = os.pipe()
    os.close(reading)
    done = subprocess.run(
        [*COMMAND, "templates"], stdout=writing, stderr=subprocess.PIPE, cwd=tmp_path
    )
    os.close(writing)
    assert (done.returncode, done.stderr) == (141, b"")


#: main() as the console script calls it. Before its first line runs, nobody can catch an
#: interruption; a shell's background jobs, as this test may be one of, ignore it
STARTED = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
from pc2cad.cli.main import main
print('started', flush=True)
{first}
sys.exit(main())
"""
#: the slowest build of the shipped ones, so that it is still going on
SLOW = ("build", "channel_sine", "--tolerance", "1e-11", "-o", "c.step")


def interrupted(folder: Path, delay: float, group: bool, first: str = "") -> tuple[int, str, float]:
    """Interrupt a build; return its exit code, its sentence and how long it took to end."""
    child = subprocess.Popen(
        [sys.executable, "-c", STARTED.format(first=first), *SLOW], start_new_session=True,
        cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert child.stdout is not None
    assert child.stdout.readline() == "started\n"
    time.sleep(delay)
    begun = time.monotonic()
    (os.killpg if group else os.kill)(child.pid, signal.SIGINT)
    _, stderr = child.communicate(timeout=60)
    assert list(folder.iterdir()) == []
    return child.returncode, only_sentence(stderr), time.monotonic() - begun


# Ctrl-C reaches every process of a terminal, `kill -INT` the one that was started
@pytest.mark.parametrize("group", [True, False], ids=["Ctrl-C", "kill"])
@pytest.mark.parametrize("delay", [0.05, 0.8])
def test_an_interruption_is_one_sentence(delay, group, tmp_path):
    code, sentence, _ = interrupted(tmp_path, delay, group)
    assert code == 130
    assert "interrupted" in sentence


@pytest.mark.parametrize(
    "first",
    [
        # an interruption that the code in between forgets, as extension modules do
        """
from pc2cad.cli import build
def forgetful(*_, **__):
    try:
        while True:
            pass
    except BaseException:
        pass
    while True:
        pass
build.run = forgetful
""",
        # C code that does not let go of the interpreter
        """
from pc2cad.cli import build
def deaf(*_, **__):
    import ctypes
    ctypes.PyDLL(None).sleep(60)
build.run = deaf
""",
    ],
    ids=["forgotten", "in C"],
)
def test_an_interruption_is_not_lost(first, tmp_path):
    code, sentence, seconds = interrupted(tmp_path, 1.5, True, first)
    assert code == 130
    assert "interrupted" in sentence
    assert seconds < 20.0


def on_a_terminal(lines: str, folder: Path) -> str:
    """Run lines on a `Progress` called p, whose patience is short; return what it showed."""
    ours, theirs = pty.openpty()
    done = subprocess.run(
        [sys.executable, "-c", "import pc2cad.cli.output as o, sys, time; o.PATIENCE = 0.05\n"
         f"with o.Progress() as p:\n {lines}\nprint('rich' in sys.modules)"],
        cwd=folder, stderr=theirs, stdout=subprocess.PIPE, env=os.environ | {"TERM": "xterm"},
    )  # fmt: skip
    os.close(theirs)
    shown = b""
    with suppress(OSError):  # the end, to some systems
        while part := os.read(ours, 65536):
            shown += part
    os.close(ours)
    return shown.decode() + done.stdout.decode()


def test_a_bar_for_what_takes_long(tmp_path):
    shown = on_a_terminal(
        "p('analyse'); time.sleep(0.6); p('represent'); time.sleep(0.3)", tmp_path
    )
    assert "analyse" in shown
    assert "represent" in shown
    # the line is cleared at the end, and the cursor was never hidden
    assert shown.endswith("\x1b[2KTrue\n")
    assert "\x1b[?25l" not in shown
    shown = on_a_terminal("time.sleep(0.1); p.update('2 of 3 variants', 2, 3)", tmp_path)
    assert "2 of 3 variants" in shown


def test_what_cannot_draw_a_bar_says_so_in_a_line_that_goes_away(tmp_path):
    shown = on_a_terminal("p.first('loading the kernel'); p('analyse')", tmp_path)
    assert shown == "loading the kernel …\r\x1b[2KFalse\n"
    assert on_a_terminal("p.first('loading the kernel')", tmp_path) == shown


def test_no_bar_for_what_is_quick_or_piped(tmp_path):
    assert on_a_terminal("p('quick')", tmp_path) == "False\n"
    done = subprocess.run(
        [sys.executable, "-c", "import pc2cad.cli.output as o, time; o.PATIENCE = 0.05\n"
         "with o.Progress() as p:\n p('analyse'); time.sleep(0.3)"],
        cwd=tmp_path, capture_output=True,
    )  # fmt: skip
    assert (done.stdout, done.stderr) == (b"", b"")


def test_an_unexpected_error_is_one_sentence_too(capsys, monkeypatch):
    def fail(*_: object) -> None:
        raise ZeroDivisionError("float division\nby zero")

    monkeypatch.setattr("pc2cad.templates.shipped.template_paths", fail)
    assert main(["templates"]) == 5
    sentence = only_sentence(capsys.readouterr().err)
    assert "ZeroDivisionError" in sentence
    assert "please report" in sentence
    monkeypatch.setenv("PC2CAD_DEBUG", "1")
    assert main(["templates"]) == 5
    assert "Traceback" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("error", "code", "word"),
    [
        (MemoryError(), 5, "memory"),
        (RecursionError(), 2, "nested"),
        (KeyboardInterrupt(), 130, "int"),
    ],
)
def test_errors_of_the_interpreter_are_sentences(error, code, word, capsys, monkeypatch):
    def fail() -> None:
        raise error

    monkeypatch.setattr("pc2cad.templates.shipped.template_paths", fail)
    assert main(["templates"]) == code
    assert word in only_sentence(capsys.readouterr().err)


def test_version_names_what_it_stands_on(capsys):
    assert main(["--version"]) == 0
    out = capsys.readouterr().out
    assert out.startswith("pc2cad 0.")
    assert "cadquery-ocp 7.9" in out


def test_templates_lists_names_titles_and_parameters(capsys):
    assert main(["templates"]) == 0
    out = capsys.readouterr().out
    assert "pyramid: Triangular pyramid\n" in out
    assert "    p = 0.5  (0 to 1)  |DP| / |DA|\n" in out


def test_check_is_a_table_and_writes_nothing(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["check", "channel_ellipse", "-s", "s=0"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    for piece in (
        "\n  valid solid, deviation ", " (bounded), 4 faces\n", "\nBounding box (mm)\n",
        "\nWall (mm; shortest distances, sampled)\n",
        "v=0  interface  proved  glued to v=1", "B-spline surface  bounded", "plane",
        "1 shell of genus 1; Euler number 0", "relative difference", "centroid z",
        "[expect]          met: faces, edges, vertices, shells, euler", "Times", "s = 0",
    ):  # fmt: skip
        assert piece in out
    assert out.isascii()
    assert list(tmp_path.iterdir()) == []


def test_check_prints_json(capsys):
    assert main(["check", "pyramid_cut", "-s", "p=1/4", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["parameters"] == {"p": 0.25, "q": 0.25, "r": 0.75}
    assert {side["fate"] for side in report["sides"]} == {"face", "curve"}
    assert report["shells"] == 1


def test_options_reach_the_files(tmp_path, capsys):
    step, stl = tmp_path / "a.step", tmp_path / "a.stl"
    options = ["--schema", "AP214", "--colours", "--degree", "7", "--tolerance", "1/1000",
               "--deflection", "0.5", "--quiet"]  # fmt: skip
    assert main(["build", "channel_ellipse", "-o", str(step), "-o", str(stl), *options]) == 0
    assert capsys.readouterr() == ("", "")
    text = step.read_text()
    assert "AUTOMOTIVE_DESIGN" in text
    assert "COLOUR_RGB" in text
    coarse = stl.stat().st_size
    assert main(["build", "channel_ellipse", "-o", str(stl), "--deflection", "0.01"]) == 0
    assert stl.stat().st_size > 2 * coarse


def test_an_installed_package_holds_its_templates_itself(tmp_path):
    shutil.copytree(Path(shipped.__file__).parent.parent, tmp_path / "pc2cad")
    shutil.copytree(
        shipped.template_folder(), tmp_path / "pc2cad" / "templates" / "library", dirs_exist_ok=True
    )
    done = run("show", "pyramid", cwd=tmp_path, env=os.environ | {"PYTHONPATH": str(tmp_path)})
    assert done.returncode == 0
    program = (
        "from pc2cad.templates.shipped import template_paths; print(template_paths()['pyramid'])"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.stdout.strip() == str(
        tmp_path / "pc2cad" / "templates" / "library" / "pyramid.toml"
    )


@pytest.mark.parametrize(
    ("words", "offered"),
    [
        ("pc2cad re", {"render"}),
        ("pc2cad build chan", {"channel_contour", "channel_ellipse", "channel_sine"}),
        ("pc2cad build pipe", {"pipe_cross"}),
        ("pc2cad build pyramid --col", {"--colors", "--colours"}),
        ("pc2cad mesh ball --tetra", {"--tetrahedra"}),
        ("pc2cad render ball --view fr", {"front"}),
        ("pc2cad build pyramid_cut -o a.step -s q", {"q="}),
    ],
)
def test_the_shell_completes(words, offered, capsys, tmp_path):
    assert main(["completion", "bash"]) == 0
    array = " ".join(words.split())
    script = (
        f"{capsys.readouterr().out}\nCOMP_WORDS=({array})\n"
        f"COMP_CWORD={len(words.split()) - 1}\n_pc2cad\nprintf '%s\\n' \"${{COMPREPLY[@]}}\""
    )
    done = subprocess.run(
        ["bash", "-c", script], capture_output=True, text=True, check=True, cwd=tmp_path
    )
    assert set(done.stdout.split()) == offered


def test_fish_completes_every_verb(capsys):
    assert main(["completion", "fish"]) == 0
    lines = capsys.readouterr().out.splitlines()
    for verb in VERBS:
        assert any(f"-a {verb} -d " in line for line in lines)
