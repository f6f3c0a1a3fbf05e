"""STEP texts written by hand, with no kernel: a box of planes and lines, and a ball cut off."""

from __future__ import annotations

import re
from itertools import product

HEADER = (
    "ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION((''),'2;1');\n"
    "FILE_NAME('box','2020-01-01T00:00:00',(''),(''),'','','');\n"
    "FILE_SCHEMA(('AUTOMOTIVE_DESIGN'));\nENDSEC;\nDATA;\n"
)
FOOTER = "ENDSEC;\nEND-ISO-10303-21;\n"
#: faces by the corners round them, seen from outside; a corner is x + 2 y + 4 z
FACES = ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5))
NORMALS = ((0, 0, -1), (0, 0, 1), (0, -1, 0), (0, 1, 0), (-1, 0, 0), (1, 0, 0))
NAMES = ("w=0", "w=1", "v=0", "v=1", "u=0", "u=1")


class Writer:
    """Numbers instances as they come."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def add(self, text: str) -> str:
        self.lines.append(f"#{len(self.lines) + 1}={text};")
        return f"#{len(self.lines)}"

    def text(self) -> str:
        return HEADER + "\n".join(self.lines) + "\n" + FOOTER


def triple(values: tuple[float, ...]) -> str:
    return "(" + ",".join(repr(float(x)) for x in values) + ")"


def box(size: tuple[float, float, float] = (1.0, 2.0, 3.0), *, volume: float | None = None) -> str:
    """Return the text of a box with one corner in the origin, in millimetres."""
    out = Writer()
    corners = [tuple(c * s for c, s in zip(reversed(c), size, strict=True))
               for c in product((0, 1), repeat=3)]  # fmt: skip
    points = [out.add(f"CARTESIAN_POINT('',{triple(c)})") for c in corners]
    vertices = [out.add(f"VERTEX_POINT('',{p})") for p in points]
    edges: dict[tuple[int, int], str] = {}
    faces = []
    for loop, normal, name in zip(FACES, NORMALS, NAMES, strict=True):
        uses = []
        for a, b in zip(loop, (*loop[1:], loop[0]), strict=True):
            key = (min(a, b), max(a, b))
            if key not in edges:
                step = tuple(y - x for x, y in zip(corners[key[0]], corners[key[1]], strict=True))
                way = out.add(f"DIRECTION('',{triple(step)})")
                vector = out.add(f"VECTOR('',{way},1.)")
                line = out.add(f"LINE('',{points[key[0]]},{vector})")
                edges[key] = out.add(
                    f"EDGE_CURVE('',{vertices[key[0]]},{vertices[key[1]]},{line},.T.)"
                )
            flag = ".T." if key == (a, b) else ".F."
            uses.append(out.add(f"ORIENTED_EDGE('',*,*,{edges[key]},{flag})"))
        ring = out.add(f"EDGE_LOOP('',({','.join(uses)}))")
        bound = out.add(f"FACE_OUTER_BOUND('',{ring},.T.)")
        axis = out.add(f"DIRECTION('',{triple(normal)})")
        across = out.add(f"DIRECTION('',{triple((normal[1], normal[2], normal[0]))})")
        frame = out.add(f"AXIS2_PLACEMENT_3D('',{points[loop[0]]},{axis},{across})")
        plane = out.add(f"PLANE('',{frame})")
        faces.append(out.add(f"ADVANCED_FACE('{name}',({bound}),{plane},.T.)"))
    shell = out.add(f"CLOSED_SHELL('',({','.join(faces)}))")
    solid = out.add(f"MANIFOLD_SOLID_BREP('box',{shell})")
    _context(out, solid, volume)
    return out.text()


def swollen_box(count: int) -> str:
    """Return a box whose top is a cubic B-spline of count² poles, raised but for its border."""
    text, number = box(), 10_000
    spans = count - 3
    knots = [0.0] * 4 + [k / spans for k in range(1, spans)] + [1.0] * 4
    middles = [sum(knots[k + 1 : k + 4]) / 3.0 for k in range(count)]
    inner = [k not in (0, count - 1) for k in range(count)]
    lines, rows = [], []
    for i, x in enumerate(middles):
        for j, y in enumerate(middles):
            z = 3.0 + 6.4 * x * (1.0 - x) * y * (1.0 - y) * inner[i] * inner[j]
            lines.append(f"#{number + len(lines)}=CARTESIAN_POINT('',{triple((x, 2.0 * y, z))});")
        first = number + i * count
        rows.append("(" + ",".join(f"#{first + j}" for j in range(count)) + ")")
    row = ",".join(map(repr, [0.0, *knots[4:-4], 1.0]))
    often = ",".join(["4", *["1"] * (spans - 1), "4"])
    lines.append(
        f"#9999=B_SPLINE_SURFACE_WITH_KNOTS('',3,3,({','.join(rows)}),.UNSPECIFIED.,.F.,.F.,.F.,"
        f"({often}),({often}),({row}),({row}),.UNSPECIFIED.);"
    )
    text = re.sub(r"(ADVANCED_FACE\('w=1',\(#\d+\),)#\d+", r"\1#9999", text)
    return text.replace(FOOTER, "\n".join(lines) + "\n" + FOOTER)


def cut_ball() -> str:
    """Return a ball of radius 2 without what is beyond x = 1; its faces have one edge, no seam."""
    out = Writer()
    x, z = (out.add(f"DIRECTION('',{triple(d)})") for d in ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
    middle, end, start = (
        out.add(f"CARTESIAN_POINT('',{triple(p)})")
        for p in ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 0.0, 3.0**0.5))
    )
    vertex = out.add(f"VERTEX_POINT('',{start})")
    frame, across = (
        out.add(f"AXIS2_PLACEMENT_3D('',{o},{a},{b})") for o, a, b in ((middle, z, x), (end, x, z))
    )
    circle = out.add(f"CIRCLE('',{across},{3.0**0.5!r})")
    edge = out.add(f"EDGE_CURVE('',{vertex},{vertex},{circle},.T.)")
    faces = []
    for surface, sense in (
        (f"SPHERICAL_SURFACE('',{frame},2.)", "F"),
        (f"PLANE('',{across})", "T"),
    ):
        use = out.add(f"ORIENTED_EDGE('',*,*,{edge},.{sense}.)")
        ring = out.add(f"EDGE_LOOP('',({use}))")
        bound = out.add(f"FACE_BOUND('',{ring},.T.)")
        faces.append(out.add(f"ADVANCED_FACE('',({bound}),{out.add(surface)},.T.)"))
    shell = out.add(f"CLOSED_SHELL('',({','.join(faces)}))")
    _context(out, out.add(f"MANIFOLD_SOLID_BREP('ball',{shell})"), None)
    return out.text()


def _context(out: Writer, solid: str, volume: float | None) -> None:
    metre = out.add("(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.))")
    radian = out.add("(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.))")
    accuracy = out.add(
        f"UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE(1.E-07),{metre},'distance_accuracy_value','')"
    )
    context = out.add(
        "(GEOMETRIC_REPRESENTATION_CONTEXT(3)"
        f"GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT(({accuracy}))"
        f"GLOBAL_UNIT_ASSIGNED_CONTEXT(({metre},{radian}))REPRESENTATION_CONTEXT('',''))"
    )
    out.add(f"ADVANCED_BREP_SHAPE_REPRESENTATION('',({solid}),{context})")
    if volume is not None:
        element = out.add(f"DERIVED_UNIT_ELEMENT({metre},3.)")
        unit = out.add(f"DERIVED_UNIT(({element}))")
        item = out.add(
            "MEASURE_REPRESENTATION_ITEM('volume measure',"
            f"VOLUME_MEASURE({float(volume)!r}),{unit})"
        )
        shape = out.add("PRODUCT_DEFINITION_SHAPE('','',$)")
        define = out.add(f"PROPERTY_DEFINITION('geometric validation property','volume',{shape})")
        stated = out.add(f"REPRESENTATION('volume',({item}),{context})")
        out.add(f"PROPERTY_DEFINITION_REPRESENTATION({define},{stated})")
