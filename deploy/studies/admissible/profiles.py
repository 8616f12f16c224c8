"""Profiles of the library as networks of the scenario: their verdicts, places, and the redundancy that helps."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import isfinite
from typing import Final, Literal, NamedTuple

from tis.common.errors import InputError
from tis.common.runtime.scenario_files import load_traces
from tis.common.scenario.surgeon import SurgeonPart
from tis.deploy.compare.plan import Request
from tis.deploy.net.profiles import find_profile, shipped_names
from tis.deploy.studies.admissible.evaluation import Evaluation, Judged
from tis.deploy.studies.admissible.region import Axis
from tis.netem.expected.figures import DirectionFigures, direction_figures

# Redundancies to try, cheapest first: copies, together or spread over a sample period, and history.

Price = Literal["bytes", "packets"]
_HISTORIES: Final = (1, 4)


class Redundancy(NamedTuple):
    """Copies of each sample, the time between them, and earlier samples in each packet."""

    copies: int
    spacing_ms: float
    history: int

    @property
    def settings(self) -> dict[str, str]:
        """The values of the scenario's fields, by path."""
        return {
            "surgeon.copies": str(self.copies),
            "surgeon.copy_spacing_ms": f"{self.spacing_ms:g}",
            "surgeon.history": str(self.history),
        }

    @property
    def text(self) -> str:
        """The redundancy in words."""
        if self.copies == 1:
            return f"history {self.history}"
        return f"{self.copies} copies" + (f" {self.spacing_ms:g} ms apart" if self.spacing_ms else "")


def redundancies(rate_hz: int, n_hands: int, max_copies: int, price: Price) -> list[Redundancy]:
    """Return 2 to ``max_copies`` copies, at once and spread over the sample period, and history; cheapest first.

    The price is that of `tis.common.scenario.surgeon`, bytes or packets a second first and the other one second. Of
    copies at one price those at once come first.
    """
    period_ms = 1000 / rate_hz
    found = [Redundancy(1, 0.0, history) for history in _HISTORIES]
    for copies in range(2, max_copies + 1):
        found += [Redundancy(copies, 0.0, 0), Redundancy(copies, float(f"{period_ms / copies:.3g}"), 0)]

    def cost(one: Redundancy) -> tuple[float, float, float]:
        part = SurgeonPart(copies=one.copies, history=one.history)
        costs = part.mb_per_s(rate_hz, n_hands), float(part.packets_per_s(rate_hz, n_hands))
        first, second = costs if price == "bytes" else reversed(costs)
        return first, second, one.spacing_ms

    return sorted(found, key=cost)


_PROFILE: Final = "network.profile"
_OF_A_LINK: Final = ("network.forward.delay.", "network.forward.loss.")
_KEPT: Final = ("network.rules", "network.unmatched", "network.buffer")


@dataclass
class PlacedProfile:
    """A profile with its long-run figures of the forward link, its verdict, and for each estimator what helps.

    ``helped_by``: the cheapest redundancy with which the limits hold, and the network judged with it; None: none.
    """

    name: str
    title: str
    forward: DirectionFigures
    judged: Judged
    helped_by: dict[str, tuple[Redundancy, Judged] | None] = field(default_factory=dict)


def profile_names(text: str) -> list[str]:
    """Return the profiles that ``all``, ``none`` or names separated by commas mean; raises `InputError`."""
    if text in ("all", "none"):
        return shipped_names() if text == "all" else []
    names, faults = list(dict.fromkeys(name.strip() for name in text.split(","))), []
    for name in names:
        try:
            find_profile(name)
        except InputError as error:
            faults += [replace(fault, where="tis admissible", field="--profiles") for fault in error.faults]
    if faults:
        raise InputError(faults)
    return names


def place_profiles(
    evaluation: Evaluation, request: Request, names: Sequence[str], candidates: Sequence[Redundancy]
) -> list[PlacedProfile]:
    """Return each profile, judged as the scenario's network, and with each of the ``candidates`` until one helps."""
    # Settings of the network are those of the axes; a profile is a network of its own.
    own = replace(request, settings=tuple(one for one in request.settings if not _is_of_the_link(one)))
    networks = [{_PROFILE: name} for name in names]
    placed = []
    for name, judged in zip(names, evaluation.judge(own, networks), strict=True):
        profile = find_profile(name)
        forward = direction_figures(profile.network, "forward", load_traces(profile.network))
        outside = [one for one in evaluation.estimators if judged.margins[one] > 0 and judged.fault is None]
        placed.append(PlacedProfile(name, profile.title, forward, judged, dict.fromkeys(outside)))
    for candidate in candidates:
        left = [one for one in placed if None in one.helped_by.values()]
        if not left:
            break
        found = evaluation.judge(own, [{_PROFILE: one.name, **candidate.settings} for one in left])
        for one, judged in zip(left, found, strict=True):
            for name, helped in one.helped_by.items():
                if helped is None and judged.margins[name] <= 0:
                    one.helped_by[name] = candidate, judged
    return placed


def place_of(forward: DirectionFigures, axes: Sequence[Axis]) -> dict[str, float] | None:
    """Return a profile's place in the plane of a delay and a loss of the forward link; None for other axes.

    Its mean delay, and the share of messages lost, in an outage or not.
    """
    delay_ms, p_lost = forward.mean_ms, 1 - (1 - forward.loss_pct / 100) * (1 - forward.outage_pct / 100)
    delays = [axis.path for axis in axes if axis.path.startswith(_OF_A_LINK[0]) and axis.path.endswith("_ms")]
    losses = [axis.path for axis in axes if axis.path == f"{_OF_A_LINK[1]}p_loss"]
    if len(axes) != 2 or len(delays) != 1 or len(losses) != 1 or not isfinite(delay_ms):
        return None
    return {axis.path: delay_ms if axis.path in delays else p_lost for axis in axes}


def _is_of_the_link(setting: str) -> bool:
    path = setting.partition("=")[0]
    return (path == "network" or path.startswith("network.")) and not path.startswith(_KEPT)
