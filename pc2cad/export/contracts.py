"""The modules of the registries, held by the type checker against their contracts.

Nothing imports this module: a format whose function has another signature fails `mypy` here. Kept
apart from the registries, so that those and their formats do not import one another.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pc2cad.export import (
        brep,
        gismo,
        glb,
        gmsh_mesh,
        gotools,
        iges,
        inp,
        irit,
        med,
        mfem,
        step,
        stl,
        stl_text,
        threemf,
        vtk_legacy,
        vtp,
        vtu,
    )
    from pc2cad.export.mesh_files import MeshModule
    from pc2cad.export.registry import SolidModule
    from pc2cad.export.spline_files import FieldModule, SplineModule

    SOLIDS: tuple[SolidModule, ...] = (step, brep, iges, stl, stl_text, threemf, glb, vtp)
    MESHES: tuple[MeshModule, ...] = (vtu, inp, gmsh_mesh, vtk_legacy, med)
    FIELDS: tuple[FieldModule, ...] = (gismo, mfem)
    SPLINES: tuple[SplineModule, ...] = (gismo, mfem, irit, gotools)
