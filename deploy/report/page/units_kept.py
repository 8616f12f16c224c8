"""Numbers that stay beside their units wherever a line ends."""

import re
from typing import Final

_UNITS: Final = r"(?:%|ms|mm|\u00b5s|s|Hz|KB|MB|kB/s)"
_GAP: Final = re.compile(rf"(?<=\d) (?={_UNITS}(?!\w))")


def keep_units(text: str) -> str:
    """Return a text whose numbers are not parted from their units: no-break spaces (U+00A0) between them."""
    return _GAP.sub("\u00a0", text)
