"""pc2cad compiles one three-parameter point equation M(u,v,w) into one closed B-rep solid.

    import pc2cad as pc

    A, B, C, D = pc.points(A=(4, 0, 0), B=(1, 5, 1), C=(-2, -1, 0), D=(1, 1, 6))
    u, v, w = pc.parameters()
    part = pc.compile_part(A*u*v*(1-w) + B*(1-v)*(1-w) + C*(1-u)*v*(1-w) + D*w)
    part.write("pyramid.step")

Names are imported when they are first used, so that ``import pc2cad`` loads no kernel.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from pc2cad.compiler import compile_equation, compile_part
    from pc2cad.equation.template_file import read_template
    from pc2cad.part import Part
    from pc2cad.python import (
        acos,
        acosh,
        asin,
        asinh,
        atan,
        atan2,
        atanh,
        contour,
        cos,
        cosh,
        cross,
        det,
        diff,
        distance,
        dot,
        e,
        exit_from_plane,
        exp,
        length,
        log,
        metric,
        parameters,
        pi,
        point,
        points,
        sin,
        sine_wave,
        sinh,
        sqrt,
        tan,
        tanh,
        translate,
        unit,
        vector,
    )

#: public name -> module that holds it
_HOMES = {
    "Part": "pc2cad.part",
    "compile_equation": "pc2cad.compiler",
    "compile_part": "pc2cad.compiler",
    "read_template": "pc2cad.equation.template_file",
    **dict.fromkeys(
        (
            "acos acosh asin asinh atan atan2 atanh contour cos cosh cross det diff distance dot e "
            "exit_from_plane exp length log metric parameters pi point points sin sine_wave sinh "
            "sqrt tan tanh translate unit vector"
        ).split(),
        "pc2cad.python",
    ),
}

__all__ = ["__version__", *_HOMES]  # noqa: PLE0604


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'pc2cad' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted(__all__)
