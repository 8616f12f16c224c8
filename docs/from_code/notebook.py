"""A notebook as a page: its text, and its code without outputs."""

import json

from from_code.sources import ROOT


def page(name: str) -> str:
    """Return the page of a notebook in ``docs/``."""
    file = f"docs/{name}.ipynb"
    cells = json.loads((ROOT / file).read_text(encoding="utf-8"))["cells"]
    title, _, rest = "".join(cells[0]["source"]).partition("\n")
    parts = [title, f"This page is the notebook `{file}`, which a test runs.", rest.strip()]
    for cell in cells[1:]:
        text = "".join(cell["source"])
        parts.append(f"```python\n{text}\n```" if cell["cell_type"] == "code" else text)
    return "\n\n".join(parts) + "\n"
