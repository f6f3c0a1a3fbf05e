"""Pictures of a part without a display: what to draw, from where, as PNG or SVG.

`drawing` collects what is shown as plain arrays, `image` turns it into a file. VTK, which comes
with CadQuery, is imported when a picture is made.
"""
