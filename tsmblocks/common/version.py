"""The version of the package, for files that state it."""

__version__ = "0.1.0"
