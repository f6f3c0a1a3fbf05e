"""The reader of STEP texts: strict, bounded, and never in doubt about what it has read."""

from __future__ import annotations

import random
import re
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from plain_step import FOOTER, HEADER, box, swollen_box

from pc2cad.verify.defects import StepUnreadableError
from pc2cad.verify.exchange import DERIVED, Enumeration, Ref, Typed, parse_exchange
from pc2cad.verify.inversion import closest
from pc2cad.verify.receipt import describe, parse_step, read_step, receipt


def instances(data: str) -> dict[int, dict[str, tuple[object, ...]]]:
    return parse_exchange((HEADER + data + FOOTER).encode()).instances


def test_values_of_every_kind() -> None:
    found = instances(
        "/* a ; comment */#1=A(1,-2.5E-3,'it''s \\X2\\00E9\\X0\\ \\X\\41',.T.,$,*,#2,M(3.),"
        "((),(1)));"
        "\n#2 = (B(1.)\nC('two\nlines'));"
    )
    assert found[1]["A"] == (
        1, -0.0025, "it's é A", Enumeration("T"), None, DERIVED, Ref(2), Typed("M", (3.0,)),
        ((), (1,)),
    )  # fmt: skip
    assert found[2] == {"B": (1.0,), "C": ("twolines",)}
    assert found[1]["A"][0] is not True


GARBLED: dict[str, Callable[[str], str]] = {
    "nothing": lambda t: "",
    "no header": lambda t: t.replace("HEADER;", "", 1),
    "no schema": lambda t: re.sub(r"FILE_SCHEMA.*?;\n", "", t),
    "cut short": lambda t: t[: len(t) // 2],
    "no end": lambda t: t.replace(FOOTER, "ENDSEC;\n"),
    "text after the end": lambda t: t + "x",
    "a lost semicolon": lambda t: t.replace(");\n#9", ")\n#9", 1),
    "a lost bracket": lambda t: t.replace("));", ");", 1),
    "a lost comma": lambda t: t.replace(",*,*,", ",**,", 1),
    "a number that is twice there": lambda t: t.replace("#5=", "#4=", 1),
    "a reference to nothing": lambda t: t.replace("VERTEX_POINT('',#1)", "VERTEX_POINT('',#999)"),
    "a number that is none": lambda t: t.replace("1.E-07", "1.E-", 1),
    "a huge number": lambda t: t.replace("1.E-07", "1.E999", 1),
    "a number of many digits": lambda t: t.replace("(3)", "(" + "3" * 5000 + ")", 1),
    "a real of many digits": lambda t: t.replace("1.E-07", "1." + "3" * 5000, 1),
    "a coordinate that is huge": lambda t: t.replace("(1.0,0.0,0.0)", "(1.E300,0.0,0.0)", 1),
    "a huge instance number": lambda t: t.replace("#5=", "#" + "9" * 400 + "=", 1),
    "instance nought": lambda t: t.replace("#5=", "#0=", 1),
    "not a number": lambda t: t.replace("1.E-07", "NAN", 1),
    "an open string": lambda t: t.replace("'box',#", "'box,#", 1),
    "an open comment": lambda t: t.replace("DATA;", "DATA; /* ", 1),
    "lists in lists": lambda t: t.replace("('',*,*", "(" * 5000 + "*", 1),
    "types in types": lambda t: t.replace("LENGTH_MEASURE(", "A(" * 5000, 1),
    "a partial entity twice": lambda t: t.replace("NAMED_UNIT(*)", "LENGTH_UNIT()", 1),
    "a control character": lambda t: t.replace("'box'", "'b\x00x'", 1),
    "small letters": lambda t: t.replace("EDGE_LOOP", "edge_loop", 1),
    "another section": lambda t: t.replace("DATA;", "ANCHOR;\nENDSEC;\nDATA;", 1),
}


@pytest.mark.parametrize("kind", GARBLED)
def test_garbled_texts_are_refused(kind: str) -> None:
    changed = GARBLED[kind](box())
    assert changed != box()
    start = time.process_time()
    with pytest.raises(StepUnreadableError):
        parse_exchange(changed.encode())
    assert time.process_time() - start < 2.0


def test_what_is_no_text_or_no_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(StepUnreadableError, match="byte 3"):
        parse_exchange(b"ISO\xff")
    for path in (tmp_path, tmp_path / "missing.step"):
        with pytest.raises(StepUnreadableError):
            receipt(path)


@pytest.mark.parametrize(
    "text", ["/**/" * 20_000 + "?", "'" * 20_001, "((" * 9, "/*" * 20_000, "A" * 50_000]
)
def test_no_text_is_searched_again_and_again(text: str) -> None:
    start = time.process_time()
    with pytest.raises(StepUnreadableError):
        instances(text)
    assert time.process_time() - start < 1.0


def test_a_plain_box_is_sound(tmp_path: Path) -> None:
    path = tmp_path / "box.step"
    path.write_text(box(volume=6.0))
    found = receipt(path)
    assert found["sound"] is True, found
    (solid,) = found["solids"]
    assert solid["volume"] == pytest.approx(6.0, rel=1e-14)
    assert solid["area"] == pytest.approx(22.0, rel=1e-14)
    assert solid["centroid"] == pytest.approx([0.5, 1.0, 1.5], rel=1e-14)
    assert (solid["faces"], solid["edges"], solid["vertices"]) == (6, 12, 8)
    assert solid["unit_m"] == 1e-3
    assert solid["carriers"] == {"PLANE": 6}


def _break(text: str, chance: random.Random) -> str:
    """Change one place of the text, or swap two of its numbers."""
    at = chance.randrange(len(text))
    kind = chance.randrange(6)
    if kind == 0:
        return text[:at] + text[at + chance.randrange(1, 40) :]
    if kind == 1:
        return text[:at] + chance.choice("();,#'$*.=0123456789EXT/\\\n\x7fé") + text[at:]
    if kind == 2:
        return text[:at] + chance.choice(["1.E99", "#1", "#40", "$", "()", "*", "''"]) + text[at:]
    references = list(re.finditer(r"#\d+(?!=)", text) if kind < 5 else re.finditer(r"\d\.\d", text))
    one, other = sorted(chance.sample(references, 2), key=lambda found: found.start())
    return (
        text[: one.start()] + other.group() + text[one.end() : other.start()]
        + one.group() + text[other.end() :]
    )  # fmt: skip


def fuzz(folder: Path, count: int, seed: int) -> tuple[int, int, int]:
    """Return how many broken files were refused, found unsound and found sound."""
    chance, path = random.Random(seed), folder / "broken.step"
    text = box(volume=6.0)
    whole = describe(read_of(path, text))
    refused = unsound = sound = 0
    for _ in range(count):
        broken = text
        for _ in range(chance.randrange(1, 3)):
            broken = _break(broken, chance)
        try:
            found = describe(read_of(path, broken))
        except StepUnreadableError:
            refused += 1
            continue
        if found["sound"]:
            # what is sound after all is the same solid, but for names and unused instances
            (solid,), (own,) = found["solids"], whole["solids"]
            assert solid["volume"] == pytest.approx(own["volume"], rel=1e-6), broken
            sound += 1
        else:
            unsound += 1
    return refused, unsound, sound


def read_of(path: Path, text: str):
    path.write_text(text)
    return read_step(path)


def test_broken_texts_end_in_a_verdict(tmp_path: Path) -> None:
    refused, unsound, sound = fuzz(tmp_path, 300, 1)
    assert refused > 30
    assert unsound > 30
    assert refused + unsound + sound == 300


@pytest.mark.slow
def test_very_many_broken_texts_end_in_a_verdict(tmp_path: Path) -> None:
    assert sum(fuzz(tmp_path, 2_500, 2)) == 2_500


def test_a_point_without_parameters_is_named(tmp_path: Path) -> None:
    text = box().replace("CARTESIAN_POINT('',(1.0,2.0,3.0))", "CARTESIAN_POINT()", 1)
    found = describe(read_of(tmp_path / "broken.step", text))
    assert found["sound"] is False
    assert any("has no three coordinates" in sentence for sentence in found["defects"])


@pytest.mark.parametrize(
    ("whole", "broken"),
    [
        ("SI_UNIT($,.RADIAN.)", "SI_UNIT()"),
        ("SI_UNIT(.MILLI.,.METRE.)", "SI_UNIT(.MILLI.)"),
        ("GLOBAL_UNIT_ASSIGNED_CONTEXT((", "GLOBAL_UNIT_ASSIGNED_CONTEXT((),("),
    ],
)
def test_partial_entities_without_their_parameters_are_named(
    tmp_path: Path, whole: str, broken: str
) -> None:
    text = box(volume=6.0)
    assert text.count(whole) == 1
    found = describe(read_of(tmp_path / "broken.step", text.replace(whole, broken)))
    assert found["sound"] is False
    assert broken.split("(")[0].lower() in str(found).lower() or "lists of units" in str(found)


@pytest.mark.slow
def test_a_million_instances_are_read_in_time(tmp_path: Path) -> None:
    many = "".join(f"#{n}=CARTESIAN_POINT('',({n}.,0.,0.));\n" for n in range(1000, 1_001_000))
    path = tmp_path / "many.step"
    path.write_text(box().replace(FOOTER, many + FOOTER))
    start = time.process_time()
    assert receipt(path)["sound"] is True
    assert time.process_time() - start < 20.0


@pytest.mark.slow
def test_time_grows_with_poles_and_not_with_their_square() -> None:
    taken = []
    for count in (100, 316):
        text, times = swollen_box(count).encode(), []
        for _ in range(3):
            start = time.process_time()
            file = parse_step(text)
            times.append(time.process_time() - start)
        taken.append(min(times))
        assert file.sound is True
        assert file.solids[0].volume == pytest.approx(6.0 + 6.4 * 2.0 / 36.0, rel=1e-2)
    # ten times as many: 10 if linear, 100 if quadratic, whatever else the machine does
    assert len(taken) == 2
    assert taken[1] < 32 * taken[0]


def test_no_kernel_is_loaded(tmp_path: Path) -> None:
    path = tmp_path / "box.step"
    path.write_text(box())
    code = (
        "import sys, pc2cad as pc; assert pc.receipt(sys.argv[1])['sound'];"
        "bad = {'OCP', 'cadquery', 'sympy', 'scipy', 'pc2cad.brep', 'pc2cad.representation',"
        "'pc2cad.validation', 'pc2cad.part', 'pc2cad.compiler'}; print(bad & set(sys.modules))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(path)], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "set()"


def test_a_place_just_before_the_seam_of_a_closed_curve_is_found() -> None:
    def at(t):
        turn = 2 * np.pi * t[:, None]
        along = np.concatenate((-np.sin(turn), np.cos(turn)), axis=1)
        return np.concatenate((np.cos(turn), np.sin(turn)), axis=1), 2 * np.pi * along

    wanted = np.array([0.998, 0.002, 0.3, 0.9999])
    found = closest(at, (np.linspace(0, 1, 25), 0.0, 1.0), at(wanted)[0])
    assert found == pytest.approx(wanted, abs=1e-12)
