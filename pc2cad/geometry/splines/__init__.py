"""The splines room."""
