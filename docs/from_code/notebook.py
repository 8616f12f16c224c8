"""The notebook as a page: its text, and its code without outputs."""

import json

from from_code.sources import NOTEBOOK

_NOTE = "This page is the notebook `docs/run_in_python.ipynb`, which a test runs."


def page() -> str:
    """Return the page."""
    cells = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    title, _, rest = "".join(cells[0]["source"]).partition("\n")
    parts = [title, _NOTE, rest.strip()]
    for cell in cells[1:]:
        text = "".join(cell["source"])
        parts.append(f"```python\n{text}\n```" if cell["cell_type"] == "code" else text)
    return "\n\n".join(parts) + "\n"
