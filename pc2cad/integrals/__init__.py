"""The integrals room."""
