"""Faults that a stranger's file, a parameter or a map may have; see docs/faults.md.

Each is one template (or the arguments that go with a good one), the exit codes that are right for
it, and words that its one sentence must hold.
"""

from __future__ import annotations

from dataclasses import dataclass

BAD, NO_SOLID, TOO_ROUGH, FAILED = 2, 3, 4, 5


@dataclass(frozen=True)
class Fault:
    """One fault; `seconds` is what its answer may take where there is real work to do."""

    number: int
    name: str
    template: str | bytes
    arguments: tuple[str, ...] = ()
    codes: tuple[int, ...] = (BAD,)
    words: tuple[str, ...] = ()
    seconds: float = 2.0

    def __str__(self) -> str:
        return f"{self.number} {self.name}"


def brick(x: str = "u", y: str = "v", z: str = "w", more: str = "") -> str:
    """Return a template of three coordinates, the texts as they stand."""
    return f'title = "T"\n{more}\n[solid]\nx = """{x}"""\ny = """{y}"""\nz = """{z}"""\n'


def parameter(table: str, use: str = "u*p") -> str:
    """Return a template with one parameter."""
    return brick(use, more=f"[parameters]\n{table}")


_DOUBLED = '[let]\na0 = "u"\n' + "".join(
    f'a{i} = "a{i - 1} + a{i - 1}*a{i - 1}"\n' for i in range(1, 60)
)

TEXT = [
    Fault(1, "import", brick("__import__('os').system('touch executed')")),
    Fault(2, "subclasses", brick("().__class__.__base__.__subclasses__()")),
    Fault(3, "globals", brick("Symbol.__new__.__globals__")),
    Fault(4, "attribute", brick("u.real")),
    Fault(5, "string", brick("u + 'v'")),
    Fault(5, "f-string", brick('f"{u}"')),
    Fault(5, "bytes", brick("b'u'")),
    Fault(6, "lambda", brick("(lambda: u)()")),
    Fault(6, "comprehension", brick("[u for u in v]")),
    Fault(6, "conditional", brick("u if v else w")),
    Fault(6, "assignment", brick("(u := v)")),
    Fault(7, "index", brick("u[0]")),
    Fault(7, "set", brick("{u, v}")),
    Fault(8, "semicolon", brick("u; v")),
    Fault(8, "newline", brick("u\\n+v\\n;")),
    Fault(8, "NUL", brick("u\\u0000")),
    Fault(9, "full-width letter", brick("ｕ")),
    Fault(9, "mathematical bold", brick("𝐬𝐢𝐧(u)")),
    Fault(9, "folding to a dunder", brick("__ｉmport__('os')")),
    Fault(10, "bidirectional override", brick("u\u202e+v")),
    Fault(10, "zero width", brick("u\u200b")),
    Fault(10, "no-break space", brick("u\u00a0+v")),
    Fault(11, "Arabic digits", brick("u*١٢")),
    Fault(12, "decimal comma", brick("1,5*u")),
    Fault(13, "juxtaposition", brick("2u"), words=("2*u",)),
    Fault(13, "two names", brick("u v")),
    Fault(14, "tower of powers", brick("u*9**9**9")),
    Fault(14, "tower with carets", brick("u*9^9^9")),
    Fault(15, "huge power", brick("u*2**100000")),
    Fault(15, "huge exponent", brick("u**1e9")),
    Fault(16, "tiny exponent", brick("u*7^1e-300")),
    Fault(16, "tiny root below a logarithm", brick("u*(-abs(log((7^1e-300)))*e)")),
    Fault(17, "nested exponentials", brick("u*exp(exp(exp(10)))")),
    Fault(17, "large exponential", brick("u*exp(1000)")),
    Fault(18, "beyond double precision", brick("u*1e999")),
    Fault(18, "5000 digits", brick("u*" + "1" * 5000)),
    Fault(19, "nan", brick("nan")),
    Fault(19, "inf", brick("u*inf")),
    Fault(19, "oo", brick("u*oo")),
    Fault(19, "imaginary", brick("u*1j")),
    Fault(20, "division by zero", brick("u*1/0")),
    Fault(20, "zero to the zero", brick("u/(0**0-1)")),
    Fault(20, "variable over zero", brick("u/0")),
    Fault(21, "root of a negative", brick("u*sqrt(-1)")),
    Fault(21, "logarithm of zero", brick("u*log(0)")),
    Fault(21, "arc sine of two", brick("u*asin(2)")),
    Fault(21, "root of -8", brick("u*(-8)**(1/3)")),
    Fault(22, "100 parentheses", brick("(" * 100 + "u" + ")" * 100)),
    Fault(22, "5000 signs", brick("-" * 5000 + "u")),
    Fault(23, "200 nested sines", brick("sin(" * 200 + "u" + ")" * 200)),
    Fault(24, "50 kB", brick("+".join(["u"] * 25_000))),
    Fault(25, "empty", brick("")),
    Fault(25, "blank", brick("   ")),
    Fault(25, "comment", brick("# u")),
    Fault(26, "unknown name", brick("u*q"), words=("q",)),
    Fault(26, "keyword", brick("u*None")),
    Fault(26, "built-in", brick("eval(u)")),
    Fault(26, "print", brick("print(u)")),
    Fault(27, "too many arguments", brick("sin(u, v)")),
    Fault(27, "no arguments", brick("sin()")),
    Fault(27, "function without call", brick("sin*u")),
    Fault(28, "comparison", brick("u<v")),
    Fault(28, "remainder", brick("u%v")),
    Fault(28, "floor division", brick("u//v")),
    Fault(29, "without w", brick("u", "v", "u+v"), codes=(NO_SOLID,)),
    Fault(29, "constant", brick("1", "2", "3"), codes=(NO_SOLID,)),
    Fault(30, "pole inside", brick("u/(v-0.3)"), codes=(NO_SOLID, TOO_ROUGH), seconds=10),
    Fault(31, "doubled definitions", brick("a59", more=_DOUBLED), codes=(BAD, NO_SOLID)),
    Fault(32, "cyclic definitions", brick("a", more='[let]\na = "b"\nb = "a"\n')),
    Fault(32, "self-reference", brick("a", more='[let]\na = "a+u"\n')),
    Fault(32, "parameter of itself", parameter('p = { default = "p" }')),
]

TEMPLATE = [
    Fault(33, "not UTF-8", b'title = "\xff\xfe"\n'),
    Fault(33, "UTF-16", brick().encode("utf-16")),
    Fault(33, "lone carriage return", brick().replace("\n", "\r")),
    Fault(34, "key twice", brick() + 'x = "v"\n'),
    Fault(34, "table twice", brick() + '[solid]\nx = "u"\n'),
    Fault(35, "no solid", 'title = "T"\n', words=("solid",)),
    Fault(35, "mistyped key", brick().replace("title", "titel"), words=("title",)),
    Fault(35, "mistyped table", brick(more="[paramters]\np = 1"), words=("parameters",)),
    Fault(36, "truth value", parameter("p = { default = true }")),
    Fault(36, "list for a number", parameter("p = { default = [1] }")),
    Fault(36, "date", parameter("p = { default = 2026-11-21 }")),
    Fault(36, "number for a title", brick().replace('"T"', "7")),
    Fault(37, "nan", parameter("p = { default = nan }")),
    Fault(37, "infinity", parameter("p = { default = 1.0, max = inf }"), codes=(BAD, 0)),
    Fault(38, "decimal comma", parameter("p = { default = 1,5 }")),
    Fault(39, "deep nesting", 'title = "T"\na = ' + "[" * 100_000),
    Fault(40, "dotted key", 'title = "T"\n' + "a." * 50_000 + "b = 1\n"),
    Fault(41, "a million lines", brick() + "\n" * 1_000_000),
    Fault(42, "hexadecimal integer", 'title = "T"\na = 0x' + "f" * 200_000 + "\n"),
    Fault(44, "version of another format", "version = 99\n" + brick()),
    Fault(45, "include", 'include = "../other.toml"\n' + brick()),
    Fault(46, "class", brick(more='[let]\n__class__ = "u"\n')),
    Fault(46, "key with a newline", brick(more='[let]\n"a\\nb" = "u"\n')),
    Fault(47, "empty file", ""),
    Fault(
        103,
        "quotes and directives in the title",
        brick().replace('"T"', """'a'','b') \\X2\\00E9\\X0\\ é'"""),
        codes=(BAD,),
    ),
    Fault(
        103,
        "line end and quotes in the title",
        brick().replace('"T"', "\"a\\n'b',')\""),
        codes=(0,),
    ),
    Fault(
        103, "control characters in the title", brick().replace('"T"', '"a\\u0007b"'), codes=(0,)
    ),
]

_P = "p = { default = 0.5, min = 0.25, max = 1 }"

PARAMETERS = [
    Fault(48, "out of range", parameter(_P), ("-s", "p=2"), words=("from 0.25 to 1",)),
    Fault(49, "least above most", parameter("p = { default = 1, min = 2, max = 1 }")),
    Fault(50, "nan", parameter(_P), ("-s", "p=nan")),
    Fault(50, "infinite", parameter(_P), ("-s", "p=1e400")),
    Fault(50, "denormal", parameter(_P), ("-s", "p=1e-320")),
    Fault(51, "decimal comma", parameter(_P), ("-s", "p=0,5")),
    Fault(51, "cut off", parameter(_P), ("-s", "p=1e")),
    Fault(51, "hexadecimal", parameter(_P), ("-s", "p=0x1")),
    Fault(51, "full width", parameter(_P), ("-s", "p=１")),
    Fault(52, "unknown unit", 'units = "furlong"\n' + brick(), words=("furlong",)),
    Fault(53, "named like a current parameter", parameter("u = { default = 1 }")),
    Fault(53, "named like a constant", parameter("pi = { default = 1 }", "u*pi")),
    Fault(53, "named like a function", parameter("sin = { default = 1 }")),
    Fault(54, "10 kB of name", parameter("p" * 10_000 + " = { default = 1 }")),
    Fault(55, "not declared", brick("u*p"), words=("p",)),
    Fault(55, "set but not there", brick(), ("-s", "p=1"), words=("p",)),
    Fault(57, "no wall left", parameter(_P, "u*(p-0.25)"), ("-s", "p=0.25"), codes=(NO_SOLID,)),
]

_BALL = "w*sin(pi*v)*cos(2*pi*u)", "w*sin(pi*v)*sin(2*pi*u)", "w*cos(pi*v)"

MAPS = [
    Fault(60, "left-handed everywhere", brick("1-u"), codes=(0,)),
    Fault(61, "det J changes its sign on a side", brick("u*u*(w-0.5)+u*0.1"), codes=(NO_SOLID,)),
    Fault(62, "det J changes its sign inside only", brick("u", "v*(1+w)-3*v*v*u*(1-u)*w*(1-w)*8"),
          codes=(NO_SOLID,)),
    Fault(63, "det J vanishes at an apex", brick("w*u", "w*v", "w"), codes=(0,)),
    Fault(64, "flat", brick(z="0"), codes=(NO_SOLID,)),
    Fault(64, "line", brick("u", "u", "u"), codes=(NO_SOLID,)),
    Fault(65, "pinch", brick("u-0.5", "v", "w*(u-0.5)"), codes=(NO_SOLID,)),
    Fault(66, "ring wound too far", brick("(3+w)*cos(7*u)", "(3+w)*sin(7*u)", "v"),
          codes=(NO_SOLID,), seconds=10),
    Fault(66, "helix overlaps",
          brick("(5+w*cos(2*pi*v))*cos(12*u)", "(5+w*cos(2*pi*v))*sin(12*u)",
                "w*sin(2*pi*v)+1.5*u"), codes=(NO_SOLID,), seconds=10),
    Fault(67, "seam that nobody declared",
          brick("(3+w)*cos(2*pi*u)", "(3+w)*sin(2*pi*u)", "v"), codes=(0,)),
    Fault(67, "seam written with too few digits",
          brick("(3+w)*cos(6.2831853*u)", "(3+w)*sin(6.2831853*u)", "v"),
          codes=(NO_SOLID, FAILED)),
    Fault(68, "side crosses itself", brick("cos(7*u)*(1+w)", "sin(14*u)*(1+w)", "v"),
          codes=(NO_SOLID,), seconds=10),
    Fault(69, "sides cross", brick(z="w*(u-0.3)"), codes=(NO_SOLID,)),
    Fault(70, "thinner than the kernel tells", brick(z="w*1e-8"), codes=(NO_SOLID, FAILED)),
    Fault(71, "sliver", brick(z="w*2e-6"), codes=(0,)),
    Fault(71, "edge below the kernel's tolerance", brick(z="w*(5e-8+v)"),
          codes=(NO_SOLID, FAILED)),
    Fault(72, "1e-9 large", brick("1e-9*u", "1e-9*v", "1e-9*w"), codes=(NO_SOLID, FAILED)),
    Fault(72, "1e9 large", brick("1e9*u", "1e9*v", "1e9*w"), codes=(TOO_ROUGH, FAILED, 0)),
    Fault(72, "far away", brick("u+1e9", "v", "w"),
          codes=(NO_SOLID, TOO_ROUGH, FAILED), seconds=10),
    Fault(73, "no number at a corner", brick("u", "v", "w/(u+v)"),
          codes=(NO_SOLID, TOO_ROUGH), seconds=10),
    Fault(73, "no number inside", brick("u", "v", "w*(1+1/(u-0.37))"),
          codes=(NO_SOLID, TOO_ROUGH), seconds=10),
    Fault(74, "kink", brick("u", "v", "w*(1+abs(u-0.3137))"), codes=(TOO_ROUGH, 0), seconds=10),
    Fault(74, "jump", brick("u", "v", "w + atan2(v-0.5, u-0.5)"),
          codes=(NO_SOLID,), seconds=10),
    Fault(75, "spike", brick("u", "v", "w*(1+1/(1e-9+(u-0.37)^2))"),
          codes=(NO_SOLID, TOO_ROUGH, FAILED), seconds=10),
    Fault(76, "tolerance out of reach", brick(z="w*(2+sin(9*u*v))"), ("--tolerance", "1e-18"),
          codes=(TOO_ROUGH,)),
    Fault(77, "nearly coincident rows", brick("u^9"), codes=(0, NO_SOLID)),
    Fault(78, "ball with three collapsed sides and a seam", brick(*_BALL), codes=(0,)),
    Fault(80, "degree above the kernel's", brick(z="w*(1+u^30)"), codes=(0,), seconds=5),
    Fault(80, "degree asked for above the kernel's", brick(), ("--degree", "26"),
          words=("from 2 to 13",)),
]  # fmt: skip
