"""Optional packages of the extras, which a host that runs one side need not have."""

from importlib.util import find_spec
from typing import Final

GET_REPORT: Final = "pip install 'tis-testbed[report]'"
GET_PARQUET: Final = "pip install 'tis-testbed[parquet]'"
GET_ROSBAG: Final = "pip install 'tis-testbed[rosbag]'"
GET_HOSTS: Final = "pip install 'tis-testbed[hosts]'"
GET_CLUSTER: Final = "pip install 'tis-testbed[cluster]'"
GET_DEVICE: Final = "pip install 'tis-testbed[device]'"


def can_report() -> bool:
    """Tell whether Bokeh, which draws the report and the live page, is installed."""
    return find_spec("bokeh") is not None


def can_ssh() -> bool:
    """Tell whether the package asyncssh, which reaches hosts of `tis up` by ssh, is installed."""
    return find_spec("asyncssh") is not None


def can_certify() -> bool:
    """Tell whether the package cryptography, which makes certificates, is installed."""
    return find_spec("cryptography") is not None
