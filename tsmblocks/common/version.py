"""The version of the package, which everything that writes a file may state."""

__version__ = "0.1.0"
