"""Optional packages of the extra ``report``, which a host that runs one side need not have."""

from importlib.util import find_spec
from typing import Final

GET_REPORT: Final = "pip install 'tis-testbed[report]'"


def can_report() -> bool:
    """Tell whether Bokeh, which draws the report and the live page, is installed."""
    return find_spec("bokeh") is not None
