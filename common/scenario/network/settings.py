"""Settings ``a.b=VALUE`` that override parts of a network."""

from collections.abc import Mapping, Sequence
from typing import Any, Final, get_args

from tis.common.channels import Direction
from tis.common.scenario.network.completion import KINDS, complete_stage
from tis.common.scenario.reading import apply_settings

_REMOVE: Final = ("", "~", "null")


def apply_network_settings(
    raw: Mapping[str, Any], settings: Sequence[str], where: str, below: Sequence[str]
) -> dict[str, Any]:
    """Return ``raw`` with each ``a.b=VALUE`` applied, as by `tis.common.scenario.reading.apply_settings`.

    A setting of a direction's stage, like ``forward.loss.p_loss=0.1``, may omit the kind, which `complete_stage`
    finds. ``below`` is the path of the network in ``raw``. Raises `InputError`.
    """
    # Settings of stages are collected first: the kind of a stage depends on all parameters given for it.
    parts = [setting for setting in settings if _is_part(setting, below)]
    result = apply_settings(raw, [setting for setting in settings if setting not in parts])
    given_stages, network = _network(apply_settings({}, parts), below), _network(result, below)
    for direction, stages in given_stages.items():
        pipeline = network.get(direction)
        present = pipeline if isinstance(pipeline, Mapping) else {}
        for stage, given in stages.items():
            current = present.get(stage)
            # With a kind, or over something that is no stage, the settings apply as they are.
            if "kind" in given or not isinstance(current, Mapping | None):
                mine = [one for one in parts if one.startswith(".".join((*below, direction, stage, "")))]
                result = apply_settings(result, mine)
                continue
            whole = complete_stage(stage, given, current, f"{where}: {direction}")
            result = _replaced(result, (*below, direction, stage), whole)
    return result


def _is_part(setting: str, below: Sequence[str]) -> bool:
    path, _, text = setting.partition("=")
    steps = path.split(".")
    inner = steps[len(below) :]
    is_stage = len(inner) == 3 and inner[0] in get_args(Direction) and inner[1] in KINDS and inner[2] != ""
    return steps[: len(below)] == list(below) and is_stage and text.strip() not in _REMOVE


def _network(raw: Mapping[str, Any], below: Sequence[str]) -> Mapping[str, Any]:
    here: Any = raw
    for step in below:
        here = here.get(step) if isinstance(here, Mapping) else None
    return here if isinstance(here, Mapping) else {}


def _replaced(raw: Mapping[str, Any], path: Sequence[str], value: Any) -> dict[str, Any]:
    first, *rest = path
    below = raw.get(first)
    return {**raw, first: _replaced(below if isinstance(below, Mapping) else {}, rest, value) if rest else value}
