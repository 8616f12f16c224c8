"""Check of the tables in a Markdown page."""


def ragged_rows(text: str) -> list[str]:
    """Return the table rows that have more or fewer columns than the first row of their table."""
    found, width = [], 0
    for line in text.splitlines():
        width = (width or line.count("|")) if line.startswith("|") else 0
        if line.count("|") != width and width:
            found.append(line)
    return found
