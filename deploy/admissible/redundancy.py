"""Redundancies to try, cheapest first: copies, together or spread over a sample period, and history."""

from typing import Final, Literal, NamedTuple

from tis.common.scenario.surgeon import SurgeonPart

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
