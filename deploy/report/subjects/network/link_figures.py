"""Figures of a link in the summary: each direction as requested, as decided and as realised."""

from tis.deploy.present.numbers import counted
from tis.deploy.report.section import (
    DELAYS,
    LATE,
    MEAN_LATE,
    VARIATIONS,
    KeyName,
    KindName,
    ReasonName,
    Section,
    Statistics,
    means,
    statistics,
)


class LossRuns(Section):
    """Runs of consecutive losses, key by key (RFC 3357)."""

    count: int | None = means("Runs of consecutive losses.")
    mean: float | None = means("Mean length of these runs, in packets.")
    mean_interval_95: list[float | None] | None = means("Its 95 % confidence interval.")
    longest: int | None = means("Length of the longest run, in packets.")
    distance: Statistics = statistics("Distance between consecutive losses, in packets.", "mean p50 p95")


class Delays(Section):
    """One-way delays in netem, in ms."""

    requested: Statistics = statistics("One-way delay of the scenario's distribution.", DELAYS)
    decided: Statistics = statistics("Delay that the models drew for this run's packets, without copies.", DELAYS)
    realised: Statistics = statistics(
        "Delay between netem's ingress and egress, on its own clock, of the first copy to leave.", DELAYS
    )


class RequestedShares(Section):
    """What the pipeline asks for by itself, without outages and changes."""

    loss_pct: float | None = means("Loss that the pipeline asks for.")
    mean_burst: float | None = means("Mean length of a run of losses that it asks for.")
    duplicate_pct: float | None = means("Share of packets to be duplicated.")
    corrupt_pct: float | None = means("Share of packets to be corrupted.")
    varies: bool = means("True when conditions change while the run lasts.")


class LinkVerdict(Section):
    """Whether the packets got the network requested."""

    faithful: bool | None = means(
        "True when the packets got the network requested; `null` when nothing could be decided."
    )
    violations: list[str] = means("Deviations from the network requested, in words.")
    not_decidable: list[str] = means("Properties for which there were too few packets, in words.")
    warnings: list[str] = means("Remarks on the link, in words.")
    judged: int = means("Messages held against the network requested.", default=0)
    set_aside: int = means(
        "Messages that were not, as they came while a change held that was made during the run. The release error, "
        "the order and the buffer count them, too.",
        default=0,
    )
    undecided: dict[KindName, int | None] = means("Packets there were, by the property that they were too few for.")
    keys: int = means("Keys judged, where something is not decidable of some of them only.", default=0)
    undecided_keys: dict[KindName, str] = means("The keys that `undecided` concerns, where not all.", default={})

    def text(self, request: str) -> str:
        """Return ``faithful`` in words; ``request``: `the scenario` or `the requested network`."""
        if self.faithful is None:
            return "not decidable, too little was sent"
        if not self.faithful:
            return f"not faithful to {request}"
        left_open = self.undecided_text
        if self.undecided_keys:
            return f"faithful to {request}, {self.judged_text} ({left_open})"
        judged = f" in all that could be judged ({left_open})" if left_open else ""
        return ", ".join(part for part in (f"faithful to {request}{judged}", self.judged_text) if part)

    @property
    def judged_text(self) -> str:
        """Return by how many messages it was judged where not by all, of how many keys, and why; "" where by all."""
        if not self.set_aside and not self.undecided_keys:
            return ""
        whole = f" of {self.judged + self.set_aside}" if self.set_aside else ""
        keys = f" of {self.keys} keys" if self.undecided_keys else ""
        because = ", as the network was changed while it ran" if self.set_aside else ""
        return f"judged by {self.judged}{whole} messages{keys}{because}"

    @property
    def undecided_text(self) -> str:
        """Return the criteria that could not be judged, all keys together."""
        return "; ".join(
            f"{what}{self._of(what)}: not decidable" + ("" if n is None else f" with {counted(n, 'message')}")
            for what, n in self.undecided.items()
        )

    def _of(self, what: str) -> str:
        return f" of {self.undecided_keys[what]}" if what in self.undecided_keys else ""


class PacketFigures(Section):
    """Packet counts, losses and delays of a stream of packets; None for what needs a log that is missing."""

    sent: int | None = means("Packets sent by the side at the link's origin. sent = offered + lost_before_netem.")
    offered: int | None = means("Packets that reached netem. offered + copied = released + dropped + held_at_end.")
    copied: int | None = means("Copies that netem made (the stage `duplicate`).")
    released: int | None = means("Packets and copies that left netem.")
    dropped: int | None = means("Packets and copies that netem dropped.")
    held_at_end: int | None = means("Packets that netem still held at the end of the drain.")
    lost: int | None = means("Packets of which no copy left netem, although it was offered.")
    received: int | None = means("Packets that reached the destination. released = received + lost_after_netem.")
    not_used: int | None = means(
        "Of these, packets that its gate refused (`quarantined`): delivered, and unknown to the estimator.",
        default=None,
    )
    duplicated: int | None = means("Packets that arrived more than once.")
    duplicated_by_netem: int | None = means("Of these, copies that netem made.")
    corrupted: int | None = means("Packets whose payload netem changed.")
    corrupted_rejected: int | None = means("Of these, packets that the receiver could not use.")
    lost_before_netem: int | None = means("Packets lost between the sender and netem.")
    lost_after_netem: int | None = means("Packets lost between netem and the receiver.")
    unplanned_loss: int | None = means(
        "Packets lost outside netem's models, before and after it; 0 on a healthy machine."
    )
    reordered: int | None = means("Packets that arrived after a later one (RFC 4737).")
    reordered_in_netem: int | None = means("The same, counted where packets leave netem.")
    reordering_extent: Statistics = statistics("Reordering extent of the reordered packets, in packets (RFC 4737).")
    n_reordering: Statistics = statistics("n-reordering of the reordered packets (RFC 4737).")
    dropped_by: dict[ReasonName, int] = means(
        "Dropped packets and copies by reason, such as `loss`, `outage`, `queue_full`, `late`."
    )
    loss_pct: float | None = means("Share of the offered packets that are lost.")
    loss_pct_interval_95: list[float] | None = means(
        "Its 95 % confidence interval, widened by the correlation of the losses."
    )
    loss_runs: LossRuns = means("Runs of losses.")
    delay_ms: Delays = means("Delays one way.")
    pdv_ms: Statistics = statistics(
        "Packet delay variation, the delay above the smallest (RFC 5481, section 4.2).", VARIATIONS
    )
    ipdv_ms: Statistics = statistics(
        "Absolute delay difference of consecutive packets (RFC 3393); std is of the signed one.", f"{VARIATIONS} std"
    )
    rfc3550_jitter_ms: Statistics = statistics(
        "Interarrival jitter as an RTP receiver computes it (RFC 3550).", "last mean max"
    )
    release_error_us: Statistics = statistics("How much later than decided packets left netem.", LATE)
    recovered: int | None = means("Messages whose first sending was lost, and repeated by a recovery.")
    recovered_ms: Statistics = statistics(
        "Delay that a recovery added to those messages, and to what waited behind them.", VARIATIONS
    )
    queued_ms: Statistics = statistics("Time in the queue of a rate, transmission included.", VARIATIONS)


class _OfApplication(Section):
    foreign: bool = means("True for a key of another application.")


class KeyOfLink(PacketFigures, _OfApplication):
    """The figures of one key."""

    requested: RequestedShares = means("What the pipeline of the key asks for.")
    verdict: LinkVerdict = means("Whether the packets got the network requested.")


class Queue(Section):
    """The queue of a rate over time."""

    packets: Statistics = statistics("Packets in the queue of a rate.", MEAN_LATE)
    bytes: Statistics = statistics("Bytes in the queue of a rate.", MEAN_LATE)


class ConditionFigures(Section):
    """Changes, outages, stalls and control requests during the run."""

    changes: int = means("Changes of conditions that took effect.")
    outages: int = means("Outages.")
    outage_s: float = means("Time in outages.")
    stall_s: float = means("Time in stalls.")
    states_s: dict[str, float] = means("Time in each state of `network.states`, by the state's name.")
    control_accepted: int = means("Requests to change the network that were accepted.")
    control_refused: int = means("Requests that were refused.")


class Link(PacketFigures):
    """The figures of a direction: of the testbed's keys, or of all keys without a testbed."""

    foreign: int | None = means("Packets of other applications that crossed the link; in no other figure of it.")
    untold: int = means("Packets of which a damaged log leaves the course open; in no other figure.")
    requested: RequestedShares = means("What the pipeline asks for by itself.")
    queue: Queue = means("Depth of the queue of a rate.")
    conditions: ConditionFigures = means("Conditions during the run.")
    verdict: LinkVerdict = means("Whether the packets got the network requested.")
    keys: dict[KeyName, KeyOfLink] = means(
        "The figures again for each key; there `foreign` is true for another application's key."
    )
    keys_not_listed: int = means("Keys beyond the 64 busiest, which are not in `keys`.")
    not_sent: int | None = means(
        "Messages that the receiver used and the sender did not send, so somebody forged them; those "
        "whose bits netem flipped are not counted. Without the sender's whole log null."
    )
