"""A STEP file held against itself and against its equation, without the kernel that wrote it.

`receipt` reads a file of anybody's; `verification` holds it against a point equation. Everything is
read and computed here, from the file's own text: no module that makes such files is imported.

The room is called like what it does, and can be called: ``pc.verify("part.step", "part.toml")``.
"""

from __future__ import annotations

import sys
from types import ModuleType
from typing import Any


class _Verify(ModuleType):
    """The package `pc2cad.verify`, as the function `verify_file`."""

    def __call__(self, *args: Any, **options: Any) -> dict[str, Any]:
        """Hold a STEP file against a template: see `pc2cad.verify.against.verify_file`."""
        from pc2cad.verify.against import verify_file

        return verify_file(*args, **options)


sys.modules[__name__].__class__ = _Verify
