"""What was compared of a face and its side is proved, where that can be had."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace

from pc2cad.bounds.known import Known
from pc2cad.verify.borders import Borders
from pc2cad.verify.faces import JudgedFace
from pc2cad.verify.nearness import nearness
from pc2cad.verify.replay import Quadric, ReplayError, Spline, StepText
from pc2cad.verify.sides import Match, Sides
from pc2cad.verify.splines import SplineSurface
from pc2cad.verify.surfaces import Round


class Proofs:
    """Bounds for faces of one equation; with a text as a replay reads it, for a certificate."""

    def __init__(
        self, sides: Sides, tolerance: float, text: Callable[[], StepText] | None = None
    ) -> None:
        self._sides, self._tolerance, self._text = sides, tolerance, text
        #: faces and edges share models, as those of a build do
        self._known = Known()
        self._borders = Borders(sides, tolerance, self._known)

    def of(self, match: Match) -> Match:
        """Return a match with bounds of its distances, where they can be had."""
        seen = match.surface.distance
        if not seen <= self._tolerance:
            return match
        surface, claims = self._surface(match.face), False
        if self._text is not None:
            with suppress(ReplayError, ValueError, LookupError):
                surface, claims = self._text().surface(f"#{int(match.face.face.ref)}"), True
        if surface is None or (isinstance(surface, Spline) and match.turn is None):
            return match
        patches = [self._sides.trees(patch) for patch in match.patches]
        found = nearness(
            patches, surface, match.turn, seen, self._tolerance, claims=claims, known=self._known
        )
        edges = match.edges if match.trimmed else self._borders.nearness(match)
        return replace(match, nearness=found, edges=edges)

    def _surface(self, judged: JudgedFace) -> Spline | Quadric | None:
        """Return a face's surface for proofs; None where there are none."""
        own = judged.surface
        if isinstance(own, SplineSurface):
            return Spline(own.degrees, own.knots, own.poles)
        if isinstance(own, Round):
            return Quadric(own.kind, (own.origin, own.axes), own.lengths)
        if judged.face.carrier == "PLANE" and judged.frame is not None:
            return Quadric("PLANE", judged.frame, ())
        return None
