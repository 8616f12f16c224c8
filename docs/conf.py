"""The manual's build: Sphinx with MyST. `make docs` runs it strictly, where every warning is an error.

The theme is pydata-sphinx-theme: it is the one of NumPy, SciPy and pandas, is light and dark, reads well on a
telephone, needs no network, and is maintained (0.24.0 of 2 November 2026; MyST-Parser 5.2.0 and sphinx-design 0.8.0
are of 10 November 2026). The alternatives in November 2026: Furo's last release is of 19 December 2025, Material for
MkDocs is in maintenance mode on a MkDocs of 2024, and sphinx-book-theme 1.4.0 of July 2026 is a layer on the theme
chosen here. Sphinx 9.0.4 is the last release for Python 3.11.
"""

import re
import sys
import tomllib
from pathlib import Path
from typing import Final

from sphinx.application import Sphinx

_DOCS = Path(__file__).parent
sys.path[:0] = [str(_DOCS), str(_DOCS.parent)]
_project = tomllib.loads((_DOCS.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]

project = "tis"
author = "the authors of tis"
version = release = _project["version"]
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "sphinx_design",
    "from_code",
]
exclude_patterns = ["_build", "from_code", "foxglove", "*.ipynb"]
nitpicky = True
nitpick_ignore_regex = [(r"py:.*", r".*")]  # names of types in signatures: most of the packages is no public API
default_role = "code"  # `name` in a docstring is code

myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
add_module_names = False
napoleon_google_docstring = False
napoleon_use_rtype = False
python_maximum_signature_line_length = 88
copybutton_prompt_text = r"\$ |>>> |\.\.\. "
copybutton_prompt_is_regexp = True

html_theme = "pydata_sphinx_theme"
html_title = "tis"
html_static_path = ["_static"]
html_css_files = ["manual.css"]
html_show_sourcelink = False
html_copy_source = False
html_sidebars = {"index": [], "gallery": [], "glossary": []}
html_theme_options = {
    "show_prev_next": True,
    "navigation_with_keys": False,
    "show_toc_level": 2,
    "navbar_align": "left",
    "header_links_before_dropdown": 7,
    "footer_start": ["copyright"],
    "footer_end": [],
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
}
html_show_copyright = False


def setup(app: Sphinx) -> None:
    """Let the folders' index pages list what lies beside them."""
    app.connect("source-read", _list_the_folder)
    app.connect("source-read", _point_at_generated_pages)


def _list_the_folder(_: Sphinx, name: str, source: list[str]) -> None:
    """Append a hidden table of contents with the folder's pages to an index page that has none."""
    if name.endswith("/index") and "{toctree}" not in source[0]:
        source[0] += "\n```{toctree}\n:hidden:\n:glob:\n\n*\n```\n"


_GENERATED: Final = "commands|scenario|hosts|study|network|summary|logs|exit_codes|api"


def _point_at_generated_pages(_: Sphinx, name: str, source: list[str]) -> None:
    """Let links go to the pages that are made with the site; in a clone they go to what is there."""
    text = re.sub(rf"\]\(((?:\.\./)?(?:reference/)?)index\.md#({_GENERATED})\)", r"](\1\2.md)", source[0])
    text = text.replace("](../compare_in_python.ipynb)", "](in_python.md#a-comparison-in-python)")
    source[0] = text.replace("](../run_in_python.ipynb)", "](in_python.md)")
    if name == "reference/index":
        source[0] = re.sub(rf"^\| ({_GENERATED}) \|", r"| [\1](\1.md) |", source[0], flags=re.MULTILINE)
