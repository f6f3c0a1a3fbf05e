"""The version of pc2cad, as files name who wrote them."""

__version__ = "0.2.0"
