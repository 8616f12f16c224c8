"""Command-line overrides of a scenario file, and the attribution of faults to options."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import takewhile
from typing import Any, Final, NamedTuple

from tis.common.errors import Fault, InputError
from tis.common.scenario.network.settings import apply_network_settings

_OF_ONE_FIELD: Final = ("--seed", "--duration-s", "--unmatched")


class Override(NamedTuple):
    """A setting, ``a.b=VALUE``, and the option that gave it."""

    option: str
    setting: str

    @property
    def path(self) -> str:
        """Return the field that the setting changes."""
        return self.setting.partition("=")[0]


def apply_overrides(
    raw: Mapping[str, Any], overrides: Sequence[Override], below: Sequence[str]
) -> tuple[dict[str, Any], list[Fault]]:
    """Return ``raw`` with all applicable overrides applied, and the faults of the others.

    ``below`` is the path of the network in ``raw``, as in `tis.common.scenario.network.settings`.
    """
    faults: list[Fault] = []
    good: list[str] = []
    try:
        return apply_network_settings(raw, [one.setting for one in overrides], "--set", below), faults
    except InputError:
        pass  # the faulty ones are found one by one
    for one in overrides:
        try:
            apply_network_settings(raw, [*good, one.setting], "--set", below)
            good.append(one.setting)
        except InputError as error:
            faults += [replace(fault, where=fault.where.replace("--set", one.option, 1)) for fault in error.faults]
    return apply_network_settings(raw, good, "--set", below), faults


def blamed(faults: Sequence[Fault], where: str, own: Sequence[Fault], overrides: Sequence[Override]) -> list[Fault]:
    """Return the faults of the file ``where`` with overrides, each attributed to the file or to an option.

    Faults that occur without overrides too (``own``) are the file's. Any other is attributed to the overrides whose
    path shares most steps with the fault's; if the fault's rule names some of these, to those. Oracle: faults of
    known origin, tests/deploy/run/test_resolve_faults.
    """
    known = {(fault.field, fault.rule) for fault in own}
    return [
        _blamed_on(fault, overrides) if fault.where == where and (fault.field, fault.rule) not in known else fault
        for fault in faults
    ]


def _blamed_on(fault: Fault, overrides: Sequence[Override]) -> Fault:
    # Candidates: the overrides nearest to the fault's path, or of these the ones that its rule mentions.
    shared = [_shared(fault.field, one.path) for one in overrides]
    near = [one for one, n in zip(overrides, shared, strict=True) if n == max(shared)]
    words = set(re.findall(r"\w+", fault.rule))
    near = [one for one in near if words.intersection(one.path.split("."))] or near
    around = [one for one in near if f"{fault.field}.".startswith(f"{one.path}.")]
    near = around[-1:] or near  # of several overrides of one path the last one applies
    where = " and ".join(dict.fromkeys(one.option for one in near))
    paths = ", ".join(dict.fromkeys(one.path for one in near))
    if around:
        return replace(fault, where=where, field="" if where in _OF_ONE_FIELD else fault.field)
    rule = f"{fault.field}: {fault.rule}" if fault.field else fault.rule
    return replace(fault, where=where, field="" if where in _OF_ONE_FIELD else paths, rule=rule)


def _shared(one: str, other: str) -> int:
    """Return how many steps two paths have in common from the top."""
    pairs = zip(one.split("."), other.split("."), strict=False)
    return sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], pairs))
