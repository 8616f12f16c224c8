"""What a command line sets over a scenario's file, and which option a fault is to be blamed on."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import takewhile
from typing import Any, Final, NamedTuple

from common.errors import Fault, InputError
from common.scenario.network.settings import apply_network_settings

_OF_ONE_FIELD: Final = ("--seed", "--duration-s", "--unmatched")


class Override(NamedTuple):
    """A setting, ``a.b=VALUE``, and the option that it came with."""

    option: str
    setting: str

    @property
    def path(self) -> str:
        """Return the field that it sets."""
        return self.setting.partition("=")[0]


def apply_overrides(
    raw: Mapping[str, Any], overrides: Sequence[Override], below: Sequence[str]
) -> tuple[dict[str, Any], list[Fault]]:
    """Return ``raw`` with all overrides that can be applied, and the faults of the others.

    The network lies in ``raw`` below ``below``, as in `common.scenario.network.settings.apply_network_settings`.
    """
    faults: list[Fault] = []
    good: list[str] = []
    try:
        return apply_network_settings(raw, [one.setting for one in overrides], "--set", below), faults
    except InputError:
        pass  # which of them it was is found one by one
    for one in overrides:
        try:
            apply_network_settings(raw, [*good, one.setting], "--set", below)
            good.append(one.setting)
        except InputError as error:
            faults += [replace(fault, where=fault.where.replace("--set", one.option, 1)) for fault in error.faults]
    return apply_network_settings(raw, good, "--set", below), faults


def blamed(faults: Sequence[Fault], where: str, own: Sequence[Fault], overrides: Sequence[Override]) -> list[Fault]:
    """Return the faults of the file ``where`` with overrides, each blamed on whom it belongs to.

    What is wrong without them too (``own``) is the file's; anything else belongs to the overrides whose path goes
    longest with the fault's, and of these, where its rule names some, to those. Oracle: faults whose origin is known,
    tests/deploy/run/test_resolve_faults.
    """
    known = {(fault.field, fault.rule) for fault in own}
    return [
        _blamed_on(fault, overrides) if fault.where == where and (fault.field, fault.rule) not in known else fault
        for fault in faults
    ]


def _blamed_on(fault: Fault, overrides: Sequence[Override]) -> Fault:
    shared = [_shared(fault.field, one.path) for one in overrides]
    near = [one for one, n in zip(overrides, shared, strict=True) if n == max(shared)]
    words = set(re.findall(r"\w+", fault.rule))
    near = [one for one in near if words.intersection(one.path.split("."))] or near
    around = [one for one in near if f"{fault.field}.".startswith(f"{one.path}.")]
    near = around[-1:] or near  # of several for one path the last one holds
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
