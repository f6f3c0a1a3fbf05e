"""How large a part is, where it lies, and what rounding makes of points on it.

Double precision leaves errors that go with the coordinates, the arithmetic of an equation errors
that go with the part as well. Every threshold below which two lengths are one comes from here.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

EPSILON = sys.float_info.epsilon


@dataclass(frozen=True)
class Scale:
    """Size and place of a part; all lengths in model units."""

    #: diagonal of the box round the part
    size: float
    #: largest absolute coordinate
    magnitude: float

    def _ulps(self, count: float) -> float:
        return count * EPSILON * (self.size + self.magnitude)

    @property
    def same_point(self) -> float:
        """Below this distance two values of M are one point: rounding of a few dozen operations."""
        return 1e-12 * self.size + 128 * EPSILON * self.magnitude

    @property
    def sampling_noise(self) -> float:
        """What rounding leaves open of the distance between two values of M."""
        return self._ulps(8)

    @property
    def kernel_noise(self) -> float:
        """What the kernel's own coordinates leave open of a point."""
        return self._ulps(16)

    @property
    def evaluation_noise(self) -> float:
        """What rounding leaves open of a value of M; four of it is the least tolerance."""
        return self._ulps(64)

    @property
    def fitting_noise(self) -> float:
        """What rounding may make of an exact form whose coefficients are found by fitting."""
        return self._ulps(1000)

    @property
    def carrier_noise(self) -> float:
        """What points may be off a carrier that they lie on."""
        return 1e-12 * self.size + self.evaluation_noise

    @property
    def search_noise(self) -> float:
        """How near to a point a place that was searched for has to come."""
        return 1e-10 * self.size + 1000 * EPSILON * self.magnitude

    @property
    def least_tolerance(self) -> float:
        """The smallest distance from the equation that double precision can keep to."""
        return 4 * self.evaluation_noise
