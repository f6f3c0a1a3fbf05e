"""Small files that stand for huge ones: each has to be read soon, or refused in one sentence."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

#: bytes of a template that is just small enough to be looked at
ROOM: Final = 255 * 1024
_HEAD: Final = 'title = "t"\n'
_CUBE: Final = '[solid]\nx = "u"\ny = "v"\nz = "w"\n'


def _rows(form: str, count: int, joint: str = "") -> str:
    """Return a form with its number, i, and the one before it, j, so many times (from 1)."""
    return joint.join(form.format(i=i, j=i - 1) for i in range(1, count + 1))


def _times(piece: str, room: int = ROOM) -> str:
    return piece * (room // len(piece))


def _lets(form: str, count: int, first: str = "u") -> str:
    """Return a template with definitions that use one another."""
    lets = _rows(f'a{{i}} = "{form}"\n', count).replace("{p}", "")
    return f'{_HEAD}[let]\na0 = "{first}"\n{lets}[solid]\nx = "u + a{count}"\ny = "v"\nz = "w"\n'


def _points(rows: str, table: str) -> str:
    return f"{_HEAD}{table.format(rows=rows)}{_CUBE}"


def _guide(kind: str, rows: str, more: str = "") -> str:
    return (
        f'{_HEAD}[guide]\nkind = "{kind}"\npoints = [{rows}]\n{more}[frame]\n[solid]\n'
        'M = "N + w*(cos(2*pi*v)*(R - N) + sin(2*pi*v)*(Q - N))"\n'
    )


def _bodies(count: int, result: str) -> str:
    bodies = _rows(f'[[bodies]]\nname = "b{{i}}"\n[bodies.solid]\n{_CUBE[8:]}', count)
    return f'{_HEAD}result = "{result}"\n{bodies}'


#: name -> the text of a template
BOMBS: Final[dict[str, Callable[[], str]]] = {
    # what the parser of TOML would choke on
    "quoted key of 25,000 parts": lambda: ".".join(['"a"'] * 25_000) + "=1",
    "quoted key of 60,000 parts": lambda: ".".join(['"a"'] * 60_000) + "=1",
    "bare key of 100,000 parts": lambda: ".".join(["a"] * 100_000) + "=1",
    "spaced key": lambda: " . ".join(["'a'"] * 40_000) + "=1",
    "header of 25,000 parts": lambda: "[" + ".".join(['"a"'] * 25_000) + "]",
    "keys of 16 parts": lambda: _rows("a.b.c.d.e.f.g.h.i.j.k.l.m.n.o.p{i}=1\n", 6000),
    "keys of 8 parts": lambda: "[a.b.c.d.e.f.g.h]\n" + _rows("a.b.c.d.e.f.g.h{i}=1\n", 10_000),
    "nested arrays": lambda: "a=" + "[" * 250_000,
    "nested tables": lambda: "a=" + "{a=" * 60_000,
    "texts without an end": lambda: 'a="' + _times('\\"'),
    "quotes": lambda: _times('"'),
    "triples of quotes": lambda: "a=" + _times("'''x"),
    "one long text": lambda: f'title = "{"x" * (ROOM - 100)}"\n{_CUBE}',
    "one long escaped text": lambda: 'title = "' + _times("\\n", ROOM - 100) + f'"\n{_CUBE}',
    "one long key": lambda: "a" * ROOM + "=1",
    "a list of numbers": lambda: f"{_HEAD}{_CUBE}[expect]\nvolume = [{_times('1,', ROOM - 99)}]",
    "a list of tables": lambda: (
        f"{_HEAD}{_CUBE}[expect]\ncentroid = [{_times('{a=1},', ROOM - 99)}]"
    ),
    "many arrays of tables": lambda: _times("[[a]]\n"),
    "many tables": lambda: _rows("[a{i}]\n", 25_000),
    "many keys": lambda: _rows("a{i}=1\n", 25_000),
    "many inline keys": lambda: "a={" + _rows("a{i}=1", 25_000, ",") + "}",
    "many line ends": lambda: _times("\n"),
    "many comments": lambda: _times("#\n"),
    # numbers
    "a decimal number of 250,000 digits": lambda: f"{_HEAD}[let]\na={'1' * (ROOM - 99)}\n{_CUBE}",
    "a hexadecimal number": lambda: f"{_HEAD}[let]\na=0x{'f' * (ROOM - 99)}\n{_CUBE}",
    "a hexadecimal kind": lambda: f"{_HEAD}[guide]\nkind=0x{'f' * (ROOM - 99)}\n{_CUBE}",
    "a hexadecimal layer": lambda: f"{_HEAD}[layers]\na=0x{'f' * (ROOM - 99)}\nb=1\n{_CUBE}",
    "a hexadecimal parameter": lambda: f"{_HEAD}[parameters]\na=0x{'f' * 99_999}\n{_CUBE}",
    "a hexadecimal point": lambda: f"{_HEAD}[points]\nA=[0x{'f' * 99_999},0,0]\n{_CUBE}",
    "a hexadecimal title": lambda: f"title=0x{'f' * 99_999}\n{_CUBE}",
    "a hexadecimal start": lambda: _guide("spline", "[0,0,0],[1,0,0]", "start=0x" + "f" * 9999),
    "a hexadecimal result": lambda: _bodies(2, "union(b1, b2)") + "about=0x" + "f" * 99_999,
    "an endless exponent": lambda: f"{_HEAD}[let]\na=1e{'9' * (ROOM - 99)}\n{_CUBE}",
    "an endless fraction": lambda: f"{_HEAD}[let]\na=1.{'1' * (ROOM - 99)}\n{_CUBE}",
    # definitions upon definitions
    "squares with a seventh": lambda: _lets("a{j}*a{j} + 1/7", 14, "1/3"),
    "squares with a seventh for ever": lambda: _lets("a{j}*a{j} + 1/7", 400, "1/3"),
    "sums with an inverse": lambda: _lets("a{j}/3 + 1/(a{j} + 1/7)", 400, "1/3"),
    "doubled numbers": lambda: _lets("a{j} + a{j}", 400, "1"),
    "powers of powers": lambda: _lets("a{j}^a{j}", 60, "3"),
    "powers": lambda: _lets("a{j}^1000", 60, "1 + 1e-40"),
    "fourth derivatives": lambda: _lets("diff(a{j}*a{j}, u, 4)", 40, "sin(u)*exp(u)"),
    "derivatives of quotients": lambda: _lets("diff(a{j}/(1 + a{j}), u, 4)", 40, "sin(u)"),
    "derivatives of powers": lambda: _lets("diff(a{j}^a{j}, u, 4)", 40, "2 + u"),
    "lengths of lengths": lambda: _lets("length(diff([a{j}, a{j}^2, sin(a{j})], u, 4))", 40),
    "more definitions than are read": lambda: _lets("a{j}", 9000),
    # long lists
    "many parameters": lambda: f"{_HEAD}[parameters]\n" + _rows("a{i}=1\n", 20_000) + _CUBE,
    "many points": lambda: f"{_HEAD}[points]\n" + _rows("A{i}=[1,2,3]\n", 12_000) + _CUBE,
    "many layers": lambda: f"{_HEAD}[layers]\n" + _rows("a{i}=1\n", 20_000) + _CUBE,
    "many curves": lambda: _HEAD + _rows('[curves.a{i}]\nkind="ellipse"\na=1\nb=1\n', 5500) + _CUBE,
    "many bodies": lambda: _bodies(3000, "union(b1, b2)"),
    "many names of bodies": lambda: _bodies(2, f"union({', '.join(['b1'] * 60_000)})"),
    "a result nested deeply": lambda: _bodies(2, "union(b1, " * 20_000 + "b2" + ")" * 20_000),
    "a polygon of 40,000 corners": lambda: _points(
        _rows("[{i},{j}]", 20_000, ","), '[curves.c]\nkind = "polygon"\npoints = [{rows}]\n'
    ),
    "a contour of 20,000 points": lambda: _points(
        _rows("[{i},{j}]", 19_000, ","), '[curves.c]\nkind = "contour"\npoints = [{rows}]\n'
    ),
    "a rounded polygon": lambda: _points(
        _rows("[{i},{j}]", 19_000, ","),
        '[curves.c]\nkind = "polygon"\nradius = 0.1\npoints = [{rows}]\n',
    ),
    "radii without end": lambda: _points(
        _times("0,", ROOM - 999),
        '[curves.c]\nkind = "polygon"\npoints = [[0,0],[1,0],[0,1]]\nradius = [{rows}]\n',
    ),
    "a spline of 15,000 points": lambda: _guide("spline", _rows("[{i},{j},0]", 15_000, ",")),
    "a polyline of 15,000 points": lambda: _guide("polyline", _rows("[{i},{j},0]", 15_000, ",")),
    "a contour of 2,000 points": lambda: _points(
        _rows("[{i},{j}]", 2000, ","), '[curves.c]\nkind = "contour"\npoints = [{rows}]\n'
    ),
    "a contour by its chords": lambda: _points(
        _rows("[{i},{j}]", 2000, ","),
        '[curves.c]\nkind = "contour"\nspacing = "chord"\npoints = [{rows}]\n',
    ),
    "a spline of 2,000 points": lambda: _guide("spline", _rows("[{i},{j},0]", 2000, ",")),
    "a wild spline of 2,000 points": lambda: _guide(
        "spline", ",".join(f"[{i * i % 7},{i * i % 11},{i * i % 13}]" for i in range(2000))
    ),
    "a polyline of 2,000 points": lambda: _guide("polyline", _rows("[{i},{j},0]", 2000, ",")),
    "a wild polyline of 2,000 points": lambda: _guide(
        "polyline",
        ",".join(f"[{i},{i * i % 11},{i * i % 13}]" for i in range(2000)),
        "radius = 0.01\n",
    ),
    "a helix of a million turns": lambda: (
        f'{_HEAD}[guide]\nkind = "helix"\nradius = 1\npitch = 1\nturns = 1000000\n[frame]\n'
        '[solid]\nM = "N + w*(cos(2*pi*v)*(R - N) + sin(2*pi*v)*(Q - N))"\n'
    ),
    "a guide of a million waves": lambda: (
        f'{_HEAD}[guide]\nN = "[u, sin(1000000*u), cos(1300000*u)]"\n[frame]\n'
        '[solid]\nM = "N + w*(cos(2*pi*v)*(R - N) + sin(2*pi*v)*(Q - N))"\n'
    ),
    "a guide that does not move": lambda: (
        f'{_HEAD}[guide]\nN = "[0*u, 1, 2]"\n[frame]\n'
        '[solid]\nM = "N + w*(cos(2*pi*v)*(R - N) + sin(2*pi*v)*(Q - N))"\n'
    ),
    "400 fillets": lambda: _guide(
        "polyline",
        ",".join(f"[{i},{i * i % 11},{i * i % 13}]" for i in range(402)),
        "radius = 0.01\n",
    ),
    "a composite of long splines": lambda: (
        f'{_HEAD}[guide]\nkind = "composite"\nparts = ['
        + f'{{kind="spline",points=[{_rows("[{i},{j},0]", 1500, ",")}]}},' * 7
        + ']\n[frame]\n[solid]\nM = "N + w*(cos(2*pi*v)*(R - N) + sin(2*pi*v)*(Q - N))"\n'
    ),
    "a composite of 200 helices": lambda: (
        f'{_HEAD}[guide]\nkind = "composite"\ncorners = "keep"\nparts = ['
        + _times('{kind="helix",radius=1,pitch=1,turns=100},', 9000)
        + ']\n[frame]\n[solid]\nM = "N + w*(cos(2*pi*v)*(R - N) + sin(2*pi*v)*(Q - N))"\n'
    ),
    "curves within curves": lambda: (
        f'{_HEAD}[curves.c]\nkind = "polygon"\npoints = [{_rows("[{i},{j}]", 900, ",")}]\n[let]\n'
        'a0 = "v"\n' + _rows('a{i} = "c_x(a{j})"\n', 1500) + _CUBE
    ),
}
