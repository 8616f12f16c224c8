"""Energy that crosses the network: the account of what the other side put in, and the bound on what it may state."""

from dataclasses import dataclass

_ROUNDING_J = 1e-9


@dataclass
class ReceivedEnergy:
    """What the other side has put into the coupling, by the totals in its messages, in J.

    The first total is where the account begins, and so is a smaller one, of a side that was started anew: neither
    adds energy. A total that grows faster than ``power_max_w`` is refused. Older messages change nothing.
    """

    power_max_w: float
    period_s: float
    credit_j: float = 0.0
    last_j: float | None = None
    last_ns: int = -1

    def take(self, total_j: float, sample_ns: int) -> bool:
        """Take a message's total at its sample instant; return whether it can be true."""
        if sample_ns <= self.last_ns:
            return True
        if self.last_j is not None and total_j > self.last_j:
            most_j = self.power_max_w * ((sample_ns - self.last_ns) * 1e-9 + self.period_s)
            if total_j - self.last_j > most_j + _ROUNDING_J:
                return False
            self.credit_j += total_j - self.last_j
        self.last_j, self.last_ns = total_j, sample_ns
        return True


@dataclass
class Port:
    """Energies of one port since its begin, in J: put into the coupling, and taken out of it."""

    in_j: float = 0.0
    out_j: float = 0.0

    def add(self, work_j: float) -> None:
        """Add the work of a tick, positive where it goes into the coupling."""
        if work_j >= 0.0:
            self.in_j += work_j
        else:
            self.out_j -= work_j
