"""Scenarios that are shipped with the testbed."""

from pathlib import Path
from typing import Final

SHIPPED: Final = Path(__file__).parents[1] / "scenarios"


def shipped_names() -> list[str]:
    """Return the names of the shipped scenarios."""
    return sorted(path.stem for path in SHIPPED.glob("*.yaml"))
