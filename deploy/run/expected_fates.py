"""Expected fates: the decisions of a scenario's models at the instants at which a run offered its packets."""

from typing import Final

import numpy as np

from common.channels import Direction
from common.records import Outcome
from common.streams import Address
from deploy.logs.read.batches import DELIVER, OUTCOMES, Fates
from deploy.report.measures.network.requested import Requested
from netem.stages.impairment import Impairment
from netem.stages.pipeline_draws import Draw

_CODES: Final = {name: code for code, name in enumerate(OUTCOMES)}


def expected_fates(request: Requested, seed: int, direction: Direction, key: str, fates: Fates) -> Fates | None:
    """Return N packets of one key with the fates that the models give them; None without a trace or a pipeline.

    Outcome, delay, copies and flipped bits follow from the sequence number and from the ms of run time at which each
    packet was offered, under the conditions of that ms: the decisions of a twin offered the packets at the same
    instants. A refused key has no pipeline. Oracle: `netem.expected.simulate`, test_consistency.
    """
    pipeline = request.pipeline(key)
    held = request.in_force(fates.offered_ns)
    if pipeline is None or any(request.under(key, condition.changes) is None for condition in held.conditions):
        return None
    impairment = Impairment(pipeline, Address(seed, direction, key), request.traces)
    rows = zip(
        fates.seq.tolist(), fates.offered_ns.tolist(), fates.n_bytes.tolist(), held.which.tolist(), strict=True
    )
    decided = [
        _columns(impairment.decide(seq, at_ns, n_bytes, held.conditions[which]))
        for seq, at_ns, n_bytes, which in rows
    ]
    outcome, delay_ns, copies, flipped = np.array(decided, dtype=np.int64).reshape(-1, 4).T
    return fates._replace(outcome=outcome, delay_ns=delay_ns, copies=copies, flipped=flipped)


def _columns(drawn: Draw | Outcome) -> tuple[int, int, int, int]:
    if isinstance(drawn, str):
        return _CODES[drawn], 0, 0, 0
    return DELIVER, drawn.delay_ns, int(drawn.copy_delay_ns is not None), drawn.n_flips
