"""Pages of the studies: a Markdown file beside the code, with a study's figures and tables in its places."""

from pathlib import Path


def filled(template: Path, **parts: object) -> str:
    """Return the text of a template with ``parts`` in the places of their names in braces.

    A part of which nothing is left takes its paragraph with it. The text ends with one newline.
    """
    text = template.read_text(encoding="utf-8").format_map(parts)
    return "\n\n".join(block.strip("\n") for block in text.split("\n\n") if block.strip()) + "\n"
