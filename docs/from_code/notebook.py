"""The notebooks as a page: their text, and their code without outputs."""

import json
import re

from from_code.sources import NOTEBOOKS, ROOT


def page() -> str:
    """Return the page of the notebooks in ``docs/``, a section for each."""
    return "\n\n".join(["# In Python", *map(_section, NOTEBOOKS)]) + "\n"


def _section(name: str) -> str:
    file = f"docs/{name}.ipynb"
    cells = json.loads((ROOT / file).read_text(encoding="utf-8"))["cells"]
    title, _, rest = "".join(cells[0]["source"]).partition("\n")
    parts = [f"#{title}", f"This is the notebook `{file}`, which a test runs.", rest.strip()]
    for cell in cells[1:]:
        text = "".join(cell["source"])
        is_code = cell["cell_type"] == "code"
        parts.append(f"```python\n{text}\n```" if is_code else re.sub(r"^#", "##", text))
    return "\n\n".join(parts)
