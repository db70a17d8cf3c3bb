"""The version of this package, where finding it takes no time; that of `pyproject.toml`."""

VERSION = "0.1.0"
