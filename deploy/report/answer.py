"""The result of a run: in one paragraph, as four figures, and as the first section of its page."""

from collections.abc import Sequence
from html import escape
from typing import Final

from tis.common.scenario import Scenario
from tis.deploy.present.numbers import number, percent
from tis.deploy.present.page import Section, nonbreaking_units, problem_list
from tis.deploy.report.network_picture import DirectionFigures, network_picture
from tis.deploy.report.run_view import RunView
from tis.deploy.report.subjects.latency import END_TO_END
from tis.deploy.report.subjects.network.disturbances import disturbances_text
from tis.deploy.report.subjects.network.link_figures import Link
from tis.deploy.report.subjects.requirement_tables import outcome_list
from tis.deploy.report.subjects.touch_tables import verdict_text
from tis.deploy.report.summary import Summary
from tis.deploy.report.validity import validity_text


def answer(summary: Summary, scenario: Scenario) -> str:
    """Return a paragraph with figures of the summary; it names unknown ones."""
    return " ".join(
        (*_touch_texts(summary), _late_text(summary), _lossy_text(summary), *_accurate_texts(summary, scenario))
    )


def _touch_texts(summary: Summary) -> list[str]:
    """Return the verdict on each hand's loop: in a run with touch it goes before all figures."""
    return [
        f"{f'{hand.capitalize()} hand: ' if len(summary.touch) > 1 else ''}{verdict_text(found)}"
        for hand, found in summary.touch.items()
    ]


def _late_text(summary: Summary) -> str:
    whole = summary.latency_ms.end_to_end
    if whole["p50"] is None:
        return "How late the estimates were is not known."
    if text := summary.unresolved_latency:
        return f"{text[0].upper()}{text[1:]}."
    median, most = (summary.text("latency_ms.end_to_end", name, " ms") for name in ("p50", "p99"))
    return (
        f"An estimate with a new sample is published when that is {median} old in the median, "
        f"and at most {most} in 99 of 100 cases (p99).{_old_text(summary)}"
    )


_FAR_OLDER: Final = 1.1


def _old_text(summary: Summary) -> str:
    """Return how old the newest sample is at all ticks; "" where that is hardly older than at those with one."""
    of_new, of_all = summary.latency_ms.end_to_end["p99"], summary.age_ms["p99"]
    if of_new is None or of_all is None or of_all <= _FAR_OLDER * of_new:
        return ""
    most, worst = (summary.text("age_ms", name, " ms") for name in ("p99", "max"))
    return f" At all ticks, also those without a new one, the newest is at most {most} old (p99), {worst} at worst."


def _lossy_text(summary: Summary) -> str:
    forward, feedback = (summary.links[direction].loss_pct for direction in ("forward", "feedback"))
    if forward is None and feedback is None:
        return "How much was lost is not known."
    lost = f"{_share(forward)} of the packets from surgeon to patient and {_share(feedback)} of those back"
    text = f"The network lost {lost}."
    if (samples := summary.redundancy.loss_text) is not None:
        text += f" The surgeon sent {summary.redundancy}: {samples}."
    return text


def _accurate_texts(summary: Summary, scenario: Scenario) -> list[str]:
    active = scenario.active_estimator
    known = {
        hand: {name: entry for name, entry in scores.items() if entry.rmse_3d_mm is not None and name != "plant"}
        for hand, scores in summary.scores_by_hand.items()
    }
    hands = [hand for hand, entries in known.items() if active in entries and "hold" in entries]
    if any(scores[active].without_answer for scores in summary.scores_by_hand.values() if active in scores):
        return [f"The patient's estimator, {active}, failed: it gave no estimate at any scored tick."]
    if not hands:
        return ["How accurate the estimates were is not known."]

    def errors(name: str) -> str:
        return " and ".join(
            f"{number(known[hand][name].rmse_3d_mm)} mm" + (f" ({hand} hand)" if len(known) > 1 else "")
            for hand in hands
        )

    if active == "hold":
        off = f"{errors('hold')} (RMSE in 3D)"
        return [f"hold, which repeats the newest arm position that arrived, was off the arm by {off}."]
    sentences = [
        f"The patient's estimator, {active}, was off the arm's true position by {errors(active)} (RMSE in 3D); "
        f"merely repeating the newest arm position that arrived (hold) was off by {errors('hold')}."
    ]
    ratios = [ratio for hand in hands if (ratio := known[hand][active].ratio_to_hold) is not None]
    if len(ratios) == len(hands):
        so = "So estimating" if max(ratios) <= 1 else "So estimating did not pay here: it"
        sentences.append(f"{so} leaves {' and '.join(f'{percent(ratio)} %' for ratio in ratios)} of the error.")
        sentences += _second_packet(summary, active) if max(ratios) <= 1 else []
    for hand in hands:
        best = min(known[hand], key=lambda name: known[hand][name].rmse_3d_mm or 0.0)
        if best != active:
            where = f", {hand} hand" if len(known) > 1 else ""
            error = number(known[hand][best].rmse_3d_mm)
            sentences.append(f"Of all estimators {best} came closest, with {error} mm{where}.")
    return sentences


def _second_packet(summary: Summary, active: str) -> list[str]:
    """Return a note that hold reads one of two packets, where some are lost and the other tells as much."""
    lost = summary.links["forward"].loss_pct
    single = summary.identification
    models = list(summary.identification_by_hand.values()) or ([] if single is None else [single])
    at_once = bool(models) and all(model.static for model in models)
    if not at_once or active in _OF_THE_ARM or lost is None or lost < _MUCH_LOST_PCT:
        return []
    return [
        "The arm follows at once, so a command tells its place as well as the arm's own packet. hold reads the "
        "latter alone: of an estimator that reads both, part of that gain is the second packet's."
    ]


def _share(loss_pct: float | None) -> str:
    if loss_pct is None:
        return "an unknown share"
    return f"{number(loss_pct)} %" if loss_pct else "none"


_OF_THE_ARM: Final = ("hold", "damped_velocity")
"""Estimators that read the arm's packets alone."""
_MUCH_LOST_PCT: Final = 5.0
_POOLED: Final = (
    " The figures of the whole run pool these networks, and the time at rest; "
    '<a href="#stretches">each network of the run</a> has its own.'
)


def answer_section(run: RunView, warnings: Sequence[str]) -> Section:
    """Return the answer: words and figures, validity with problems and warnings, and the verdicts in short.

    What disturbed the network is said first.
    """
    summary = run.summary
    # the warnings name absences
    disturbed = disturbances_text("this run", [one for one in run.disturbances if one.kind != "absence"])
    observer = " Here, in topology observer, commands cross unimpaired, so it is mostly theirs."
    definition = f"{END_TO_END}.{observer if run.scenario.topology == 'observer' else ''}"
    markup = (
        (f"<p>{escape(nonbreaking_units(disturbed))}{_POOLED * bool(summary.stretches)}</p>" if disturbed else "")
        + f'<p class="answer">{escape(nonbreaking_units(answer(summary, run.scenario)))}</p>'
        + tiles(summary, run.scenario)
        + f"<p>{escape(validity_text(summary))}</p>{problem_list(summary.problems, warnings)}"
        + '<div class="sidebyside"><div>'
        + network_picture({d: _direction(link) for d, link in summary.links.items()}, {})
        + f'<p class="note">{escape(nonbreaking_units(definition))}</p></div>'
        + f"<div>{outcome_list(summary.verdicts, summary.ticks.rate_hz)}</div></div>"
    )
    return Section("answer", "The answer", markup=markup, mark=run.mark)


def _direction(link: Link) -> DirectionFigures:
    """Return a direction's figures of the whole run for the picture."""
    return DirectionFigures(link.delay_ms.realised["p50"], link.loss_pct, link.conditions.outage_s or None)


def tiles(summary: Summary, scenario: Scenario) -> str:
    """Return four figures of the summary with their meaning; a dash for an unknown one."""
    parts = [_late(summary), _lossy(summary), _accurate(summary, scenario), _punctual(summary)]
    items = "".join(
        f'<div><dt>{escape(name)}</dt><dd class="value">{escape(value)} <small>{escape(unit)}</small></dd>'
        f'<dd class="beside">{escape(nonbreaking_units(beside))}</dd></div>'
        for name, value, unit, beside in parts
    )
    return f'<dl class="tiles">{items}</dl>'


def _late(summary: Summary) -> tuple[str, str, str, str]:
    median, most = (summary.text("latency_ms.end_to_end", name) for name in ("p50", "p99"))
    return (
        "How late",
        median,
        "ms",
        f"median, end to end: from a new sample to the estimate with it; in 99 of 100 cases at most {most} ms (p99)."
        f"{_old_text(summary)}",
    )


def _lossy(summary: Summary) -> tuple[str, str, str, str]:
    forward, feedback = (summary.links[direction].loss_pct for direction in ("forward", "feedback"))
    longest = summary.links["forward"].loss_runs.longest
    in_a_row = f", up to {longest} in a row" if longest else ""
    beside = f"of the packets to the patient{in_a_row}; {number(feedback)} % of those back"
    samples = summary.redundancy.loss_text
    return "How lossy", number(forward), "%", beside if samples is None else f"{beside}; {samples}"


def _accurate(summary: Summary, scenario: Scenario) -> tuple[str, str, str, str]:
    by_hand, active = summary.scores_by_hand, scenario.active_estimator
    found = [(hand, scores[active]) for hand, scores in by_hand.items() if active in scores]
    value = " / ".join(number(entry.rmse_3d_mm) for _, entry in found) or "-"
    ratios = [entry.ratio_to_hold for _, entry in found if entry.ratio_to_hold is not None]
    hands = f" ({' / '.join(hand for hand, _ in found)} hand)" if len(found) > 1 else ""
    if not ratios or len(ratios) < len(found) or active == "hold":
        return "How accurate", value, "mm", f"RMSE of {active}, in 3D{hands}"
    share = " / ".join(map(percent, ratios))
    beside = f"RMSE of {active}, in 3D{hands}: {share} % of the error of repeating the last position (hold)"
    return "How accurate", value, "mm", beside


def _punctual(summary: Summary) -> tuple[str, str, str, str]:
    ticks = summary.ticks
    planned, count = ticks.planned, ticks.count
    cut = f" ({planned} were planned)" if count is not None and count < planned else ""
    beside = f"of {number(count)} ticks of the patient{cut}, at {ticks.rate_hz} Hz"
    if missed := summary.surgeon_ticks.missed:
        beside += f"; the surgeon missed {missed}"
    if summary.mode == "twin":
        beside += "; virtual time has no missed ticks"
    return "Ticks missed", number(ticks.missed), "", beside
