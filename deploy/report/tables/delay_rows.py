"""Rows of requested, decided and realised delay for terminals, by direction or by key."""

from collections.abc import Iterable, Mapping
from typing import Any, Final, NamedTuple

STATISTICS: Final = ("mean", "std", "p50", "p99", "max")

_LATE: Final = ("p50", "p99", "max")
_MAX_KEYS: Final = 4
_MAX_KEY_CHARS: Final = 26
_WITHOUT_CHANGES: Final = "*: without the changes by states, timeline or while running, which the others have"


class DelayRow(NamedTuple):
    """A name and the last of `STATISTICS`; no values for a heading."""

    name: str
    values: tuple[float | None, ...] = ()


class DelayRows(NamedTuple):
    """The rows, and the notes below them."""

    rows: list[DelayRow]
    notes: list[str]


def delay_rows(links: Mapping[str, Any]) -> DelayRows:
    """Return the rows of both directions (oracle: literal summaries, tests/deploy/report/tables/test_delay_rows).

    The keys of a direction have rows of their own when their pipelines differ, as no request applies to them all. The
    busiest key of each request comes first; keys that do not fit are counted.
    """
    rows: list[DelayRow] = []
    notes: list[str] = []
    varies = False
    for direction, link in links.items():
        varies |= link["requested"]["varies"] and _is_known(link)
        keys = _differing_keys(link)
        if not keys:
            rows += _rows(f"{direction} ", link)
            continue
        shown = _first_of_each(keys)[:_MAX_KEYS]
        for name in shown:
            varies |= keys[name]["requested"]["varies"] and _is_known(keys[name])
            rows += [DelayRow(f"{direction}, {_shortened(name)}"), *_rows("  ", keys[name])]
        if n_more := len(keys) - len(shown) + link["keys_not_listed"]:
            notes.append(f"{n_more} more key{'s' if n_more > 1 else ''} {direction}: see summary.json")
    return DelayRows(rows, [_WITHOUT_CHANGES, *notes] if varies else notes)


def _differing_keys(link: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """Return the testbed's keys of the link if their requests differ, else none."""
    keys = {name: key for name, key in link.get("keys", {}).items() if not key["foreign"]}
    several = not _is_known(link) and any(_is_known(key) for key in keys.values())
    return keys if several and len(keys) > 1 else {}


def _is_known(part: Mapping[str, Any]) -> bool:
    return part["delay_ms"]["requested"]["mean"] is not None


def _first_of_each(keys: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Return the names, the first key of each distinct request in front."""
    firsts: dict[Any, str] = {}
    for name, key in keys.items():
        firsts.setdefault(tuple(key["delay_ms"]["requested"].values()), name)
    return [*firsts.values(), *(name for name in keys if name not in firsts.values())]


def _rows(before: str, part: Mapping[str, Any]) -> Iterable[DelayRow]:
    """Return the rows of a link or of a key; an unknown request has none."""
    for kind, delay in part["delay_ms"].items():
        if kind == "requested" and delay["mean"] is None:
            continue
        mark = "*" if kind == "requested" and part["requested"]["varies"] else ""
        yield DelayRow(f"{before}{kind}{mark}, ms", tuple(delay[name] for name in STATISTICS))
    error = part["release_error_us"]
    yield DelayRow(f"{before}release error, \u00b5s", tuple(error[name] for name in _LATE))


def _shortened(name: str) -> str:
    """Return the end of a key that is too long; keys differ there."""
    return name if len(name) <= _MAX_KEY_CHARS else f"...{name[3 - _MAX_KEY_CHARS :]}"
