"""What is refused: in one sentence that names what is wrong, with its exit code, and no file."""

from __future__ import annotations

import os

import pytest

from pc2cad.cli.main import main

SIMPLEX = """\
title = "Simplex"
[parameters]
p = {{ default = 0.5, min = 0, max = 1 }}
[points]
A = [4, 0, 0]
B = [1, 5, 0]
C = [-2, -1, 0]
D = [1, 1, {height}]
{more}
[solid]
M = "{M}"
"""
PYRAMID = "A*u*v*(1-w) + B*(1-v)*(1-w) + C*(1-u)*v*(1-w) + D*w"
# the section at the shares p, q, r of the edges DA, DB, DC; at p = q = r = 1 nothing is left
FRUSTUM = "A*u*v + B*(1-v) + C*(1-u)*v"


def simplex(height: str = "6", more: str = "", M: str = PYRAMID) -> str:
    return SIMPLEX.format(height=height, more=more, M=M)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def refused(arguments: list[str], code: int, capsys) -> str:
    """Run the command, which must fail; return its sentence."""
    files = sorted(os.listdir())
    assert main(arguments) == code
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("pc2cad: ")
    assert err.count("\n") == 1
    assert err.endswith("\n")
    assert sorted(os.listdir()) == files
    return err


BAD_TEMPLATES = {
    "coplanar": (simplex(height="0"), 3, ["t.toml", "plane"]),
    "nothing left": (
        simplex(
            more='[let]\nP = "D+(A-D)*p*2"\nQ = "D+(B-D)*p*2"\nR = "D+(C-D)*p*2"\n'
            f'N = "{FRUSTUM}"\nK = "P*u*v + Q*(1-v) + R*(1-u)*v"',
            M="N*(1-w) + K*w",
        ), 3, ["t.toml"],
    ),
    "domain of no length": (simplex(more="[domain]\nw = [0.5, 0.5]"), 2, ["t.toml", "domain of w"]),
    "domain backwards": (simplex(more="[domain]\nw = [1, 0]"), 2, ["t.toml", "from 1 to 0"]),
    "domain by parameter": (simplex(more='[domain]\nw = ["p", 0.5]'), 2, ["t.toml", "domain of w"]),
    "weights": (
        simplex(more=f'[let]\nM1 = "{PYRAMID}"\nM2 = "M1"', M="M1 + M2"), 2,
        ["t.toml", "[solid] M", "sum to 2"],
    ),
    "syntax": (simplex(M="A*u*(v - 1"), 2, ["t.toml", "[solid] M", "column 11", "')'"]),
    "unknown name": (simplex(M="A*u + Bb*(1-u)"), 2, ["t.toml", "column 7", "did you mean B"]),
    "unknown key": (simplex(more="[lets]"), 2, ["t.toml", "lets", "did you mean let or layers?"]),
    "unknown table": (simplex(more="[equation]"), 2, ["equation", "known here: title", "solid"]),
    "duplicate key": (simplex(more="E = 1\nE = 2"), 2, ["t.toml", "line 10"]),
    "folds": ('title = "f"\n[solid]\nx = "sin(3.6*u)"\ny = "v"\nz = "w"', 3, ["t.toml", "folds"]),
    "flat": (simplex(M="A + (B-A)*u"), 3, ["t.toml"]),
    "no TOML": ("a = 1,5", 2, ["t.toml", "line 1, column 6"]),
    "empty": ("", 2, ["t.toml", "title"]),
    "nested": ("a = " + "[" * 100_000, 2, ["t.toml", "nested"]),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD_TEMPLATES)
def test_bad_templates(case, folder, capsys):
    text, code, pieces = BAD_TEMPLATES[case]
    (folder / "t.toml").write_text(text)
    sentence = refused(["build", "t.toml", "-o", "a.step"], code, capsys)
    for piece in pieces:
        assert piece in sentence
    assert refused(["check", "t.toml"], code, capsys) == sentence


def test_a_template_must_be_a_text_file(folder, capsys):
    (folder / "t.toml").write_bytes(b'title = "\xff"')
    (folder / "folder.toml").mkdir()
    os.mkfifo(folder / "pipe.toml")
    (folder / "loop.toml").symlink_to("loop.toml")
    assert "UTF-8" in refused(["build", "t.toml", "-o", "a.step"], 2, capsys)
    for name in ("folder.toml", "pipe.toml", "/dev/zero"):
        sentence = refused(["build", name, "-o", "a.step"], 2, capsys)
        assert f"{name}: not a regular file" in sentence
    assert "loop.toml" in refused(["build", "loop.toml", "-o", "a.step"], 2, capsys)


@pytest.mark.parametrize(
    ("name", "piece"),
    [
        ("pyramd", "did you mean pyramid"),
        ("templates/pyramd.toml", "did you mean pyramid"),
        ("nothing like it", "'nothing like it'"),
        ("", "''"),
        ("a\0b", r"a\x00b"),
        ("a\nb", "'a b'"),
        ("x" * 5000, "xxx…'"),
    ],
)
def test_unknown_templates(name, piece, folder, capsys):
    sentence = refused(["build", name, "-o", "a.step"], 2, capsys)
    assert piece in sentence
    assert "pc2cad templates" in sentence


@pytest.mark.parametrize(
    ("settings", "pieces"),
    [
        (["p=2"], ["pyramid_cut", "p = 2", "from 0 to 1"]),
        (["p=-1"], ["p = -1"]),
        (["P=1"], ["no parameter 'P'", "did you mean p?"]),
        (["t=1"], ["no parameter 't'", "p, q, r"]),
        (["p"], ["NAME=VALUE"]),
        (["p="], ["NAME=VALUE"]),
        (["=1"], ["NAME=VALUE"]),
        (["p=0", "p=1"], ["p", "twice"]),
        (["p=1,5"], ["'1,5'", "column 2"]),
        (["p=u"], ["unknown name 'u'"]),
        (["p=[0,0,0]"], ["must be a number"]),
        (["p=1/0"], ["division by zero"]),
        (["p=nan"], ["unknown name 'nan'"]),
        (["p=1e400"], ["1e-60 to 1e60"]),
        (["p=9^9^9^9"], ["p"]),
        (["p=１"], ["not ASCII"]),
        (["p=__import__('os')"], ["p"]),
    ],
)
def test_bad_parameters(settings, pieces, folder, capsys):
    flags = [f for setting in settings for f in ("-s", setting)]
    sentence = refused(["build", "pyramid_cut", *flags, "-o", "a.step"], 2, capsys)
    for piece in pieces:
        assert piece in sentence


@pytest.mark.parametrize(
    ("arguments", "code", "piece"),
    [
        ([], 2, "VERB"),
        (["biuld"], 2, "invalid choice: 'biuld'"),
        (["build", "pyramid"], 2, "-o"),
        (["build", "-o", "a.step"], 2, "TEMPLATE"),
        (["build", "pyramid", "-o"], 2, "expected one argument"),
        (["build", "pyramid", "-o", "-a.step"], 2, "./-name"),
        (["build", "pyramid_cut", "-s", "p=0.3", "q=0.2", "-o", "a.step"], 2, "its own -s"),
        (["build", "pyramid", "-o", "a.step", "--degree", "14"], 2, "--degree 14: from 2 to 13"),
        (["build", "pyramid", "-o", "a.step", "--degree", "1"], 2, "--degree 1: from 2 to 13"),
        (["check", "pyramid", "--degree", "three"], 2, "--degree"),
        (["check", "pyramid", "--max-degree", "2"], 2, "--max-degree 2: from 3 to 13"),
        (
            ["check", "pyramid", "--profile", "cubic", "--degree", "5"],
            2,
            "from 2 to 3 in",
        ),
        (["check", "pyramid", "--degree", "5", "--max-degree", "7"], 2, "give one"),
        (["check", "pyramid", "--profile", "square"], 2, "--profile"),
        (["build", "pyramid", "-o", "a.step", "--schema", "AP203"], 2, "AP242"),
        (["build", "pyramid", "-o", "a.step", "--tol", "1"], 2, "--tol"),
        (["build", "pyramid", "-o", "a.step", "--tolerance", "0"], 2, "positive length"),
        (["build", "pyramid", "-o", "a.step", "--tolerance=-1"], 2, "positive length"),
        (["build", "pyramid", "-o", "a.step", "--tolerance", "fine"], 2, "--tolerance"),
        (["build", "pyramid", "-o", "a.step", "--tolerance", "[1,2,3]"], 2, "--tolerance"),
        (["build", "pyramid", "-o", "a.stl", "--deflection", "0"], 2, "--deflection"),
        (["build", "pyramid", "-o", "a.xyz"], 2, ".step"),
        (["build", "pyramid", "-o", "a"], 2, ".step"),
        (["build", "pyramid", "-o", ""], 5, "empty"),
        (["build", "pyramid", "-o", "a\0.step"], 5, "NUL"),
        (["build", "pyramid", "-o", "missing/a.step"], 5, "folder"),
        (["build", "pyramid", "-o", f"{'a' * 300}.step"], 5, "too long"),
        (["build", "pyramid", "-o", "a.step", "--report", "missing/r.json"], 5, "folder"),
        (["build", "pyramid", "-o", "a.step", "-o", "./a.step"], 2, "same file"),
        (["build", "pyramid", "-o", "a.step", "--report", "a.step"], 2, "same file"),
        (["new", "starter"], 2, ".toml"),
        (["new", "missing/s.toml"], 5, "folder"),
        (["new", "a\0.toml"], 5, "NUL"),
    ],
)
def test_bad_arguments(arguments, code, piece, folder, capsys):
    assert piece in refused(arguments, code, capsys)


def test_the_template_is_not_overwritten(folder, capsys):
    (folder / "t.step").write_text(simplex())
    assert "the template" in refused(["build", "t.step", "-o", "./t.step"], 2, capsys)


def test_outputs_that_are_one_file_are_told_before_the_work(folder, capsys):
    (folder / "b.step").symlink_to("a.step")
    assert "same file" in refused(["build", "pyramid", "-o", "a.step", "-o", "b.step"], 2, capsys)


def test_an_existing_file_survives_a_failed_build(folder, capsys):
    (folder / "a.step").write_text("old")
    (folder / "t.toml").write_text(simplex(height="0"))
    refused(["build", "t.toml", "-o", "a.step", "-o", "b.stl"], 3, capsys)
    assert (folder / "a.step").read_text() == "old"


def test_a_failure_between_two_files_says_which_is_there(folder, capsys, monkeypatch):
    from pc2cad.errors import FileNotWrittenError
    from pc2cad.export import files

    write = files.write_atomically

    def failing(path, data):
        if str(path).endswith(".stl"):
            raise FileNotWrittenError(f"cannot write {path}: the disk is full")
        write(path, data)

    monkeypatch.setattr(files, "write_atomically", failing)
    assert main(["build", "pyramid", "-o", "a.step", "-o", "b.stl"]) == 5
    sentence = capsys.readouterr().err
    assert "cannot write b.stl: the disk is full; written before it: a.step\n" in sentence
    assert os.listdir() == ["a.step"]


def test_odd_names_work(folder, capsys):
    (folder / "-t.toml").write_text(simplex())
    assert main(["build", "-o", "./-a.step", "--", "-t.toml"]) == 0
    assert main(["build", "./-t.toml", "-o", "a\nb.step", "-s", " p = 1/3 "]) == 0
    assert sorted(os.listdir()) == ["-a.step", "-t.toml", "a\nb.step"]
    assert capsys.readouterr().out.count("\n") == 2


def test_a_file_comes_before_a_shipped_template_and_a_folder_after(folder, capsys):
    (folder / "pyramid").mkdir()
    assert main(["show", "pyramid"]) == 0
    assert "Triangular pyramid" in capsys.readouterr().out
    (folder / "pyramid_cut").write_text(simplex())
    assert main(["show", "pyramid_cut"]) == 0
    assert "Simplex" in capsys.readouterr().out
