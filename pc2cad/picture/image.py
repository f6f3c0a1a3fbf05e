"""Scenes as files: PNG, and SVG with shading as pixels and lines and names as vectors."""

from __future__ import annotations

import base64
import os
from dataclasses import fields
from importlib import import_module
from typing import Any
from xml.sax.saxutils import escape

import numpy as np

from pc2cad.arrays import Array, Pixels
from pc2cad.errors import InputError, PointCadError
from pc2cad.export.files import by_ending, write_atomically
from pc2cad.part import Part
from pc2cad.picture import raster
from pc2cad.picture.camera import VIEWS, Camera, aim
from pc2cad.picture.drawing import drawing
from pc2cad.picture.overlay import (
    BAR_SHARE,
    TEXT_HEIGHT,
    Box,
    Shape,
    Stroke,
    Text,
    overlay,
    visible,
)
from pc2cad.picture.scene import Colour, Lines, Scene
from pc2cad.picture.style import VECTOR, Style, check_ending

SIZE = (960, 640)
#: sides of a picture in pixels
SIZE_LIMITS = (64, 8192)


def camera_for(
    scene: Scene, direction: tuple[float, float, float], size: tuple[int, int] = SIZE
) -> Camera:
    """Return the camera that shows the whole scene from a direction; raise InputError."""
    low, high = SIZE_LIMITS
    if not all(low <= side <= high for side in size):
        raise InputError(f"a picture has sides of {low} to {high} pixels, not {size[0]}x{size[1]}")
    return aim(scene.extent(), direction, size, BAR_SHARE if scene.bar is not None else 0.0)


def encode(scene: Scene, camera: Camera, path: str | os.PathLike[str]) -> bytes:
    """Return the picture as a file of the kind that the ending of `path` stands for.

    Raises InputError for an unknown ending, NoRendererError where VTK cannot draw.
    """
    check_ending(path)
    vector = by_ending(path, VECTOR, "picture")
    need_depth = bool(scene.labels) or vector
    seen = raster.depths(scene, camera) if need_depth else None
    shapes = overlay(scene.labels, scene.bar, camera, seen)
    if vector:
        pixels = raster.colours(scene, camera, with_lines=False)
        return svg(pixels, _seen_lines(scene, camera, seen), shapes)  # type: ignore[arg-type]
    return raster.png(_stamped(raster.colours(scene, camera), shapes))


def picture_of(
    part: Part,
    path: str | os.PathLike[str],
    *,
    view: str | tuple[float, float, float] = "iso",
    size: tuple[int, int] = SIZE,
    **style: Any,
) -> bytes:
    """Return a picture of a part; see `Part.render`. Raises InputError, NoRendererError."""
    check_ending(path)
    unknown = sorted(set(style) - {field.name for field in fields(Style)})
    if unknown:
        raise InputError(
            f"a picture has no '{unknown[0]}'; it has "
            f"{', '.join(field.name for field in fields(Style))}"
        )
    if isinstance(view, str) and view not in VIEWS:
        raise InputError(f"'{view[:40]}' is no view; there are {', '.join(VIEWS)}, or (x, y, z)")
    scene = drawing(part, Style(**style))
    direction = VIEWS[view] if isinstance(view, str) else view
    return encode(scene, camera_for(scene, direction, size), path)


def notebook_picture(part: Part) -> bytes | None:
    """Return the PNG of a part that a notebook shows; None where nothing can draw."""
    try:
        return picture_of(part, "part.png", size=(640, 480))
    except PointCadError:
        return None


def write_picture(scene: Scene, camera: Camera, path: str | os.PathLike[str]) -> None:
    """Write the picture, whole or not at all; raise FileNotWrittenError besides."""
    write_atomically(path, encode(scene, camera, path))


def _seen_lines(scene: Scene, camera: Camera, seen: Array) -> list[tuple[Array, Lines]]:
    """Return the parts of all lines that are not hidden, in pixels."""
    result = []
    for lines in scene.lines:
        for path in lines.paths:
            pixels, depth = camera.project(_fine(path, camera))
            shown = visible(pixels, depth, seen, camera.scale).astype(bool)
            edges = np.flatnonzero(np.diff(np.concatenate(([0], shown.astype(int), [0]))))
            for start, end in edges.reshape(-1, 2):
                if end - start > 1:
                    result.append((_thinned(pixels[start:end]), lines))
    return result


def _fine(path: Array, camera: Camera) -> Array:
    """Return the polyline with a point every three pixels, so that hidden parts are found."""
    pixels, _ = camera.project(path)
    steps = np.maximum(np.ceil(np.linalg.norm(np.diff(pixels, axis=0), axis=1) / 3), 1).astype(int)
    pieces = [
        a + (b - a) * (np.arange(n) / n)[:, None]
        for a, b, n in zip(path[:-1], path[1:], steps, strict=True)
    ]
    return np.concatenate([*pieces, path[-1:]])


def _thinned(pixels: Array) -> Array:
    """Leave out points in a straight run, to a tenth of a pixel."""
    keep = [0]
    for i in range(1, len(pixels) - 1):
        chord = pixels[i + 1] - pixels[keep[-1]]
        between = pixels[keep[-1] + 1 : i + 1] - pixels[keep[-1]]
        away = np.abs(between[:, 0] * chord[1] - between[:, 1] * chord[0])
        if float(away.max()) > 0.1 * float(np.linalg.norm(chord)):
            keep.append(i)
    return pixels[[*keep, len(pixels) - 1]]


def svg(pixels: Pixels, lines: list[tuple[Array, Lines]], shapes: list[Shape]) -> bytes:
    """Return an SVG file: pixels, (height, width, 3), under lines and shapes."""
    height, width = pixels.shape[:2]
    picture = base64.b64encode(raster.png(pixels)).decode()
    rows = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" '
        f'viewBox="0 0 {width} {height}" font-family="Arial, Helvetica, sans-serif" '
        f'font-size="{TEXT_HEIGHT}">',
        f'<image width="{width}" height="{height}" href="data:image/png;base64,{picture}"/>',
        '<g fill="none" stroke-linejoin="round" stroke-linecap="round">',
    ]
    for path, style in lines:
        points = " ".join(f"{x:.1f},{y:.1f}" for x, y in path)
        rows.append(
            f'<polyline stroke="{_hex(style.colour)}" stroke-width="{style.width:g}" '
            f'points="{points}"/>'
        )
    rows.append("</g>")
    rows += [_element(shape) for shape in shapes]
    return ("\n".join([*rows, "</svg>"]) + "\n").encode()


def _element(shape: Shape) -> str:
    colour = _hex(shape.colour)
    if isinstance(shape, Box):
        x, y, w, h = shape.box
        return f'<rect x="{x:.1f}" y="{y:.1f}" width="{w:.1f}" height="{h:.1f}" fill="{colour}"/>'
    if isinstance(shape, Stroke):
        (x, y), (a, b) = shape.start, shape.end
        line = f'<path d="M{x:.1f} {y:.1f}L{a:.1f} {b:.1f}" stroke="{colour}"/>'
        return line + (f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3" fill="{colour}"/>'
                       if shape.dot else "")  # fmt: skip
    halo = ' stroke="#fff" stroke-width="4" paint-order="stroke"' if shape.halo else ""
    return (
        f'<text x="{shape.x:.1f}" y="{shape.y:.1f}" dy="0.35em" fill="{colour}"{halo}>'
        f"{escape(shape.text)}</text>"
    )


def _hex(colour: Colour) -> str:
    return "#" + "".join(f"{round(255 * part):02x}" for part in colour)


def _stamped(pixels: Pixels, shapes: list[Shape]) -> Pixels:
    """Return the picture with the shapes drawn into it."""
    result = pixels.copy()
    for shape in shapes:
        if isinstance(shape, Box):
            _fill(result, shape)
        elif isinstance(shape, Stroke):
            _draw(result, shape)
    for shape in shapes:
        if isinstance(shape, Text):
            _write(result, shape)
    return result


def _fill(pixels: Pixels, shape: Box) -> None:
    x, y, w, h = shape.box
    pixels[round(y) : round(y + h), round(x) : round(x + w)] = _bytes(shape.colour)


def _draw(pixels: Pixels, stroke: Stroke) -> None:
    start, end = np.array(stroke.start), np.array(stroke.end)
    count = int(2 * np.linalg.norm(end - start)) + 2
    places = start + (end - start) * np.linspace(0.0, 1.0, count)[:, None]
    if stroke.dot:
        around = np.mgrid[-3:4, -3:4].reshape(2, -1).T
        places = np.concatenate((places, start + around[np.hypot(*around.T) <= 3]))
    height, width = pixels.shape[:2]
    column = np.clip(places[:, 0].astype(int), 0, width - 1)
    row = np.clip(places[:, 1].astype(int), 0, height - 1)
    pixels[row, column] = _bytes(stroke.colour)


def _write(pixels: Pixels, text: Text) -> None:
    """Blend a text in: VTK's letters give the ink, their surroundings the halo."""
    ink = _letters(text.text)
    height, width = ink.shape
    top, left = round(text.y - height / 2), round(text.x)
    rows, columns = slice(max(top, 0), top + height), slice(max(left, 0), left + width)
    target = pixels[rows, columns]
    ink = ink[max(-top, 0) :, max(-left, 0) :][: target.shape[0], : target.shape[1], None]
    base = target.astype(float)
    if text.halo:
        wide = np.max([np.roll(ink, (i, j), (0, 1)) for i in (-2, -1, 0, 1, 2)
                       for j in (-2, -1, 0, 1, 2)], axis=0)  # fmt: skip
        base = base + (255.0 - base) * wide
    colour = np.array(_bytes(text.colour), dtype=float)
    target[:] = (base + (colour - base) * ink + 0.5).astype(np.uint8)


def _letters(text: str) -> Array:
    """Return how much ink is at each pixel of a text, (height, width) in 0…1, with a border."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonDataModel import vtkImageData
    from vtkmodules.vtkRenderingCore import vtkTextProperty, vtkTextRenderer

    import_module("vtkmodules.vtkRenderingFreeType")  # brings the letters
    style = vtkTextProperty()
    style.SetFontSize(TEXT_HEIGHT)
    style.SetFontFamilyToArial()
    style.SetColor(0.0, 0.0, 0.0)
    image = vtkImageData()
    renderer: Any = vtkTextRenderer.GetInstance()
    size = [0, 0]
    renderer.RenderString(style, text, image, size, 72)
    width, height, _ = image.GetDimensions()
    values = vtk_to_numpy(image.GetPointData().GetScalars()).reshape(height, width, -1)
    ink: Array = values[::-1, :, 3].astype(float) / 255.0
    used = np.argwhere(ink > 0)
    if not len(used):
        return np.zeros((1, 1))
    (top, left), (bottom, right) = used.min(axis=0), used.max(axis=0) + 1
    return np.pad(ink[top:bottom, left:right], 3)


def _bytes(colour: Colour) -> tuple[int, int, int]:
    red, green, blue = (round(255 * part) for part in colour)
    return red, green, blue
