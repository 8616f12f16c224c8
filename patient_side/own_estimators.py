"""User-defined estimators of a patient: records and counters of their faults."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Self

from tis.common.channels import Hand
from tis.common.node import Record
from tis.common.records import ESTIMATOR_FAULTS, FAULTY_STEPS, EstimatorFault
from tis.patient_side.estimators.guarded import Guarded
from tis.patient_side.hand import PatientHand


@dataclass(frozen=True)
class OwnEstimators:
    """All user-defined estimators, each with its hand; usually none."""

    guarded: Sequence[tuple[Hand, Guarded]]

    @classmethod
    def among(cls, hands: Sequence[PatientHand]) -> Self:
        """Return the user-defined estimators of these hands."""
        own = [(hand.channels.hand, each) for hand in hands for each in hand.estimators if isinstance(each, Guarded)]
        return cls(own)

    def first_faults(self) -> Iterator[Record]:
        """Yield the first fault of each, once."""
        for hand, guarded in self.guarded:
            if guarded.first is not None and not guarded.reported:
                guarded.reported = True
                t_ns, reason = guarded.first
                fault = EstimatorFault(t_ns=t_ns, hand=hand, estimator=guarded.name, reason=reason)
                yield Record(ESTIMATOR_FAULTS, t_ns, fault)

    def counters(self) -> dict[str, int]:
        """Return the number of failed steps over all hands, by the counter's name."""
        found: dict[str, int] = {}
        for _, guarded in self.guarded:
            name = f"{FAULTY_STEPS}.{guarded.name}"
            found[name] = found.get(name, 0) + guarded.n_faults
        return found
