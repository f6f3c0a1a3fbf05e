"""Variants that take from a proof over ranges what a fresh build finds: the same bytes."""

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from pc2cad import compiler
from pc2cad.checked import check_map
from pc2cad.cli import view
from pc2cad.cli.main import main
from pc2cad.compiler import compile_solid
from pc2cad.solidity import orientation
from pc2cad.studies import figures, over_ranges
from pc2cad.studies.adjust import adjust
from pc2cad.studies.over_ranges import ProvedLater, packed, proof_of_plan, prove_over
from pc2cad.studies.plan import Plan, grid, read_axes
from pc2cad.studies.study import study
from pc2cad.studies.variant import Job, Task, run_variant
from pc2cad.templates.file import parse_template, read_template
from pc2cad.templates.shipped import bodies_paths, template_paths

ROOT = """title = "root"
[parameters]
p = 1
[solid]
x = "u*sqrt(w)*(1 + p/8)"
y = "v"
z = "w"
"""


@pytest.fixture(autouse=True)
def _epoch(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1000000000")


def shipped(name: str) -> Any:
    return read_template((template_paths() | bodies_paths())[name])


def built(equation: Any, known: Any, folder: Path) -> tuple[dict[str, Any], bytes]:
    part = compile_solid(equation, known=known)
    part.write(folder / "part.step")
    report = part.report.to_dict()
    del report["times"]
    return report, (folder / "part.step").read_bytes()


@pytest.mark.parametrize(
    ("template", "over", "values", "has_sides"),
    [
        (shipped("pyramid_cut"), {"p": "0.2:0.8", "q": "0.2:0.8"}, {"p": 0.3, "q": 0.7}, True),
        (shipped("torus_tube"), {"R": "4:6"}, {"R": 4.5}, True),
        (shipped("ball_wedge"), {"turn": "0.1:0.4"}, {"turn": 0.3}, True),
        # there are creases, and parameters that are slowed down: sides are asked for as ever
        (shipped("disc_cam"), {"lift": "6:9"}, {"lift": 7}, False),
        (parse_template(ROOT, "root", "root.toml"), {"p": "1:2"}, {"p": 1.5}, True),
    ],
)
def test_a_variant_is_that_of_a_fresh_build(
    template: Any, over: Any, values: Any, has_sides: bool, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    equation, proof = template.bind(values), prove_over(template, over)
    known = proof.at(template.values(values)[0])
    assert known is not None
    assert (known.boundary is not None) == has_sides
    fresh = built(equation, None, tmp_path)
    monkeypatch.delattr(orientation, "proved_sign")  # nobody asks
    assert built(equation, known, tmp_path) == fresh


def test_a_variant_of_a_study_is_that_of_a_task_without_a_proof(tmp_path: Path) -> None:
    text = template_paths()["pyramid_cut"].read_text()
    task = Task(text, "pyramid_cut", ("step",), str(tmp_path), fixed={"r": "1/2"})
    proof = prove_over("pyramid_cut", {"p": "0.2:0.8"}, {"r": "1/2"})
    proved = replace(task, known=packed(proof))
    assert proved.fingerprint == task.fingerprint
    for p in (0.25, 0.9):  # within, and beyond
        job = Job(f"p={p}", {"p": p})
        one, other = run_variant(task, job), run_variant(proved, job)
        assert one.status == "built"
        assert (one.figures, one.hashes) == (other.figures, other.hashes)


def test_a_study_is_proved_once_where_it_pays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    vary: dict[str, Any] = {"p": "0.2:0.8:3", "q": [0.25]}
    without = study("pyramid_cut", tmp_path / "a", vary=vary, formats=(), workers=1)
    assert without.proof is None
    monkeypatch.setattr(over_ranges, "FEWEST", 3)
    found = study("pyramid_cut", tmp_path / "b", vary=vary, formats=(), workers=1)
    assert found.proof is not None
    assert found.proof.is_whole
    rows = [
        [{k: x for k, x in row.items() if "seconds" not in k} for row in result.rows]
        for result in (found, without)
    ]
    assert rows[0] == rows[1]


def test_who_does_not_know_how_many_there_will_be_proves_later(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(over_ranges, "LATER", 3)
    later = ProvedLater(shipped("pyramid_cut"), {"p": (0.2, 0.8)}, {"q": "1/4"})
    assert [later.at({"p": p}) is None for p in (0.3, 0.4, 0.5, "0.6", 0.9)] == [
        True, True, False, False, True,
    ]  # fmt: skip
    for template, over in (
        (shipped("bolt"), {"d": (2, 3)}),
        (shipped("spring"), {"pitch": (2, 3)}),
    ):
        never = ProvedLater(template, over, {})
        assert [never.at({}) for _ in range(5)] == [None] * 5


def test_parameters_are_adjusted_alike_with_a_proof(monkeypatch: pytest.MonkeyPatch) -> None:
    def adjusted() -> Any:
        found = adjust(
            "torus", {"R": (4, 8), "r": (0.5, 2)}, ["volume=150"]
        )  # fmt: skip
        return found.parameters, found.figures, found.evaluations

    without = adjusted()
    monkeypatch.setattr(over_ranges, "LATER", 2)
    asked: list[int] = []
    monkeypatch.setattr(
        figures, "find_orientation",
        lambda mapping, sign: asked.append(sign) or orientation.find_orientation(mapping, sign),
    )  # fmt: skip
    assert adjusted() == without
    # all but the first were told
    assert asked == [0] + [asked[-1]] * (len(asked) - 1)
    assert asked[-1] in (-1, 1)
    assert len(asked) == 6


def test_sliders_take_from_a_proof(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(over_ranges, "LATER", 2)
    parser = argparse.ArgumentParser()
    view.add_arguments(parser)
    maker = view._Maker(parser.parse_args(["torus", "--serve", "-s", "r=2", "--slider", "r=1:3"]))
    asked: list[Any] = []

    def checked(*given: Any, known: Any, **named: Any) -> Any:
        asked.append(known)
        return check_map(*given, known=known, **named)

    monkeypatch.setattr(compiler, "check_map", checked)
    answers = [maker.answer({"r": r}) for r in ("1.5", "2.5", "2.75")]
    assert [known is None for known in asked] == [True, False, False]
    fresh = view._Maker(parser.parse_args(["torus", "--serve", "--slider", "r=1:3"]))
    assert len(fresh.answer({"r": "2.75"})) == len(answers[-1])


def plan(count: int, **vary: str) -> Plan:
    return grid(read_axes({name: f"{given}:{count}" for name, given in vary.items()}))


def test_no_proof_where_there_is_none_to_be_had() -> None:
    template = shipped("pyramid_cut")
    assert proof_of_plan(template, plan(10, p="0.2:0.8"), {}) is None
    assert proof_of_plan(template, plan(300, p="0.2:0.8"), {}) is not None
    assert proof_of_plan(shipped("spring"), plan(300, pitch="2:3"), {}) is None
    assert proof_of_plan(shipped("bolt"), plan(300, d="2:3"), {}) is None
    # a value that no variant may have is told by the variants
    assert proof_of_plan(template, plan(300, p="0.2:0.8"), {"r": "2"}) is None
    assert proof_of_plan(template, plan(300, p="2:3"), {}) is None
    assert packed(None) == ""


def test_values_that_are_not_allowed_take_nothing_from_a_proof() -> None:
    rows = [(0.2 + k / 500, 0.25) for k in range(300)]
    found = proof_of_plan(
        shipped("pyramid_cut"), Plan(("p", "q"), (*rows, (-3.0, 0.25), (0.5, 1e9))), {}
    )
    assert found is not None
    assert found.is_whole
    assert found.names == ("p",)


@pytest.mark.parametrize(
    ("template", "over", "words"),
    [
        ("torus", {"r": "1:2:3"}, "write NAME=LOW:HIGH"),
        ("torus", {"r": "2:1"}, "the range 2:1 is empty"),
        ("torus", {"r": (2, 2)}, "has two limits"),
        ("torus", {"r": (-1, 2)}, "outside its range"),
        ("torus", {"r": (1, "x")}, "numbers, are needed"),
        ("torus", {"r": None}, "numbers, are needed"),
        ("torus", {"x": "1:2"}, "torus has no parameter 'x'"),
        ("bolt", {"d": "1:2"}, "several bodies"),
        ("torus", {}, "say over which ranges"),
    ],
)
def test_bad_ranges_are_one_sentence(template: str, over: Any, words: str) -> None:
    with pytest.raises(Exception, match=words) as error:
        prove_over(shipped(template), over)
    assert "\n" not in str(error.value)
    assert type(error.value).__module__.startswith("pc2cad")


def test_the_command_tells_what_is_proved_and_what_is_open(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """A torus folds where its tube is wider than its circle, of radius 5."""
    assert main(["check", "torus", "--over", "r=1:8"]) == 0
    told = capsys.readouterr().out
    assert "det J keeps its sign: proved over 57.14 % of r from 1 to 8" in told
    assert "1 … 4.9998779296875  > 0    1 bound, 4 coincide, 1 collapse" in told
    assert "Open: not proved, and not refuted" in told
    assert main(["check", "torus", "--over", "r=1:4", "-s", "R=6", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["share"] == found["share_of_sides"] == 1
    assert found["proved"] == [{"values": {"r": [1, 4]}, "sign": 1, "faces": 1}]
    assert found["open"] == []


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["torus", "--over", "r"], "--over 'r': write NAME=LOW:HIGH, for example p=0.2:0.8"),
        (["torus", "--over", "r=1:2", "--over", "r=1:3"], "--over r: the parameter has two ranges"),
        (["torus", "--over", "r=1:2", "--triangles"], "--over is answered without a solid"),
        (["bolt", "--over", "d=1:2"], "choose one of them with --body"),
        (["spring", "--over", "pitch=2:3"], "the way to M asks for its value"),
    ],
)
def test_the_command_refuses_in_one_sentence(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", *arguments]) == 2
    told = capsys.readouterr()
    assert told.out == ""
    assert words in told.err
    assert told.err.count("\n") == 1
