"""The result of a run in one paragraph: latency, loss and accuracy."""

from typing import Any

from tis.common.channels import Hand
from tis.common.scenario import Scenario
from tis.deploy.report.tables.numbers import figure, number, unresolved_latency
from tis.deploy.report.tables.redundancy_rows import redundancy_text, sample_loss_text


def answer(summary: dict[str, Any], scenario: Scenario) -> str:
    """Return a paragraph with figures of the summary; it names unknown ones."""
    return " ".join((_late(summary), _lossy(summary), *_accurate(summary, scenario)))


def accuracy_by_hand(summary: dict[str, Any], scenario: Scenario) -> dict[Hand, dict[str, Any]]:
    """Return the scores by hand, without hands that have none."""
    one_hand = {scenario.source.hands[0]: summary["accuracy"]}
    by_hand = summary.get("accuracy_by_hand") or one_hand
    return {hand: scores for hand, scores in by_hand.items() if scores}


def _late(summary: dict[str, Any]) -> str:
    whole = summary["latency_ms"]["end_to_end"]
    if whole["p50"] is None:
        return "How late the estimates were is not known."
    if text := unresolved_latency(summary):
        return f"{text[0].upper()}{text[1:]}."
    median, most = (figure(summary, "latency_ms.end_to_end", name, " ms") for name in ("p50", "p99"))
    return (
        f"When an estimate is published, the newest sample behind it is {median} old in the median, "
        f"and at most {most} in 99 of 100 cases (p99)."
    )


def _lossy(summary: dict[str, Any]) -> str:
    forward, feedback = (summary["links"][direction]["loss_pct"] for direction in ("forward", "feedback"))
    if forward is None and feedback is None:
        return "How much was lost is not known."
    lost = f"{_share(forward)} of the packets from surgeon to patient and {_share(feedback)} of those back"
    text = f"The network lost {lost}."
    if (samples := sample_loss_text(summary["redundancy"])) is not None:
        text += f" The surgeon sent {redundancy_text(summary['redundancy'])}: {samples}."
    return text


def _accurate(summary: dict[str, Any], scenario: Scenario) -> list[str]:
    active = scenario.active_estimator
    known = {
        hand: {name: entry for name, entry in scores.items() if entry["rmse_3d_mm"] is not None and name != "plant"}
        for hand, scores in accuracy_by_hand(summary, scenario).items()
    }
    hands = [hand for hand, entries in known.items() if active in entries and "hold" in entries]
    if not hands:
        return ["How accurate the estimates were is not known."]

    def errors(name: str) -> str:
        return " and ".join(
            f"{number(known[hand][name]['rmse_3d_mm'])} mm" + (f" ({hand} hand)" if len(known) > 1 else "")
            for hand in hands
        )

    if active == "hold":
        off = f"{errors('hold')} (RMSE in 3D)"
        return [f"hold, which repeats the newest arm position that arrived, was off the arm by {off}."]
    sentences = [
        f"The patient's estimator, {active}, was off the arm's true position by {errors(active)} (RMSE in 3D); "
        f"merely repeating the newest arm position that arrived (hold) was off by {errors('hold')}."
    ]
    ratios = [known[hand][active]["ratio_to_hold"] for hand in hands]
    if None not in ratios:
        so = "So estimating" if max(ratios) <= 1 else "So estimating did not pay here: it"
        sentences.append(f"{so} leaves {' and '.join(f'{100 * ratio:.0f} %' for ratio in ratios)} of the error.")
    for hand in hands:
        best = min(known[hand], key=lambda name: float(known[hand][name]["rmse_3d_mm"]))
        if best != active:
            where = f", {hand} hand" if len(known) > 1 else ""
            error = number(known[hand][best]["rmse_3d_mm"])
            sentences.append(f"Of all estimators {best} came closest, with {error} mm{where}.")
    return sentences


def _share(loss_pct: float | None) -> str:
    if loss_pct is None:
        return "an unknown share"
    return f"{number(loss_pct)} %" if loss_pct else "none"
