"""The version of the testbed and of the library that carries its messages."""

from importlib.metadata import version


def version_text() -> str:
    """Return both versions, as `tis --version` prints them."""
    return f"tis {version('tis-testbed')}, eclipse-zenoh {version('eclipse-zenoh')}"
