"""The templates room."""
