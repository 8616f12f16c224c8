"""The example of docs/own_estimator.md as its readers have it: what the document shows is what tests run."""

import re
from pathlib import Path

DOCUMENT = Path(__file__).resolve().parents[1] / "docs" / "own_estimator.md"
NAME = "my_filter:AlphaBeta"
FILE = "my_filter.py"


def documented_estimator() -> str:
    """Return the text of the module."""
    blocks = re.findall(r"^```python\n(.*?)^```$", DOCUMENT.read_text(encoding="utf-8"), re.S | re.M)
    (text,) = [block for block in blocks if "class AlphaBeta" in block]
    return str(text)


def documented_commands() -> list[str]:
    """Return the commands that the document shows, without what is said beside them."""
    lines = DOCUMENT.read_text(encoding="utf-8").splitlines()
    return [re.sub(r"\s+#.*", "", line) for line in lines if line.startswith("tis ")]
