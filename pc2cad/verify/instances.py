"""The instances of a STEP file as a replay reads them: NumPy and the standard library alone."""

from __future__ import annotations

import re
from collections import Counter
from typing import Any, Final

import numpy as np

from pc2cad.verify.balls import Array, ReplayError

_CONTEXT: Final = "GLOBAL_UNIT_ASSIGNED_CONTEXT"


class StepText:
    """The instances of a STEP file, read when they are asked for."""

    _INSTANCE = re.compile(r"#(\d+)\s*=\s*((?:[^;']|'[^']*')*);")
    _TOKEN = re.compile(
        r"\s*('(?:[^']|'')*'|#\d+|[+-]?\d+\.?\d*(?:E[+-]?\d+)?|\.\w+\.|\w+|[(),$*])"
    )
    _POINT = re.compile(
        r"(?:CARTESIAN_POINT|DIRECTION)\s*\(\s*'[^']*'\s*,"
        r"\s*\(\s*([^,()]+),([^,()]+),([^,()]+)\)\s*\)\s*"
    )

    def __init__(self, data: bytes) -> None:
        """Take the bytes of a file."""
        text = data.decode("utf-8")
        if "/*" in text:
            raise ReplayError("the file has comments, which are not read here")
        found = self._INSTANCE.findall(text)
        self._texts = {int(key): body for key, body in found}
        if len(found) != len(self._texts):
            raise ReplayError("an instance of the file is there twice")

    def all_of(self, keyword: str) -> list[int]:
        """Return the instances of a keyword."""
        return [key for key, body in self._texts.items() if body.startswith(keyword + "(")]

    def get(self, ref: Any) -> dict[str, list[Any]]:
        """Return the partial entities of an instance, each with its parameters."""
        stack: list[list[Any]] = [[]]
        for token in self._TOKEN.findall(self._texts[int(str(ref).lstrip("#"))]):
            if token == "(":
                stack.append([])
            elif token == ")":
                stack[-2].append(stack.pop())
            elif token != ",":
                stack[-1].append(token)
        (found,) = stack
        found = found[0] if isinstance(found[0], list) else found
        return {word: values for word, values in zip(found[::2], found[1::2], strict=True)}

    def only(self, ref: Any, keyword: str) -> list[Any]:
        """Return the parameters of an instance of a keyword."""
        found = self.get(ref)
        if keyword not in found:
            raise ReplayError(f"{ref} is {'+'.join(found)} where {keyword} is needed")
        return found[keyword]

    def point(self, ref: Any) -> Array:
        """Return a point or a direction."""
        found = self._POINT.fullmatch(self._texts[int(str(ref).lstrip("#"))])
        if found is None:
            raise ReplayError(f"{ref} is no point and no direction with three coordinates")
        return np.array([float(x) for x in found.groups()])

    def frame(self, ref: Any) -> tuple[Array, Array]:
        """Return origin and axes x, y, z of a placement that says all of them."""
        _, origin, axis, along = self.only(ref, "AXIS2_PLACEMENT_3D")
        z, x = self.point(axis), self.point(along)
        z = z / np.linalg.norm(z)
        x = x - (x @ z) * z
        x = x / np.linalg.norm(x)
        return self.point(origin), np.array([x, np.cross(z, x), z])

    def radian(self) -> float:
        """Return the unit of plane angles that all contexts of the file have, in radians."""
        found = set[tuple[Any, ...]]()
        for context in (key for key, body in self._texts.items() if _CONTEXT in body):
            for unit in map(self.get, self.get(context)[_CONTEXT][0]):
                factor, base = 1.0, unit
                if "CONVERSION_BASED_UNIT" in unit:
                    ((_, value, ref),) = self.get(unit["CONVERSION_BASED_UNIT"][1]).values()
                    factor, base = float(value[0]), self.get(ref)
                if "PLANE_ANGLE_UNIT" in unit:
                    found.add((factor, *base["SI_UNIT"]))
        if {own[1:] for own in found} != {("$", ".RADIAN.")} or len(found) != 1:
            raise ReplayError("the file has not one unit of plane angles")
        return float(found.pop()[0])

    def require_closed(self) -> set[int]:
        """Ask every shell for each edge once forward and once reversed; return the faces."""
        faces: set[int] = set()
        for shell in self.all_of("CLOSED_SHELL"):
            uses: Counter[tuple[str, bool]] = Counter()
            for face in self.only(shell, "CLOSED_SHELL")[1]:
                faces.add(int(face[1:]))
                for bound in self.only(face, "ADVANCED_FACE")[1]:
                    ((_, loop, flag),) = self.get(bound).values()
                    for use in self.get(loop).get("EDGE_LOOP", ["", []])[1]:
                        *_, edge, sense = self.only(use, "ORIENTED_EDGE")
                        uses[edge, sense == flag] += 1
            wrong = {edge for edge, _ in uses if (uses[edge, True], uses[edge, False]) != (1, 1)}
            if wrong:
                raise ReplayError(f"the edge {min(wrong)} is not used once in each sense")
        return faces
