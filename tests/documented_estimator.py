"""The estimator of examples/, and the commands of its tutorial: what readers have is what tests run."""

import re
from pathlib import Path

_ROOT = Path(__file__).resolve().parents[1]
DOCUMENT = _ROOT / "docs" / "tutorials" / "own_estimator.md"
NAME = "my_filter:AlphaBeta"
FILE = "my_filter.py"


def documented_estimator() -> str:
    """Return the text of the module."""
    return (_ROOT / "examples" / FILE).read_text(encoding="utf-8")


def documented_commands() -> list[str]:
    """Return the commands that the tutorial shows, without comments."""
    lines = DOCUMENT.read_text(encoding="utf-8").splitlines()
    return [re.sub(r"\s+#.*", "", line) for line in lines if line.startswith("tis ")]
