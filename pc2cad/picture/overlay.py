"""What lies over the pixels: names with leaders and the colour scale, as plain shapes."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from pc2cad.arrays import Array
from pc2cad.picture.camera import Camera
from pc2cad.picture.scene import GREY, INK, Bar, Colour, Label

TEXT_HEIGHT = 17
#: average width of a letter as a share of its height
LETTER = 0.56
#: share of the picture's width that a colour scale takes
BAR_SHARE = 0.2
#: places that are tried for the name of a face that is seen, and of one that is hidden
TRIES, TRIES_BEHIND = 10, 6
#: pixels that a line may lie behind the face on which it is drawn
HIDDEN = 3.0


@dataclass(frozen=True)
class Text:
    """A line of text; (x, y) is the left end of its middle, in pixels."""

    text: str
    x: float
    y: float
    colour: Colour
    halo: bool = False

    @property
    def width(self) -> float:
        """Width in pixels, about."""
        return LETTER * TEXT_HEIGHT * len(self.text)


@dataclass(frozen=True)
class Stroke:
    """A straight line in pixels."""

    start: tuple[float, float]
    end: tuple[float, float]
    colour: Colour
    dot: bool = False


@dataclass(frozen=True)
class Box:
    """A filled rectangle: left, top, width, height in pixels."""

    box: tuple[float, float, float, float]
    colour: Colour


Shape = Text | Stroke | Box


def visible(pixels: Array, depth: Array, seen: Array, scale: float) -> Array:
    """Return which places (n, 2) at some depths (n,) are not hidden, (n,) of bool.

    `seen` is the depth at each pixel. The farthest of the neighbouring pixels counts, because a
    place at an outline falls on either side of it.
    """
    result: Array = depth >= _around(pixels, seen, 1).min(axis=0) - HIDDEN * scale
    return result


def _in_the_open(pixels: Array, depth: Array, seen: Array, scale: float) -> Array:
    """Return which places (n, 2) are seen and lie nowhere near an outline, (n,) of bool."""
    around = _around(pixels, seen, 3)
    near, far = around.max(axis=0), around.min(axis=0)
    result: Array = (depth >= near - 4 * HIDDEN * scale) & (depth <= far + 4 * HIDDEN * scale)
    return result


def _around(pixels: Array, seen: Array, reach: int) -> Array:
    """Return the depths of the pixels round some places, (pixels, n)."""
    height, width = seen.shape
    column = np.clip(pixels[:, 0].astype(int), reach, width - 1 - reach)
    row = np.clip(pixels[:, 1].astype(int), reach, height - 1 - reach)
    steps = range(-reach, reach + 1)
    return np.stack([seen[row + i, column + j] for i in steps for j in steps])


def overlay(
    labels: tuple[Label, ...], bar: Bar | None, camera: Camera, seen: Array | None
) -> list[Shape]:
    """Return the shapes of names and colour scale; `seen` is the depth at each pixel.

    Faces that are seen are named first. Where there is no room for all of these, what belongs
    together is named once, ``w=1 (12 faces)``; what finds no room even so is counted instead.
    """
    shapes, (left_out, behind) = _arranged(labels, camera, seen)
    if left_out and (merged := _merged(labels)) != labels:
        shapes, (left_out, behind) = _arranged(merged, camera, seen)
    if left_out or behind:
        shapes.append(_without_room([left_out, behind], camera))
    return shapes + (_scale(bar, camera) if bar is not None else [])


def _merged(labels: tuple[Label, ...]) -> tuple[Label, ...]:
    """Return one label for all that belong together, in the place of their first."""
    groups: dict[str, list[Label]] = {}
    for label in labels:
        groups.setdefault(label.whole or label.text, []).append(label)
    return tuple(
        group[0] if len(group) == 1 else
        replace(group[0], text=f"{whole} ({len(group)} faces)",
                places=np.concatenate([label.places for label in group]))
        for whole, group in groups.items()
    )  # fmt: skip


def _arranged(
    labels: tuple[Label, ...], camera: Camera, seen: Array | None
) -> tuple[list[Shape], tuple[int, int]]:
    """Return names beside their places, and how many of seen and hidden ones found no room."""
    placed: list[tuple[bool, Text, float, float]] = []
    for label in labels:
        pixels, depth = camera.project(label.places)
        shown = np.ones(len(pixels), dtype=bool)
        if seen is not None:
            shown = _in_the_open(pixels, depth, seen, camera.scale)
            if not shown.any():
                # a narrow face is all outline; of a hidden one only the rim seems to be seen
                narrow = visible(pixels, depth, seen, camera.scale)
                shown = narrow if narrow.mean() > 0.25 else shown
        hidden = not shown.any()
        candidates = pixels if hidden else pixels[shown]
        middle = candidates.mean(axis=0)
        x, y = candidates[np.argmin(np.linalg.norm(candidates - middle, axis=1))]
        text = f"{label.text} (behind)" if hidden else label.text
        name = Text(text, 0, 0, GREY if hidden else label.colour, halo=True)
        placed.append((hidden, name, float(x), float(y)))
    room = _Room(camera, seen)
    shapes: list[Shape] = []
    left_out = [0, 0]
    for hidden, name, x, y in sorted(placed, key=lambda each: each[0]):
        found = room.named(name, x, y, TRIES_BEHIND if hidden else TRIES)
        left_out[hidden] += not found
        shapes += found
    return shapes, (left_out[0], left_out[1])


def _without_room(left_out: list[int], camera: Camera) -> Text:
    """Return the line that says how many names are not there."""
    kinds = zip(left_out, ("seen", "behind"), strict=True)
    counts = " and ".join(f"{count} {kind}" for count, kind in kinds if count)
    text = f"no room for the names of {counts}"
    return Text(text, 8, camera.size[1] - TEXT_HEIGHT, GREY, halo=True)


class _Room:
    """Where names may still stand in a picture: not upon one another, and beside the part first."""

    def __init__(self, camera: Camera, seen: Array | None) -> None:
        self._size = camera.size
        self._taken: list[tuple[float, float, float]] = []
        covered = np.zeros(camera.size[::-1]) if seen is None else seen > seen.min()
        sums = np.cumsum(np.cumsum(covered, axis=0, dtype=np.int64), axis=1)
        self._covered = np.pad(sums, ((1, 0), (1, 0)))

    def named(self, name: Text, x: float, y: float, tries: int) -> list[Shape]:
        """Return a text beside its place with a leader; none where there is no room."""
        places = [place for place in self._places(name, x, y, tries) if self._free(name, *place)]
        if not places:
            return []
        left, top = min(places, key=lambda place: self._hides(name, *place))  # the first of equals
        self._taken.append((left, left + name.width, top))
        near = min(max(x, left), left + name.width)
        leader = Stroke((x, y), (near, top), name.colour, dot=True)
        return [leader, replace(name, x=left, y=top)]

    def _places(self, name: Text, x: float, y: float, tries: int) -> Iterator[tuple[float, float]]:
        """Yield left ends: up and down in turn, further out each time."""
        width, height = self._size
        right, left_of = x + 26, x - 26 - name.width
        sides = (right, left_of) if x >= width / 2 else (left_of, right)
        for step, left in product(range(tries), sides):
            down = (1 if step % 2 else -1) * (20 + 0.6 * TEXT_HEIGHT * (step // 2))
            if 4 <= left <= width - name.width - 4:
                yield left, min(max(y + down, TEXT_HEIGHT), height - TEXT_HEIGHT)

    def _free(self, name: Text, left: float, top: float) -> bool:
        return all(
            abs(top - other) > 1.2 * TEXT_HEIGHT or left > end or left + name.width < start
            for start, end, other in self._taken
        )

    def _hides(self, name: Text, left: float, top: float) -> bool:
        """Say whether a name would lie over the part."""
        a, b = int(left), int(left + name.width)
        c, d = int(top - TEXT_HEIGHT / 2), int(top + TEXT_HEIGHT / 2)
        sums = self._covered
        return bool(sums[d, b] - sums[c, b] - sums[d, a] + sums[c, a])


def _scale(bar: Bar, camera: Camera) -> list[Shape]:
    """Return the colour scale at the right: boxes, ticks and its title."""
    width, height = camera.size
    left, top = width * (1 - BAR_SHARE) + 10, 0.16 * height
    long = 0.7 * height
    colours = bar.colours if bar.high > bar.low else bar.colours[[len(bar.colours) // 2]]
    step = long / len(colours)
    shapes: list[Shape] = [
        Box((left, top + long - (i + 1) * step, 22, step + 0.5), (float(r), float(g), float(b)))
        for i, (r, g, b) in enumerate(colours)
    ]
    for value in ticks(bar.low, bar.high):
        share = (value - bar.low) / (bar.high - bar.low) if bar.high > bar.low else 0.5
        y = top + long * (1 - share)
        shapes.append(Stroke((left + 22, y), (left + 28, y), INK))
        shapes.append(Text(f"{value:.6g}", left + 33, y, INK))
    title = Text(bar.title, 0, 0, INK)
    shapes.append(Text(bar.title, min(left, width - title.width - 8), top - 28, INK))
    return shapes


def ticks(low: float, high: float) -> list[float]:
    """Return round numbers within low…high, and that one number where they are equal."""
    if not high > low:
        return [low]
    raw = (high - low) / 6
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(power * f for f in (1, 2, 5, 10) if power * f >= raw)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [round(n * step, 15 - math.floor(math.log10(step)) - 2) for n in range(first, last + 1)]
