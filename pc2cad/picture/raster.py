"""Pixels of a scene by VTK, off-screen: colours, and the depth that decides what is hidden."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from typing import Any

import numpy as np

from pc2cad.arrays import AnyArray, Array, Integers, Pixels
from pc2cad.errors import KernelError
from pc2cad.picture.camera import Camera
from pc2cad.picture.scene import Cloud, Lines, Scene, Surface

#: pixels by which lines are nearer to the eye than the faces that they lie on
LIFT = 1.5
#: a picture is drawn so many times larger and averaged: the same on every machine
SMOOTHING = 2


class NoRendererError(KernelError):
    """VTK finds no way to draw off-screen."""


def colours(scene: Scene, camera: Camera, with_lines: bool = True) -> Pixels:
    """Return the picture, (height, width, 3); raise NoRendererError where VTK cannot draw."""
    larger = replace(
        camera,
        scale=camera.scale / SMOOTHING,
        size=(SMOOTHING * camera.size[0], SMOOTHING * camera.size[1]),
    )
    window = _window(scene, larger, with_lines, SMOOTHING)
    pixels = _grab(window, depth=False).astype(np.float32)
    height, width = larger.size[1] // SMOOTHING, larger.size[0] // SMOOTHING
    blocks = pixels.reshape(height, SMOOTHING, width, SMOOTHING, 3)
    result: Pixels = (blocks.mean(axis=(1, 3)) + 0.5).astype(np.uint8)
    return result


def depths(scene: Scene, camera: Camera) -> Array:
    """Return the depth of what is seen at each pixel, (height, width), as `Camera.project`."""
    window = _window(scene, camera, with_lines=False, factor=1)
    share = _grab(window, depth=True)[..., 0]
    near, far = _range(camera)
    # a parallel projection has an even depth buffer: 0 is near, 1 is far
    return near + share * (far - near)


def polydata(points: Array, triangles: Integers | None = None) -> Any:
    """Return a vtkPolyData of points, (n, 3), and triangles, (m, 3)."""
    from vtkmodules.util.numpy_support import numpy_to_vtkIdTypeArray
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData

    vtk_points = vtkPoints()
    vtk_points.SetData(array(points))
    data = vtkPolyData()
    data.SetPoints(vtk_points)
    cells = vtkCellArray()
    if triangles is not None:
        corners = np.ascontiguousarray(triangles, dtype=np.int64)
        cells.SetData(3, numpy_to_vtkIdTypeArray(corners.ravel(), deep=True))
        data.SetPolys(cells)
    return data


def array(values: AnyArray) -> Any:
    """Return a VTK array with a copy of the values."""
    from vtkmodules.util.numpy_support import numpy_to_vtk

    return numpy_to_vtk(np.ascontiguousarray(values), deep=True)


def png(pixels: Pixels) -> bytes:
    """Return the PNG file of a picture, (height, width, 3)."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonDataModel import vtkImageData
    from vtkmodules.vtkIOImage import vtkPNGWriter

    height, width = pixels.shape[:2]
    image = vtkImageData()
    image.SetDimensions(width, height, 1)
    image.GetPointData().SetScalars(array(pixels[::-1].reshape(-1, 3)))
    writer = vtkPNGWriter()
    writer.SetInputData(image)
    writer.WriteToMemoryOn()
    writer.Write()
    return bytes(vtk_to_numpy(writer.GetResult()).tobytes())


def _window(scene: Scene, camera: Camera, with_lines: bool, factor: int) -> Any:
    from vtkmodules.vtkRenderingCore import vtkRenderer

    renderer = vtkRenderer()
    renderer.SetBackground(1, 1, 1)
    for surface in scene.surfaces:
        renderer.AddActor(_surface_actor(surface))
    for cloud in scene.clouds:
        renderer.AddActor(_cloud_actor(cloud, factor))
    for lines in scene.lines if with_lines else ():
        renderer.AddActor(_lines_actor(lines, camera, factor))
    _light(renderer)
    _aim(renderer, camera)
    window = _off_screen()
    window.SetMultiSamples(0)
    window.SetSize(*camera.size)
    window.AddRenderer(renderer)
    window.Render()
    return window


def _off_screen() -> Any:
    """Return a window without a display: EGL, else OSMesa, else whatever VTK has here."""
    backend = import_module("vtkmodules.vtkRenderingOpenGL2")

    for name in ("vtkEGLRenderWindow", "vtkOSOpenGLRenderWindow", "vtkOpenGLRenderWindow"):
        kind = getattr(backend, name, None)
        if kind is None:
            continue
        window = kind()
        window.SetOffScreenRendering(1)
        window.SetShowWindow(False)
        if window.SupportsOpenGL():
            return window
    raise NoRendererError(
        "VTK finds neither EGL nor OSMesa to draw without a display; on Debian or Ubuntu: "
        "apt-get install libegl1 libgl1-mesa-dri"
    )


def _surface_actor(surface: Surface) -> Any:
    data = polydata(surface.points, surface.triangles)
    data.GetPointData().SetNormals(array(surface.normals))
    actor = _actor(data, surface.colour)
    look = actor.GetProperty()
    look.SetOpacity(surface.opacity)
    mapped = isinstance(surface.colour, np.ndarray)  # colours that say something stay as they are
    look.SetAmbient(0.5 if mapped else 0.12)
    look.SetDiffuse(0.5 if mapped else 0.88)
    look.SetSpecular(0.0 if mapped else 0.18)
    look.SetSpecularPower(30)
    return actor


def _cloud_actor(cloud: Cloud, factor: int) -> Any:
    from vtkmodules.util.numpy_support import numpy_to_vtkIdTypeArray
    from vtkmodules.vtkCommonDataModel import vtkCellArray

    data = polydata(cloud.points)
    cells = vtkCellArray()
    cells.SetData(1, numpy_to_vtkIdTypeArray(np.arange(len(cloud.points)), deep=True))
    data.SetVerts(cells)
    actor = _actor(data, cloud.colours)
    actor.GetProperty().SetPointSize(factor * cloud.width)
    actor.GetProperty().LightingOff()
    return actor


def _lines_actor(lines: Lines, camera: Camera, factor: int) -> Any:
    from vtkmodules.util.numpy_support import numpy_to_vtkIdTypeArray
    from vtkmodules.vtkCommonDataModel import vtkCellArray

    lift = LIFT * factor * camera.scale * camera.axes[2]
    lengths = np.array([len(path) for path in lines.paths], dtype=np.int64)
    data = polydata(np.concatenate(lines.paths) + lift if len(lengths) else np.zeros((0, 3)))
    cells = vtkCellArray()
    starts = np.concatenate(([0], np.cumsum(lengths))).astype(np.int64)
    numbers = np.arange(starts[-1], dtype=np.int64)
    cells.SetData(
        numpy_to_vtkIdTypeArray(starts, deep=True), numpy_to_vtkIdTypeArray(numbers, deep=True)
    )
    data.SetLines(cells)
    actor = _actor(data, lines.colour)
    actor.GetProperty().SetLineWidth(factor * lines.width)
    actor.GetProperty().LightingOff()
    return actor


def _actor(data: Any, colour: Any) -> Any:
    from vtkmodules.vtkRenderingCore import vtkActor, vtkPolyDataMapper

    mapper = vtkPolyDataMapper()
    actor = vtkActor()
    if isinstance(colour, np.ndarray):
        data.GetPointData().SetScalars(array((255 * colour + 0.5).astype(np.uint8)))
    else:
        mapper.ScalarVisibilityOff()
        actor.GetProperty().SetColor(*colour)
    mapper.SetInputData(data)
    actor.SetMapper(mapper)
    return actor


def _light(renderer: Any) -> None:
    from vtkmodules.vtkRenderingCore import vtkLightKit

    kit = vtkLightKit()
    kit.SetKeyLightIntensity(0.75)
    kit.SetKeyToFillRatio(2.0)
    kit.SetKeyToHeadRatio(1.6)
    kit.AddLightsToRenderer(renderer)


def _range(camera: Camera) -> tuple[float, float]:
    """Return the depths of the near and the far plane: what is shown, and some air."""
    far, near = camera.depths
    air = 0.05 * (near - far) + 20 * camera.scale
    return near + air, far - air


def _aim(renderer: Any, camera: Camera) -> None:
    near, far = _range(camera)
    toward = camera.axes[2]
    eye = camera.centre + (2 * near - far) * toward
    view = renderer.GetActiveCamera()
    view.ParallelProjectionOn()
    view.SetFocalPoint(*camera.centre)
    view.SetPosition(*eye)
    view.SetViewUp(*camera.axes[1])
    view.SetParallelScale(camera.size[1] * camera.scale / 2)
    distance = 2 * near - far
    view.SetClippingRange(distance - near, distance - far)


def _grab(window: Any, depth: bool) -> AnyArray:
    """Return what the window shows, (height, width, channels), upper row first."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkRenderingCore import vtkWindowToImageFilter

    grab = vtkWindowToImageFilter()
    grab.SetInput(window)
    grab.ShouldRerenderOff()
    if depth:
        grab.SetInputBufferTypeToZBuffer()
    grab.Update()
    image = grab.GetOutput()
    width, height, _ = image.GetDimensions()
    values = vtk_to_numpy(image.GetPointData().GetScalars())
    result: AnyArray = values.reshape(height, width, -1)[::-1].copy()
    window.Finalize()
    return result
