"""What the extra ``report`` brings: not every host of a side has it."""

from importlib.util import find_spec
from typing import Final

GET_REPORT: Final = "pip install 'tis-testbed[report]'"


def can_report() -> bool:
    """Tell whether there is Bokeh, which draws the report and the live page."""
    return find_spec("bokeh") is not None
