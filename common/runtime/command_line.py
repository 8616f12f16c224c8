"""The command line as logs, manifests and reports keep it: without secrets."""

import re
import shlex
import sys
from collections.abc import Iterator, Sequence
from typing import Final

_ZENOH_SETTING: Final = "--cfg"
_LEFT_OUT: Final = "..."
_SECRET_OF_AN_ENDPOINT: Final = re.compile(r"(\w*(?:private_key|password|secret|token)\w*=)[^;]*")


def command_line(words: Sequence[str] | None = None) -> str:
    """Return the command as it was typed, ``words`` or else this process's, with ``...`` in place of secrets.

    Left out are the value of each ``--cfg``, as a setting of Zenoh may hold a password, and keys in an endpoint.
    Oracle: literals, test_command_line.
    """
    return shlex.join(["tis", *_without_secrets(sys.argv[1:] if words is None else words)])


def _without_secrets(words: Sequence[str]) -> Iterator[str]:
    is_setting = False
    for word in words:
        if is_setting:
            yield _setting(word)
        elif word.startswith(f"{_ZENOH_SETTING}="):
            yield f"{_ZENOH_SETTING}={_setting(word.removeprefix(f'{_ZENOH_SETTING}='))}"
        else:
            yield _SECRET_OF_AN_ENDPOINT.sub(rf"\g<1>{_LEFT_OUT}", word) if "#" in word else word
        is_setting = word == _ZENOH_SETTING and not is_setting


def _setting(text: str) -> str:
    """Return ``KEY:VALUE`` without its value."""
    key, colon, _ = text.partition(":")
    return f"{key}:{_LEFT_OUT}" if colon else _LEFT_OUT
