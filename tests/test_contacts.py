"""Bodies that touch in points or along curves are refused, with the place; near ones are built."""

from __future__ import annotations

import re

import numpy as np
import pytest

from pc2cad.compiler import compile_solid
from pc2cad.csg.contacts import TouchingBodiesError
from pc2cad.options import DEFAULTS, CompileOptions
from pc2cad.part import Part
from pc2cad.templates.file import parse_template


def box(x: tuple[float, float], y: tuple[float, float], z: tuple[float, float]) -> str:
    rows = zip("xyz", "uvw", (x, y, z), strict=True)
    return "\n".join(f'{a} = "{low} + ({high} - ({low}))*{p}"' for a, p, (low, high) in rows)


def ball(r: float | str, x: float = 0, y: float = 0, z: float = 0) -> str:
    return (
        f'x = "{x} + {r}*w*sin(pi*v)*cos(2*pi*u)"\ny = "{y} + {r}*w*sin(pi*v)*sin(2*pi*u)"\n'
        f'z = "{z} + {r}*w*cos(pi*v)"'
    )


def rod(r: float, x: float, y: float, z: tuple[float, float]) -> str:
    return (
        f'x = "{x} + {r}*w*cos(2*pi*u)"\ny = "{y} + {r}*w*sin(2*pi*u)"\n'
        f'z = "{z[0]} + ({z[1]} - ({z[0]}))*v"'
    )


def tube(inner: float, outer: float, z: tuple[float, float]) -> str:
    return rod(1, 0, 0, z).replace("1*w", f"({inner} + ({outer} - {inner})*w)")


def ring(major: float, minor: float, z: float) -> str:
    out = f"({major} + {minor}*w*cos(2*pi*v))"
    return f'x = "{out}*cos(2*pi*u)"\ny = "{out}*sin(2*pi*u)"\nz = "{z} + {minor}*w*sin(2*pi*v)"'


def cone(r: float, z: tuple[float, float]) -> str:
    """Its tip is at z[1]."""
    out, high = f"{r}*w*v", z[1] - z[0]
    return f'x = "{out}*cos(2*pi*u)"\ny = "{out}*sin(2*pi*u)"\nz = "{z[1]} - {high}*v"'


CUBE = box((-1, 1), (-1, 1), (-1, 1))
#: a hump whose top is at height 0, on no exact surface
HUMP = 'x = "2*u - 1"\ny = "2*v - 1"\nz = "w*(2 + exp(-4*((2*u - 1)^2 + (2*v - 1)^2))) - 3"'
#: a ridge along y whose edge is at height 1
RIDGE = 'x = "(u - v)/2"\ny = "w - 1/2"\nz = "1 - (u + v)/2"'


def joined(result: str, options: CompileOptions = DEFAULTS, **bodies: str) -> Part:
    text = f'title = "t"\nresult = "{result}"\n'
    for name, solid in bodies.items():
        text += f'[[bodies]]\nname = "{name}"\n[bodies.solid]\n{solid}\n'
    return compile_solid(parse_template(text, "t").bind(), options)


slow = pytest.mark.slow
#: result, bodies, a place of contact (None in a coordinate that may be any)
TOUCHING = [
    pytest.param("cut(a, b)", {"a": CUBE, "b": ball(1)}, "six points", id="ball in a cube"),
    pytest.param("cut(a, b)", {"a": CUBE, "b": ball("(1 - 1e-8)")}, "six points", id="nearly"),
    pytest.param("cut(a, b)", {"a": CUBE, "b": ball(0.4, 0.1, 0.2, 0.6)}, (0.1, 0.2, 1),
                 id="ball under a face"),
    pytest.param("union(a, b)", {"a": CUBE, "b": ball(0.5, 0.1, 0.2, 1.5)}, (0.1, 0.2, 1),
                 id="ball on a face"),
    pytest.param("union(a, b)", {"a": box((0, 1), (0, 1), (0, 1)),
                 "b": box((1, 2), (1, 2), (0, 1))},
                 (1, 1, None), id="boxes along an edge"),
    pytest.param("cut(a, b)", {"a": CUBE, "b": rod(1, 0, 0, (-0.5, 0.5))}, "four lines",
                 id="rod in a cube"),
    pytest.param("cut(a, b)", {"a": CUBE, "b": cone(0.5, (-0.5, 1))}, (0, 0, 1),
                 id="tip of a cone"),
    pytest.param("cut(a, b)", {"a": CUBE, "b": RIDGE}, (0, None, 1), id="ridge", marks=slow),
    pytest.param("union(a, b)", {"a": rod(1, -1, 0, (-1, 1)), "b": rod(1, 1, 0, (-1, 1))},
                 (0, 0, None), id="rods", marks=slow),
    pytest.param("cut(a, union(b, c))", {"a": box((-3, 3), (-3, 3), (-1, 1)),
                 "b": rod(1, -1, 0, (-2, 2)), "c": rod(1, 1, 0, (-2, 2))}, (0, 0, None),
                 id="bores", marks=slow),
    pytest.param("cut(a, b)", {"a": box((-4, 4), (-4, 4), (0, 3)), "b": ring(2, 0.5, 0.5)},
                 (None, None, 0), id="ring under a plane", marks=slow),
    pytest.param("union(a, b)", {"a": box((-4, 4), (-4, 4), (-1, 0)), "b": ring(2, 0.5, 0.5)},
                 (None, None, 0), id="ring on a plane", marks=slow),
    pytest.param("cut(a, b)", {"a": box((-2, 2), (-2, 2), (-4, 0)), "b": HUMP}, (0, 0, 0),
                 id="hump", marks=slow),
]  # fmt: skip


@pytest.mark.parametrize(("result", "bodies", "place"), TOUCHING)
def test_contact_is_refused_with_its_place(
    result: str, bodies: dict[str, str], place: tuple[float | None, ...] | str
) -> None:
    with pytest.raises(TouchingBodiesError, match="the bodies touch without crossing") as error:
        joined(result, **bodies)
    point = [float(x) for x in re.search(r"at \((.*?)\)", str(error.value))[1].split(", ")]
    if place == "six points":
        assert sorted(map(abs, point)) == pytest.approx([0, 0, 1], abs=1e-3)
    elif place == "four lines":
        assert sorted(map(abs, point[:2])) == pytest.approx([0, 1], abs=1e-3)
    else:
        assert len(place) == 3
        for found, true in zip(point, place, strict=True):
            assert true is None or found == pytest.approx(true, abs=1e-4)
    assert re.search(r"more than \d\S* mm is told from contact", str(error.value))
    if result == "cut(a, b)" and bodies == {"a": CUBE, "b": ball(1)}:
        assert "within 0 mm" in str(error.value)
        assert "and 5 more places" in str(error.value)


#: result, bodies, volume
SOUND = [
    pytest.param("cut(a, b)", {"a": CUBE, "b": ball("(1 - 1e-3)")}, 8 - 4 / 3 * np.pi * 0.999**3,
                 id="gap of 1e-3"),
    pytest.param("cut(a, b)", {"a": CUBE, "b": ball("(1 - 1e-6)")},
                 8 - 4 / 3 * np.pi * (1 - 1e-6) ** 3, id="gap of 1e-6"),
    pytest.param("union(a, b)", {"a": CUBE, "b": ball(1)}, 8, id="ball inside"),
    pytest.param("intersect(a, b)", {"a": CUBE, "b": ball(1)}, 4 / 3 * np.pi, id="ball in common"),
    pytest.param("union(a, b)", {"a": rod(1, 0, 0, (0, 1)), "b": box((-3, 0), (0, 1), (0, 1))},
                 3 + 3 / 4 * np.pi, id="tangent rib"),
    pytest.param("union(a, b)", {"a": box((0, 1), (0, 1), (0, 1)),
                 "b": box((1, 2), (0.2, 0.7), (0, 1))}, 1.5, id="faces in one plane"),
    pytest.param("cut(a, b)", {"a": CUBE, "b": ball("(1 - 1e-4)")},
                 8 - 4 / 3 * np.pi * (1 - 1e-4) ** 3, id="gap of 1e-4", marks=slow),
    pytest.param("cut(a, b)", {"a": CUBE, "b": ball("(1 + 1e-4)")},
                 8 - 4 / 3 * np.pi * (1 + 1e-4) ** 3 + 6 * np.pi * 1e-8, id="holes", marks=slow),
    pytest.param("cut(a, b)", {"a": CUBE, "b": rod(0.5, 0, 0, (-2, 2))}, 8 - np.pi / 2, id="bore",
                 marks=slow),
    pytest.param("cut(a, b)", {"a": box((-4, 4), (-4, 4), (0, 3)), "b": ring(2, 0.5, 0.3)}, None,
                 id="groove", marks=slow),
    pytest.param("intersect(a, b)", {"a": ring(0.97, 0.23, -0.67), "b": ring(1.05, 0.3, -0.36)},
                 None, id="rings in circles"),
    pytest.param("union(a, b)", {"a": rod(1, 0, 0, (0, 2)), "b": ball(1)},
                 2 * np.pi + 2 / 3 * np.pi, id="round end", marks=slow),
    pytest.param("cut(a, b)", {"a": rod(1, 0, 0, (-1, 1)), "b": rod(1, 2, 0, (-0.5, 0.5))},
                 2 * np.pi, id="rods side by side, of which one stays"),
    pytest.param("intersect(a, b)", {"a": rod(2, 0, 0, (-2, 2)), "b": tube(1.999, 3, (-1, 1))},
                 2 * np.pi * (4 - 1.999**2), id="a ring narrower than any grid"),
    pytest.param("cut(a, b)", {"a": rod(2, 0, 0, (-2, 2)), "b": tube(1.99999, 3, (-1, 1))},
                 16 * np.pi - 2 * np.pi * (4 - 1.99999**2), id="a groove as narrow", marks=slow),
]  # fmt: skip


@pytest.mark.parametrize(("result", "bodies", "volume"), SOUND)
def test_bodies_that_are_near_or_join_smoothly_are_built(
    result: str, bodies: dict[str, str], volume: float | None
) -> None:
    part = joined(result, **bodies)
    assert volume is None or part.report.solid.volume == pytest.approx(volume, rel=1e-9)


@pytest.mark.parametrize("tolerance", [1e-2, pytest.param(None, marks=slow)])
def test_a_gap_below_what_is_known_of_a_face_is_contact(tolerance: float | None) -> None:
    """A wavy face is known to within its deviation: of what lies nearer nobody can tell."""
    bodies = {
        "f": box((-1, 4), (-1, 2), (-1, 2)),
        "a": 'x = "3*u"\ny = "v"\nz = "w*(1 + sin(9*u)/5)"',
        "b": box((-0.5, 3.5), (-0.5, 1.5), (1.2 + 1e-5, 1.9)),
    }
    if tolerance is None:
        assert joined("cut(f, union(a, b))", **bodies).report.shells == 3
        return
    with pytest.raises(TouchingBodiesError, match="touch without crossing"):
        joined("cut(f, union(a, b))", CompileOptions(tolerance), **bodies)


def boxed(size: float, *ranges: tuple[float, float]) -> str:
    x, y, z = ((size * low, size * high) for low, high in ranges)
    return box(x, y, z)


def near(kind: str, size: float, gap: float) -> tuple[str, dict[str, str]]:
    """Return bodies of a size, and what is made of them, which are a gap (a length) apart."""
    half = gap / 2
    if kind == "in a point":
        cube = boxed(size, (-1, 1), (-1, 1), (-1, 1))
        return "cut(a, b)", {"a": cube, "b": ball(size - gap)}
    if kind == "along a curve":
        high, low = (-2 * size, 2 * size), -size - half
        block = boxed(size, (-3, 3), (-3, 3), (-1, 1))
        bores = {"b": rod(size, low, 0, high), "c": rod(size, -low, 0, high)}
        return "cut(cut(a, b), c)" if gap > 0 else "cut(a, union(b, c))", {"a": block} | bores
    base = boxed(size, (-1, 1), (-1, 1), (-1, 0))
    left, right = (box(x, (-size, size), (0, size)) for x in ((-size, -half), (half, size)))
    return "union(a, b, c)", {"a": base, "b": left, "c": right}


NEAR = [
    pytest.param(kind, size, gap, marks=() if size == 0.01 and gap > 0 else slow)
    for kind in ("in a point", "along a curve", "over a face")
    for size, gap in ((0.01, 1e-7), (1, 1e-7), (1e3, 1e-7), (0.01, -1e-8))
    # boxes that overlap are joined, and a ball that sticks out makes holes
    if gap > 0 or kind == "along a curve"
]


@pytest.mark.parametrize(("kind", "size", "gap"), NEAR)
def test_what_is_nearer_than_the_kernel_tells_is_contact_with_its_distance(
    kind: str, size: float, gap: float
) -> None:
    result, bodies = near(kind, size, gap)
    with pytest.raises(TouchingBodiesError) as error:
        joined(result, **bodies)
    found = re.search(r"come within (\S+) mm of one another (.*?) at", str(error.value))
    assert found
    assert float(found[1]) == pytest.approx(abs(gap), rel=0.1)
    assert found[2] == kind


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["in a point", "along a curve", "over a face"])
@pytest.mark.parametrize(("size", "share"), [(0.01, 1e-3), (1, 1e-6), (1e5, 1e-7)])
def test_what_is_farther_is_built(kind: str, size: float, share: float) -> None:
    result, bodies = near(kind, size, share * size)
    exact = {
        "in a point": 8 - 4 / 3 * np.pi * (1 - share) ** 3,
        "along a curve": 72 - 4 * np.pi,
        "over a face": 8 - 2 * share,
    }
    volume = joined(result, **bodies).report.solid.volume
    assert volume == pytest.approx(exact[kind] * size**3, rel=1e-9)
