"""pc2cad compiles one three-parameter point equation M(u,v,w) into one closed B-rep solid."""

from __future__ import annotations

__version__ = "0.1.0"
