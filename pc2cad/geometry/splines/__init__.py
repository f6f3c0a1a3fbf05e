"""Univariate spline spaces, tensor-product fits in them, exact polynomial and rational forms."""
