"""The snippets of README.md and docs/ do what the text around them says."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
from itertools import pairwise
from pathlib import Path

import pytest
from whole_files import assert_whole

from pc2cad.cli.main import main
from pc2cad.compiler import compile_equation
from pc2cad.templates.file import parse_template

ROOT = Path(__file__).parent.parent
#: read from top to bottom, each block needing those before it
TUTORIAL = ROOT / "docs" / "tutorial.md"
RESULT = ROOT / "docs" / "one-equation.md"
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def snippets(language: str) -> list[tuple[str, str]]:
    found = []
    for path in DOCUMENTS:
        if path in (TUTORIAL, RESULT):
            continue
        blocks = re.findall(rf"^```{language}\n(.*?)^```", path.read_text(), re.M | re.S)
        found += [(f"{path.name} {i}", block) for i, block in enumerate(blocks, start=1)]
    return found


def ids(found: list[tuple[str, str]]) -> list[str]:
    return [name for name, _ in found]


def marked(found: list) -> list:
    """Mark as slow what loads the kernel again (studies), or builds one part many times."""
    return [
        pytest.param(*each, marks=pytest.mark.slow if re.search("study|slider", str(each)) else ())
        for each in found
    ]


@pytest.mark.parametrize(("_name", "code"), marked(snippets("python")), ids=ids(snippets("python")))
def test_python_runs_and_its_comments_are_true(
    _name: str, code: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec(compile(code, _name, "exec"), names)
    for expression, value in values_in(code):
        assert eval(expression, names) == pytest.approx(eval(value)), expression
    for name in written_by(code):
        assert_whole(tmp_path / name)


def values_in(code: str) -> list[tuple[str, str]]:
    """Return expressions and the values that comments behind them state."""
    lines = [line.partition("  # ") for line in code.splitlines()]
    return [(a, b.strip()) for a, _, b in lines if re.match(r"['\"\d]", b.strip())]


def written_by(code: str) -> list[str]:
    return re.findall(r"write\(\"(.+?)\"", code)


def test_documents_state_values_and_write_files_of_many_kinds() -> None:
    codes = [code for _, code in snippets("python")]
    assert sum(len(values_in(code)) for code in codes) >= 15
    names = [name for code in codes for name in written_by(code)]
    names += [name for arguments in commands() for name in written(arguments)]
    assert len(names) >= 18
    assert {Path(name).suffix for name in names} >= {"", ".3mf", ".html", ".inp", ".step", ".vtu"}


def whole_templates() -> list[tuple[str, str]]:
    return [(name, text) for name, text in snippets("toml") if "solid]" in text]


@pytest.mark.parametrize(("_name", "text"), whole_templates(), ids=ids(whole_templates()))
def test_templates_compile_and_meet_what_they_expect(_name: str, text: str) -> None:
    equation = parse_template(text, "snippet").bind()
    report = compile_equation(equation).report
    assert report.solid.volume > 0
    if equation.expectations.volume is not None:
        assert report.solid.volume == pytest.approx(equation.expectations.volume, rel=1e-6)


def test_curves_of_the_format_page_are_accepted() -> None:
    (curves,) = [text for _, text in snippets("toml") if "solid]" not in text and "[curves" in text]
    tail = '\n[solid]\nx = "section_x(v)*(w + 1)"\ny = "section_y(v)*(w + 1)"\nz = "u"\n'
    names = parse_template('title = "t"\n' + curves + tail, "snippet").curves
    parts = ("x", "y", "nx", "ny")
    assert set(names) == {
        f"{name}_{part}" for name in ("section", "duct", "wave") for part in parts
    }


def test_tables_of_the_format_page_are_accepted() -> None:
    (tables,) = [text for _, text in snippets("toml") if "solid]" not in text and "[data]" in text]
    z = "w*(chord(0.2 + 0.8*u) + thick(u, v) + spine(u).z + cam(720*u)/10 + k[1] + c[1, 0])"
    tail = f'[parameters]\nr = 1\n[solid]\nx = "u"\ny = "v"\nz = "{z}"\n'
    template = parse_template('title = "t"\n' + tables + tail, "snippet")
    assert set(template.curves) == {"chord", "thick", "spine", "cam"}
    assert set(template.data) == {"k", "c"}
    assert compile_equation(template.bind()).report.solid.volume > 0


def commands() -> list[list[str]]:
    lines = [line for _, block in snippets("sh") for line in block.splitlines()]
    return [shlex.split(line, comments=True)[1:] for line in lines if line.startswith("pc2cad ")]


@pytest.mark.parametrize(
    "arguments", marked([(each,) for each in commands()]), ids=lambda arguments: " ".join(arguments)
)
def test_commands_succeed(
    arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    if arguments[0] == "verify":
        made = arguments[2:] or ["parallelepiped"]
        assert main(["build", *made, "-o", arguments[1]]) == 0
    assert main(arguments) == 0
    for name in written(arguments):
        assert_whole(tmp_path / name)


def written(arguments: list[str]) -> list[str]:
    """Return the files and folders that a command is told to write."""
    new = arguments[1:2] if arguments[0] == "new" else []
    return new + [name for flag, name in pairwise(arguments) if flag in ("-o", "--report")]


@pytest.mark.slow
def test_the_tutorial_from_top_to_bottom(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"^```(sh|toml|python)\n(.*?)^```", TUTORIAL.read_text(), re.M | re.S)
    assert len(blocks) == 12
    for language, text in blocks:
        if language == "toml":
            Path(text.partition("\n")[0].removeprefix("# ")).write_text(text)
        elif language == "python":
            exec(compile(text, TUTORIAL.name, "exec"), {})
        else:
            for line in text.splitlines():
                code = re.search(r"# exit code (\d)", line)
                arguments = shlex.split(line, comments=True)[1:]
                assert main(arguments) == int(code.group(1) if code else 0), line
    # the words of the text
    report = compile_equation(parse_template(Path("vase.toml").read_text(), "vase").bind()).report
    fates = {side.name: side.fate for side in report.sides}
    assert [name for name, fate in fates.items() if fate == "interface"] == ["v=0", "v=1"]
    assert sorted(face.carrier for face in report.faces) == ["plane"] * 2 + ["revolution"] * 2
    assert report.evidence == "exact"


@pytest.mark.interop
def test_one_equation_comes_to_its_result(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The page from top to bottom, with CalculiX and MFEM, and every value that it states."""
    pytest.importorskip("mfem")
    if shutil.which("ccx") is None:
        pytest.skip("CalculiX is not installed (apt-get install calculix-ccx)")
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"^```(sh|toml|python)\n(.*?)^```", RESULT.read_text(), re.M | re.S)
    names: dict[str, object] = {}
    held = 0
    for language, text in blocks:
        if language == "toml":
            Path(text.partition("\n")[0].removeprefix("# ")).write_text(text)
        elif language == "python":
            exec(compile(text, RESULT.name, "exec"), names)
            for expression, value in re.findall(r"(?m)^(\S.*?)  +# (.+)$", text):
                assert eval(expression, names) == pytest.approx(eval(value), rel=1e-9), expression
                held += 1
        else:
            for line in text.splitlines():
                program, *arguments = shlex.split(line)
                if program == "ccx":
                    subprocess.run([program, *arguments], check=True, capture_output=True)
                else:
                    assert main(arguments) == 0, line
    assert (len(blocks), held) == (9, 7)
    for name in ("pipe.step", "pipe.vtu", "pipe.png", "pipe.html", "pipe.3mf"):
        assert_whole(tmp_path / name)


def test_the_reference_is_that_of_the_docstrings(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(ROOT / "docs")
    from make_api import FILE, reference

    assert FILE.read_text(encoding="utf-8") == reference(), "python docs/make_api.py makes it anew"


def test_pictures_that_are_shown_exist() -> None:
    targets = [
        (path, target)
        for path in DOCUMENTS
        for target in re.findall(r"\]\((?!http)([^)#]+)\)", path.read_text())
    ]
    assert len({target for _, target in targets}) > 30
    for path, target in targets:
        assert (path.parent / target).exists(), f"{path.name}: {target}"
