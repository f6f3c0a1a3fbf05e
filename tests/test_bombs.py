"""Small files that stand for huge ones: every verb answers soon, before any limit of its work."""

from __future__ import annotations

import itertools
import json
import time
from pathlib import Path

import pytest
from fuzzing.bombs import BOMBS
from hypothesis import given, settings
from hypothesis import strategies as st
from plain_step import box

from pc2cad.cli.main import GUARDED, main
from pc2cad.equation.language import read_expression
from pc2cad.errors import InputError
from pc2cad.studies.journal import LONGEST_LINE, _lines, _parsed
from pc2cad.studies.plan import PlanError, read_axes
from pc2cad.studies.variants_table import read_table
from pc2cad.templates import scan
from pc2cad.templates.file import parse_template
from pc2cad.templates.header import TemplateError
from pc2cad.templates.ranges import RangeError, read_axis

#: seconds of processor time
SOON = 2.0
#: legitimate, and large: they are read, and refused by nothing
READ = {
    "one long text", "one long escaped text", "an endless fraction", "powers",
    "a contour of 2,000 points", "a contour by its chords", "a spline of 2,000 points",
    "a polyline of 2,000 points", "400 fillets", "a helix of a million turns",
    "a wild spline of 2,000 points", "a wild polyline of 2,000 points",
}  # fmt: skip
QUICK = sorted(BOMBS.keys() - READ)
#: verb -> what it needs beside the template
NEEDS = {
    "build": ["-o", "o.step"], "check": [], "mesh": ["-o", "o.vtu"], "render": ["-o", "o.png"],
    "view": ["-o", "o.html"], "points": ["-o", "o.ply"], "spline": ["-o", "o.g2"], "show": [],
    "study": ["--vary", "p=1,2", "-o", "o"], "verify": [], "sensitivities": [],
    "adjust": ["--vary", "p=1:2", "--until", "volume=1"],
}  # fmt: skip


def command(verb: str) -> list[str]:
    """Return how a verb is called with the bomb, in the current folder."""
    first = ["box.step"] if verb == "verify" else []
    return [verb, *first, "bomb.toml", *NEEDS[verb]]


def test_every_verb_that_takes_a_template_is_in_the_matrix() -> None:
    assert set(NEEDS) == {*GUARDED, "show", "study"}


# another kind of text each time; the slow matrix below has them all
@pytest.mark.parametrize("name", QUICK[::3])
def test_every_verb_refuses_every_bomb_soon(name, tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    text = BOMBS[name]()
    assert len(text) < 256 * 1024
    Path("bomb.toml").write_text(text)
    Path("box.step").write_text(box())
    # the verbs read alike: each has its turn with some of the bombs, and `show` with all
    turn = QUICK.index(name) % len(NEEDS)
    verbs = {"show", sorted(NEEDS)[turn]}
    assert verbs
    for verb in sorted(verbs):
        begun = time.process_time()
        assert main(command(verb)) == 2
        assert time.process_time() - begun < SOON + (3.0 if verb != "show" else 0.0)  # imports
        complaint = capsys.readouterr().err
        assert complaint.startswith("pc2cad: ")
        assert "unexpected" not in complaint
        assert complaint.count("\n") == 1
    assert {path.name for path in tmp_path.iterdir()} <= {"bomb.toml", "box.step", "o"}


# they read alike: each bomb meets four of the twelve
@pytest.mark.slow
@pytest.mark.parametrize("verb", NEEDS)
def test_every_verb_meets_a_third_of_the_bombs(verb, tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    bombs = QUICK[sorted(NEEDS).index(verb) % 3 :: 3]
    assert len(bombs) > 13
    Path("box.step").write_text(box())
    for name in bombs:
        Path("bomb.toml").write_text(BOMBS[name]())
        begun = time.process_time()
        assert main(command(verb)) == 2, name
        assert time.process_time() - begun < SOON + 3.0, name
        assert "unexpected" not in capsys.readouterr().err, name
    assert {path.name for path in tmp_path.iterdir()} <= {"bomb.toml", "box.step", "o"}


@pytest.mark.parametrize("form", ["sin(a{j})", "sin(a{j}) + cos(a{j})", "a{j} + a{j}", "a{j} + v"])
def test_a_chain_of_definitions_is_read_in_linear_time(form) -> None:
    runs = itertools.count()

    def spent(count: int) -> float:
        own = f"{form} + {next(runs)}"  # not what a run before has left
        lets = "".join(f'a{i} = "{own.format(j=i - 1)}"\n' for i in range(1, count))
        text = f'title = "t"\n[let]\na0 = "u"\n{lets}[solid]\nx = "u"\ny = "v"\nz = "w"\n'
        begun = time.process_time()
        parse_template(text, "t")
        return time.process_time() - begun

    spent(10)
    short = min(spent(125) for _ in range(3))
    assert min(spent(1000) for _ in range(3)) < 24 * short  # 8 times if linear, 64 if quadratic


def test_more_definitions_than_are_read_are_refused() -> None:
    with pytest.raises(InputError, match=r"\[let\]: has 9001 entries, and at most 2000"):
        parse_template(BOMBS["more definitions than are read"](), "t")


def test_an_expression_by_itself_has_no_budget() -> None:
    assert read_expression("1/3", {}) is not None


def test_lists_of_values_are_bounded_before_they_are_laid_out() -> None:
    assert len(read_axis("p", "0:1:1000000").values) == 1_000_000
    assert read_axis("p", "0.1:0.9:17").values[8] == 0.5
    with pytest.raises(RangeError, match="more than 1000000"):
        read_axis("p", "1," * 1_000_001 + "1")
    with pytest.raises(PlanError, match="the axes have"):
        read_axes({"p": "0:1:1000000", "q": "0:1:1000000"})
    with pytest.raises(PlanError, match="at most 256 may"):
        read_axes({f"p{i}": "1" for i in range(300)})


@pytest.mark.parametrize(
    ("text", "match"),
    [
        (",".join(f"p{i}" for i in range(100_000)) + "\n", "at most 256 may"),
        ("p\n" + "1\n" * 1_000_001, "more than 1000000 variants"),
        (",".join(f"p{i}" for i in range(200)) + "\n" + ("1," * 199 + "1\n") * 30_000, "set 200"),
        ('p\n"' + "1" * 200_000 + '"\n', "comma-separated"),
        ("p\n" + "9**" * 5000 + "9\n", "4000"),
    ],
)
def test_a_csv_table_is_counted_while_it_is_read(text, match, tmp_path) -> None:
    (tmp_path / "t.csv").write_text(text)
    begun = time.process_time()
    with pytest.raises((PlanError, RangeError), match=match):
        read_table(tmp_path / "t.csv")
    assert time.process_time() - begun < 2 * SOON


def test_a_parquet_table_is_judged_by_what_it_says_of_itself(tmp_path) -> None:
    arrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    rows = arrow.chunked_array([arrow.repeat(0.5, 500_000)] * 16)
    bombs = {
        "rows": arrow.table({"p": rows}),
        "columns": arrow.table({f"p{i}": [1.0] for i in range(2000)}),
        "texts": arrow.table({"p": ["x" * 1_000_000] * 3}),
        "lists": arrow.table({"p": [[1.0] * 10]}),
    }
    messages = {"rows": "1 to 1000000", "columns": "at most 256", "texts": "no numbers",
                "lists": "no numbers"}  # fmt: skip
    assert len(bombs) == 4
    for name, table in bombs.items():
        parquet.write_table(table, tmp_path / "t.parquet", compression="zstd")
        begun = time.process_time()
        with pytest.raises(PlanError, match=messages[name]):
            read_table(tmp_path / "t.parquet")
        assert time.process_time() - begun < SOON
    parquet.write_table(arrow.table({"p": [0.25, 1.0], "n": [1, 2]}), tmp_path / "t.parquet")
    assert read_table(tmp_path / "t.parquet").variants == ((0.25, 1.0), (1.0, 2.0))


@pytest.mark.parametrize("name", ["9" * 3000, "a\0b"])
def test_a_name_that_no_table_can_have_is_one_sentence(name) -> None:
    with pytest.raises(PlanError, match=r"cannot be read|no such file"):
        read_table(Path(name))


def test_a_journal_is_read_line_by_line_and_no_line_is_endless(tmp_path) -> None:
    path = tmp_path / "journal.jsonl"
    whole = json.dumps({"study": "s"}).encode() + b"\n"
    torn = [b"x" * (LONGEST_LINE + 10) + b"\n", b"[" * 200_000 + b"\n", b"[]\n", b"{", b""]
    assert len(torn) == 5
    for rest in torn:
        path.write_bytes(whole + rest)
        with path.open("rb") as file:
            lines = [line for line, _ in _lines(file)]
        assert max(map(len, lines)) <= LONGEST_LINE + 1
        assert [_parsed(line) for line in lines if _parsed(line)] == [{"study": "s"}]


@given(st.lists(st.sampled_from(
    ["a", ".", ".", "a.", "a.b.c.", "[", "{", "]", "}", "[" * 9, "{" * 20, " ", "\n", "=", "#",
     "1.5", '"', "'", '"""', "'''", '"x.y"', ".a.b.c.d"]
), max_size=60).map("".join))  # fmt: skip
@settings(max_examples=300, deadline=None)
def test_templates_are_scanned_wherever_they_may_be_refused(text):
    said = []
    for look in (scan._may_be_deep, lambda _: True):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(scan, "_may_be_deep", look)
            try:
                said.append(scan.check_text(text, "file"))
            except TemplateError as error:
                said.append(str(error))
    assert said[0] == said[1]
