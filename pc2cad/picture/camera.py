"""Where a picture is seen from: a parallel projection on to pixels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pc2cad.arrays import Array
from pc2cad.errors import InputError

#: direction from the part to the eye
VIEWS: dict[str, tuple[float, float, float]] = {
    "iso": (1.0, -1.0, 0.8),
    "front": (0.0, -1.0, 0.0),
    "back": (0.0, 1.0, 0.0),
    "left": (-1.0, 0.0, 0.0),
    "right": (1.0, 0.0, 0.0),
    "top": (0.0, 0.0, 1.0),
    "bottom": (0.0, 0.0, -1.0),
}
#: share of the picture's width and height that stays free on each side
MARGIN = 0.06


@dataclass(frozen=True, eq=False)
class Camera:
    """Pixels are counted from the upper left corner; depth grows towards the eye."""

    #: unit vectors to the right, upwards and towards the eye, rows
    axes: Array
    #: what is in the middle of the picture
    centre: Array
    #: model units per pixel
    scale: float
    #: width and height in pixels
    size: tuple[int, int]
    #: nearest and farthest depth of what is shown, relative to `centre`
    depths: tuple[float, float]

    def project(self, points: Array) -> tuple[Array, Array]:
        """Return pixels (n, 2) and depths (n,) of points (n, 3)."""
        across, up, depth = ((points - self.centre) @ self.axes.T).T
        width, height = self.size
        pixels = np.column_stack((width / 2 + across / self.scale, height / 2 - up / self.scale))
        return pixels, depth


def aim(
    points: Array,
    direction: tuple[float, float, float],
    size: tuple[int, int],
    right_margin: float = 0.0,
) -> Camera:
    """Return the camera that shows all points, (n, 3), as large as they fit.

    `direction` points to the eye; up is z, or y where one looks along z. `right_margin` is a share
    of the width that is kept free besides. Raises InputError for a direction of no length.
    """
    toward = np.asarray(direction, dtype=float)
    length = float(np.linalg.norm(toward))
    if not 0.0 < length < np.inf:
        raise InputError("the direction of view has no length; give three numbers, not all zero")
    toward = toward / length
    upright = np.array([0.0, 0.0, 1.0] if abs(toward[2]) < 0.999 else [0.0, 1.0, 0.0])
    right = np.cross(upright, toward)
    right /= np.linalg.norm(right)
    axes = np.array([right, np.cross(toward, right), toward])
    seen = points @ axes.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    width, height = size
    room = np.array([width * (1 - 2 * MARGIN - right_margin), height * (1 - 2 * MARGIN)])
    scale = float(max((high - low)[:2] / room)) or 1.0
    middle: Array = (low + high) / 2
    middle[0] += right_margin * width / 2 * scale
    reach = float(high[2] - low[2]) / 2
    return Camera(axes, middle @ axes, scale, size, (-reach, reach))
