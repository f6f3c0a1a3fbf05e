"""How near the kernel takes points for one: known without the kernel, too."""

from __future__ import annotations

from typing import Final

#: points that are no farther apart are one for the kernel (``Precision::Confusion``), and a tenth
#: of that, which proofs about its shapes may leave
KERNEL_TOLERANCE: Final = 1e-7
WELL_WITHIN: Final = KERNEL_TOLERANCE / 10
