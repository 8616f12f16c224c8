"""What was asked for while running and has no end gives way to what is asked for later."""

from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from dataclasses import replace
from typing import Final

from common.scenario.network.conditions import Change
from netem.conditions.window import Window
from netem.draws.grid import LAST_CELL

_ON_TOP: Final = frozenset({"outage", "scale_delay", "add_delay_ms", "add_p_loss"})
"""What comes on top of a pipeline, whatever its stages are."""


def give_way(added: Sequence[Window], later: Change, begin: int) -> list[Window]:
    """Return the windows without what ``later`` gives from cell ``begin`` on, as far as they have no end.

    So whatever is set for good again and again leaves one window for each thing at most, and a factor that is set
    anew does not multiply. Ramps that have begun go on. Oracle: mappings that are merged,
    tests/netem/control/test_control.
    """
    left: list[Window] = []
    for window in added:
        if window.entry.for_s is not None or window.stop < LAST_CELL:
            left.append(window)
            continue
        stays, goes = _split(window.change, later)
        if stays is not None:
            left.append(_with(window, stays))
        if goes is not None and window.begin < begin:
            left.append(replace(_with(window, goes), cut=begin))
    return left


def _with(window: Window, change: Change) -> Window:
    return replace(window, entry=window.entry.model_copy(update={"set": change}))


def _split(change: Change, later: Change) -> tuple[Change | None, Change | None]:
    """Return what stays of a change beside a later one, and what goes; None where that is nothing."""
    given = change.model_fields_set
    gone = given & later.model_fields_set
    if later.clean:
        gone |= given - _ON_TOP

    def part(names: AbstractSet[str]) -> Change | None:
        return Change.model_construct(**{name: getattr(change, name) for name in names}) if names else None

    return part(given - gone), part(gone)
