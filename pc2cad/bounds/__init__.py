"""Proved bounds: enclosures of expression trees, and of their distance from splines."""
