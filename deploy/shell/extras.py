"""Optional packages of the extras, which a host that runs one side need not have."""

from importlib.util import find_spec


def can_report() -> bool:
    """Tell whether Bokeh, which draws the report and the live page, is installed."""
    return find_spec("bokeh") is not None


def can_ssh() -> bool:
    """Tell whether the package asyncssh, which reaches hosts of `tis up` by ssh, is installed."""
    return find_spec("asyncssh") is not None


def can_certify() -> bool:
    """Tell whether the package cryptography, which makes certificates, is installed."""
    return find_spec("cryptography") is not None
