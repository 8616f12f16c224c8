"""Fields on which all sides of a run must agree, and those in which two scenarios differ."""

import hashlib
import json
import re
from collections.abc import Iterator, Mapping
from typing import Any, Final, NamedTuple

from tis.common.scenario import Scenario
from tis.common.scenario.reading import MAY_DIFFER

MAX_FIELDS: Final = 4000
_MAX_VALUE_CHARS: Final = 60
_MAX_NAME_CHARS: Final = 200
_MAX_NAMED: Final = 4
_NAME: Final = re.compile(rf"[A-Za-z0-9_.-]{{1,{_MAX_NAME_CHARS}}}")
_HASH: Final = "#"


class Difference(NamedTuple):
    """A field, with the texts of its two values; None where a scenario has no such field."""

    field: str
    here: str | None
    there: str | None

    def __str__(self) -> str:
        texts = [_NOT_GIVEN if value is None else value for value in (self.there, self.here)]
        if any(text.startswith(_HASH) for text in texts):
            return f"{self.field} differs"
        return f"{self.field} is {texts[0]} there, {texts[1]} here"


_NOT_GIVEN: Final = "not given"


def agreed_fields(scenario: Scenario) -> dict[str, str]:
    """Return the fields on which all sides must agree: the value of each as JSON, a hash of a long one.

    Equal digests (`reading.digest`) have equal fields. Paths that may differ between hosts are not among them.
    """
    agreed = json.loads(scenario.model_dump_json(exclude=MAY_DIFFER))
    return dict(_leaves(agreed, ""))


def differences(here: Mapping[str, str], there: Mapping[str, str]) -> list[Difference]:
    """Return the fields that differ, in the order of the scenario here."""
    names = dict.fromkeys((*here, *there))
    return [Difference(name, here.get(name), there.get(name)) for name in names if here.get(name) != there.get(name)]


def in_words(found: list[Difference]) -> str:
    """Return the first differences as text, and how many more there are."""
    named = "; ".join(map(str, found[:_MAX_NAMED]))
    n_more = len(found) - _MAX_NAMED
    return f"{named}; and {n_more} more" if n_more > 0 else named


def checked_fields(payload: bytes) -> dict[str, str] | None:
    """Return the fields in another side's message, None unless it is what `agreed_fields` can return."""
    try:
        found = json.loads(payload)
    except (ValueError, RecursionError):
        return None
    if not isinstance(found, dict) or len(found) > MAX_FIELDS:
        return None
    return found if all(_is_field(name, value) for name, value in found.items()) else None


def _is_field(name: str, value: object) -> bool:
    if not isinstance(value, str) or len(value) > _MAX_VALUE_CHARS or not value.isprintable():
        return False
    return _NAME.fullmatch(name) is not None


def _leaves(value: Any, path: str) -> Iterator[tuple[str, str]]:
    if isinstance(value, dict) and value:
        for name, below in value.items():
            yield from _leaves(below, f"{path}.{name}" if path else name)
        return
    text = json.dumps(value)  # ASCII only
    if len(text) > _MAX_VALUE_CHARS:
        text = _HASH + hashlib.blake2b(text.encode(), digest_size=8).hexdigest()
    yield path, text
