"""Make the pictures of README.md and docs/: ``python docs/make_pictures.py``.

Off-screen with VTK, which CadQuery brings along; no display is needed.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import vtk
from vtk.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray

import pc2cad as pc
from pc2cad.mesh.triangles import tessellate
from pc2cad.part import SIDE_COLOURS, Part

FOLDER = Path(__file__).parent / "pictures"
TEMPLATES = Path(__file__).parent.parent / "templates"

#: template -> (values, direction from which it is seen)
PICTURES = {
    "pyramid_cut": ({}, (0.2, -1.5, 1.0)),
    "channel_ellipse": ({}, (1.6, -0.35, 1.0)),
    "channel_sine": ({}, (1.7, -0.25, 0.9)),
    "channel_contour": ({}, (1.6, -0.35, 1.0)),
}


def polydata(part: Part) -> list[tuple[str, vtk.vtkPolyData]]:
    """Return the triangles of each face."""
    mesh = tessellate(part.shape, deflection=part.report.size * 2e-4, angular_deflection=0.06)
    result = []
    for index, name in enumerate(part.faces):
        triangles = mesh.triangles[mesh.faces == index]
        used, renumbered = np.unique(triangles, return_inverse=True)
        data = vtk.vtkPolyData()
        points = vtk.vtkPoints()
        points.SetData(numpy_to_vtk(np.ascontiguousarray(mesh.vertices[used]), deep=True))
        data.SetPoints(points)
        rows = renumbered.reshape(-1, 3)
        cells = np.column_stack((np.full(len(rows), 3), rows)).astype(np.int64)
        array = vtk.vtkCellArray()
        array.ImportLegacyFormat(numpy_to_vtkIdTypeArray(cells.ravel(), deep=True))
        data.SetPolys(array)
        result.append((name, data))
    return result


def actors(name: str, data: vtk.vtkPolyData) -> list[vtk.vtkActor]:
    """Return a shaded face and its outline."""
    normals = vtk.vtkPolyDataNormals()
    normals.SetInputData(data)
    normals.SplittingOff()
    normals.ConsistencyOff()
    mapper = vtk.vtkPolyDataMapper()
    mapper.SetInputConnection(normals.GetOutputPort())
    face = vtk.vtkActor()
    face.SetMapper(mapper)
    colour = SIDE_COLOURS[name[0]][0 if name.endswith("=0") else 1]
    face.GetProperty().SetColor(*colour)
    face.GetProperty().SetSpecular(0.25)
    face.GetProperty().SetSpecularPower(30)
    edges = vtk.vtkFeatureEdges()
    edges.SetInputData(data)
    edges.FeatureEdgesOff()
    edges.ManifoldEdgesOff()
    edges.ColoringOff()
    lines = vtk.vtkPolyDataMapper()
    lines.SetInputConnection(edges.GetOutputPort())
    outline = vtk.vtkActor()
    outline.SetMapper(lines)
    outline.GetProperty().SetColor(0.1, 0.1, 0.1)
    outline.GetProperty().SetLineWidth(2.5)
    return [face, outline]


def render(part: Part, view: tuple[float, float, float], path: Path) -> None:
    """Write a picture of the part, seen from a direction, sides in their own colours."""
    renderer = vtk.vtkRenderer()
    renderer.SetBackground(1, 1, 1)
    for name, data in polydata(part):
        for actor in actors(name, data):
            renderer.AddActor(actor)
    kit = vtk.vtkLightKit()
    kit.SetKeyLightIntensity(0.9)
    kit.AddLightsToRenderer(renderer)
    camera = renderer.GetActiveCamera()
    camera.SetPosition(*view)
    camera.SetFocalPoint(0, 0, 0)
    camera.SetViewUp(0, 0, 1)
    renderer.ResetCamera()
    camera.Zoom(1.7 if part.report.euler == 0 else 1.25)
    window = vtk.vtkRenderWindow()
    window.SetOffScreenRendering(1)
    window.SetMultiSamples(8)
    window.SetSize(960, 640)
    window.AddRenderer(renderer)
    window.Render()
    grab = vtk.vtkWindowToImageFilter()
    grab.SetInput(window)
    writer = vtk.vtkPNGWriter()
    writer.SetFileName(str(path))
    writer.SetInputConnection(grab.GetOutputPort())
    writer.Write()


def main() -> None:
    """Make every picture."""
    FOLDER.mkdir(exist_ok=True)
    for name, (values, view) in PICTURES.items():
        template = pc.read_template(TEMPLATES / f"{name}.toml")
        render(pc.compile_equation(template.bind(values)), view, FOLDER / f"{name}.png")


if __name__ == "__main__":
    main()
