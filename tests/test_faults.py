"""Every fault of the corpus: one sentence, its exit code, nothing executed, nothing written."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import fault_corpus
import pytest

from pc2cad.cli.main import main

CORPUS = [
    *fault_corpus.TEXT, *fault_corpus.TEMPLATE, *fault_corpus.PARAMETERS, *fault_corpus.MAPS,
]  # fmt: skip


@pytest.fixture(scope="module", autouse=True)
def _loaded(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Import the kernel before anything is timed."""
    folder = tmp_path_factory.mktemp("warm")
    main(["build", "pyramid", "-o", str(folder / "p.step"), "--quiet"])


#: what takes long is real work and tried seldom
CASES = [
    pytest.param(fault, marks=[pytest.mark.slow] if fault.seconds > 20 else [], id=str(fault))
    for fault in CORPUS
]


@pytest.mark.parametrize("fault", CASES)
def test_a_fault_is_one_sentence_and_no_file(
    fault: fault_corpus.Fault,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    template = fault.template
    data = template if isinstance(template, bytes) else template.encode()
    Path("t.toml").write_bytes(data)
    begun = time.process_time()
    code = main(["build", "t.toml", "-o", "t.step", *fault.arguments])
    spent = time.process_time() - begun
    out, err = capsys.readouterr()
    assert code in fault.codes, err
    if code != 0:
        assert out == ""
        assert err.startswith("pc2cad: ")
        assert err.count("\n") == 1
        assert "unexpected error" not in err
        assert "Traceback" not in err
        assert len(err) < 1300
        for word in fault.words:
            assert word in err
        assert os.listdir() == ["t.toml"], "nothing half-written, nothing executed"
    assert spent < fault.seconds, err


def test_every_fault_of_the_list_has_its_line_and_its_test() -> None:
    tests = Path(__file__).parent
    text = (tests.parent / "docs" / "faults.md").read_text().partition("\n## Fuzzing")[0]
    lines = [line.strip("| ").split(" | ") for line in text.splitlines() if line.startswith("| ")]
    lines = [cells for cells in lines if cells[0].isdigit()]
    assert [int(cells[0]) for cells in lines] == list(range(1, 133))
    numbers = {fault.number for fault in CORPUS}
    for number, *_, test in lines:
        if "fault_corpus.py" in test:
            assert int(number) in numbers, number
        elif not test.startswith("none"):
            file, _, name = test.strip("`").partition("::")
            assert f"\ndef {name}(" in (tests / file).read_text(), test


@pytest.mark.slow
def test_two_builds_into_one_file_leave_one_whole_file(tmp_path: Path) -> None:
    target = tmp_path / "part.step"
    command = [sys.executable, "-m", "pc2cad.cli.main", "build", "pyramid", "-o", str(target)]
    running = [subprocess.Popen(command, stdout=subprocess.DEVNULL) for _ in range(2)]
    assert [process.wait(timeout=60) for process in running] == [0, 0]
    text = target.read_bytes()
    assert text.startswith(b"ISO-10303-21;")
    assert text.rstrip().endswith(b"END-ISO-10303-21;")
    assert os.listdir(tmp_path) == ["part.step"]


@pytest.mark.slow
def test_a_locale_with_decimal_commas_changes_nothing(tmp_path: Path) -> None:
    made = subprocess.run(
        ["localedef", "-i", "de_DE", "-f", "UTF-8", str(tmp_path / "de_DE.UTF-8")],
        capture_output=True, check=False,
    )  # fmt: skip
    if made.returncode != 0:
        pytest.skip("the sources of locales are not installed")
    # a locale takes effect in C only where a program asks for it, as CQ-editor's Qt does
    started = (
        "import locale, sys; locale.setlocale(locale.LC_ALL, '');"
        "print(locale.localeconv()['decimal_point'], flush=True);"
        "from pc2cad.cli.main import main; sys.exit(main(sys.argv[1:]))"
    )
    contents = []
    for name, point in (("de_DE.UTF-8", ","), ("C", ".")):
        folder = tmp_path / f"build-{name}"
        folder.mkdir()
        done = subprocess.run(
            [sys.executable, "-c", started, "build", "triquadratic_cube", "-s", "a=0.25",
             "-o", str(folder / "c.step"), "-o", str(folder / "c.stl"), "--quiet"],
            check=True, timeout=60, capture_output=True, text=True,
            env={**os.environ, "LC_ALL": name, "LOCPATH": str(tmp_path),
                 "SOURCE_DATE_EPOCH": "1700000000"},
        )  # fmt: skip
        assert done.stdout.strip() == point
        contents.append([(folder / file).read_bytes() for file in ("c.step", "c.stl")])
    assert contents[0] == contents[1]
