"""Cost and gain of redundancy, in words and as figures beside those of first packets alone."""

from collections.abc import Mapping
from typing import Any, Final, NamedTuple

from tis.deploy.report.measures.redundancy import is_redundant
from tis.deploy.report.tables.numbers import heads
from tis.deploy.report.verdict.amounts import plain_number

COLUMNS: Final = ("as sent", "first packets alone")
NOTE: Final = (
    "First packets alone: each sample once and without history, on this run's fates. Where packets wait for each "
    "other, in a queue or for their order, first packets alone would be faster. Bytes: payload and attachment"
)
_STATISTICS: Final = ("mean", "p95")


class Row(NamedTuple):
    """A figure as sent and of first packets alone; None for unknown."""

    title: str
    as_sent: float | None
    once: float | None


def redundancy_text(found: Mapping[str, Any]) -> str:
    """Return the repetition in words: ``each sample 4 times, 8 ms apart, with the 2 samples before it``."""
    copies, spacing_ms, history = found["copies"], found["copy_spacing_ms"], found["history"]
    words = ["each sample once"]
    if copies > 1:
        words = [f"each sample {copies} times", f"{spacing_ms:g} ms apart" if spacing_ms else "all at once"]
    if history:
        words.append(f"with the {history} samples before it" if history > 1 else "with the sample before it")
    return ", ".join(words)


def redundancy_rows(found: Mapping[str, Any]) -> list[Row]:
    """Return cost and gain; empty without redundancy."""
    if not is_redundant(found):
        return []
    price, lost, ages_ms, once_ms = (found[name] for name in ("price", "lost", "age_ms", "age_once_ms"))
    return [
        Row("packets/s", price["packets_per_s"], price["packets_per_s_once"]),
        Row("kB/s", kilo(price["bytes_per_s"]), kilo(price["bytes_per_s_once"])),
        Row("packets that never arrived, %", lost["packets_pct"], lost["samples_once_pct"]),
        Row("samples that never arrived, %", lost["samples_pct"], lost["samples_once_pct"]),
        *(
            Row(f"age at the ticks, {head}", ages_ms[name], once_ms[name])
            for name, head in zip(_STATISTICS, heads(_STATISTICS, "ms"), strict=True)
        ),
    ]


def sample_loss_text(found: Mapping[str, Any]) -> str | None:
    """Return the share of samples that arrived in no packet; None without redundancy or when it is unknown."""
    pct = found["lost"]["samples_pct"]
    if not is_redundant(found) or pct is None:
        return None
    return f"{plain_number(pct)} % of the samples never arrived" if pct else "every sample arrived"


def kilo(value: float | None) -> float | None:
    """Return thousands."""
    return None if value is None else value / 1000
