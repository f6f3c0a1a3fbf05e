"""The csg room."""
