"""pc2cad compiles one three-parameter point equation M(u,v,w) into one closed B-rep solid.

    import pc2cad as pc

    A, B, C, D = pc.points(A=(4, 0, 0), B=(1, 5, 1), C=(-2, -1, 0), D=(1, 1, 6))
    u, v, w = pc.parameters()
    part = pc.compile_part(A*u*v*(1-w) + B*(1-v)*(1-w) + C*(1-u)*v*(1-w) + D*w)
    part.write("pyramid.step")

Names are imported when they are first used, so that ``import pc2cad`` loads no kernel.
"""

# nothing is imported here that Python has not loaded yet: it might come from the current folder
from pc2cad.trust import isolation

if isolation.is_command():
    isolation.forget_current_folder()

from pc2cad.export.version import __version__ as __version__

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any

    from pc2cad.api import *  # noqa: F403
    from pc2cad.compiler import compile_equation as compile_equation
    from pc2cad.compiler import compile_part as compile_part
    from pc2cad.compiler import mesh_part as mesh_part
    from pc2cad.compiler import spline_part as spline_part
    from pc2cad.export.deck import Deck as Deck
    from pc2cad.export.deck import Material as Material
    from pc2cad.export.deck import write_deck as write_deck
    from pc2cad.export.mesh_files import write_mesh as write_mesh
    from pc2cad.export.point_files import write_points as write_points
    from pc2cad.export.spline_files import write_splines as write_splines
    from pc2cad.expression.sympy_bridge import from_sympy as from_sympy
    from pc2cad.expression.sympy_bridge import to_sympy as to_sympy
    from pc2cad.mesh.results import read_results as read_results
    from pc2cad.part import Part as Part
    from pc2cad.studies.adjust import adjust as adjust
    from pc2cad.studies.over_ranges import prove_over as prove_over
    from pc2cad.studies.reach import reach as reach
    from pc2cad.studies.study import study as study
    from pc2cad.templates.file import read_template as read_template
    from pc2cad.templates.importers.airfoil import import_airfoil as import_airfoil
    from pc2cad.templates.importers.kinds import import_template as import_template
    from pc2cad.templates.importers.net import import_points as import_points
    from pc2cad.templates.importers.vmec import import_vmec as import_vmec
    from pc2cad.verify.against import verify_file
    from pc2cad.verify.receipt import receipt as receipt

    verify = verify_file

_HOMES = {
    "Deck": "pc2cad.export.deck",
    "Material": "pc2cad.export.deck",
    "Part": "pc2cad.part",
    "adjust": "pc2cad.studies.adjust",
    "compile_equation": "pc2cad.compiler",
    "compile_part": "pc2cad.compiler",
    "from_sympy": "pc2cad.expression.sympy_bridge",
    "import_airfoil": "pc2cad.templates.importers.airfoil",
    "import_points": "pc2cad.templates.importers.net",
    "import_template": "pc2cad.templates.importers.kinds",
    "import_vmec": "pc2cad.templates.importers.vmec",
    "mesh_part": "pc2cad.compiler",
    "prove_over": "pc2cad.studies.over_ranges",
    "read_results": "pc2cad.mesh.results",
    "read_template": "pc2cad.templates.file",
    "reach": "pc2cad.studies.reach",
    "receipt": "pc2cad.verify.receipt",
    "spline_part": "pc2cad.compiler",
    "study": "pc2cad.studies.study",
    "to_sympy": "pc2cad.expression.sympy_bridge",
    "write_deck": "pc2cad.export.deck",
    "write_mesh": "pc2cad.export.mesh_files",
    "write_points": "pc2cad.export.point_files",
    "write_splines": "pc2cad.export.spline_files",
}


def __getattr__(name: str) -> "Any":
    from importlib import import_module

    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    if name == "verify":  # a room, and a function
        return import_module("pc2cad.verify")
    if name == "__all__":  # what help(pc2cad) shows
        return __dir__()
    if not name.startswith("_"):
        language = import_module("pc2cad.api")
        if name in language.__all__:
            return getattr(language, name)
    raise AttributeError(f"module 'pc2cad' has no attribute '{name}'")


def __dir__() -> list[str]:
    from importlib import import_module

    return sorted(["__version__", "verify", *_HOMES, *import_module("pc2cad.api").__all__])
