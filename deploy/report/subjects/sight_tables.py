"""Sight in words and as a table: what became of the frames, their age when seen, freezes, touch beside sight."""

from html import escape
from typing import Final

from tis.deploy.present.numbers import number, percent
from tis.deploy.present.page import folded, nonbreaking_units
from tis.deploy.present.table import Column, Table
from tis.deploy.report.section import Statistics, with_uncertainty
from tis.deploy.report.subjects.pictures import STATES
from tis.deploy.report.subjects.sight import HAND_TO_EYE, ForceWaits, SightFigures

_NOTE: Final = (
    "Complete: with all frames that it refers to. Concealed: the decoder filled gaps. Hand to eye: from a command's "
    "sample to the first picture that shows it or a later one, on the surgeon's clock. "
    "Freezes after W3C's webrtc-stats"
)


def sight_text(sight: SightFigures) -> str:
    """Return hand to eye, the share of whole frames and the time in freezes in a line."""
    frozen = "" if not sight.freezes else f", frozen {number(sight.freeze_pct, ' %')} of the time"
    return (
        f"{_age_text(sight)}; "
        f"{number(sight.decodable_pct, ' %')} of {number(sight.frames['sent'])} frames whole{frozen}"
    )


def _age_text(sight: SightFigures) -> str:
    """Return hand to eye, or of pictures without stamps glass to glass."""
    is_known = HAND_TO_EYE not in sight.not_measured
    name, age = (HAND_TO_EYE, sight.hand_to_eye_ms) if is_known else ("glass to glass", sight.glass_to_glass_ms)
    text = f"{name} median {number(age['p50'], ' ms')}, p99 {number(age['p99'], ' ms')}"
    return text if is_known else f"{text} ({HAND_TO_EYE} is not measured: the picture has no stamps)"


def answer_text(sight: SightFigures) -> str:
    """Return what the surgeon saw, in words."""
    eye, sent = sight.hand_to_eye_ms, sight.frames["sent"]
    text = f"Of {number(sent)} frames {number(sight.decodable_pct, ' %')} came whole"
    if sight.expected_decodable_pct is not None:
        text += f" (in theory {number(sight.expected_decodable_pct, ' %')})"
    if HAND_TO_EYE in sight.not_measured:
        eye = sight.glass_to_glass_ms
        text += f". A picture was {number(eye['p50'], ' ms')} old in the median when it was shown"
    else:
        text += f". The surgeon saw the effect of a movement {number(eye['p50'], ' ms')} later in the median"
    text += f", and {number(eye['p99'], ' ms')} in 99 of 100 cases (p99). "
    n_damaged = sight.frames["sent"] - sight.frames["complete"]
    if sight.not_measured and n_damaged and HAND_TO_EYE not in sight.not_measured:
        text += (
            f"Left out are movements that only damaged or lost frames showed, {number(n_damaged)} of {number(sent)}. "
        )
    if sight.not_measured:
        text += f"Not measured: {', '.join(sight.not_measured)}. "
    if not sight.freezes:
        return f"{text}The picture never froze."
    times = "once" if sight.freezes == 1 else f"{number(sight.freezes)} times"
    return (
        f"{text}The picture froze {times}, {number(sight.freeze_pct, ' %')} of the time, "
        f"at most for {number(sight.longest_freeze_ms, ' ms')}."
    )


_LEAST_SENT: Final = 0.9
_LATE_SCREEN_MS: Final = 100.0


def sight_texts(sight: SightFigures | None) -> list[str]:
    """Return a sentence where camera or screen had too little of a processor to show the network alone."""
    if sight is None:
        return []
    sent, due, shown_ms = sight.frames["sent"], sight.frames_due, sight.screen_ms["p50"]
    found = [f"the camera sent {sent} of {due} frames"] if due is not None and sent < _LEAST_SENT * due else []
    if shown_ms is not None and shown_ms > _LATE_SCREEN_MS:
        found.append(f"a picture was shown {number(shown_ms)} ms after it had arrived (median)")
    whose = "what was seen is of this machine too, not of the network alone"
    return [f"the picture was starved: {', and '.join(found)}; {whose}"] if found else []


def sight_tables(sight: SightFigures | None, bounds: Statistics) -> list[Table]:
    """Return the figures of the picture, and those of touch beside it; none without sight.

    ``bounds`` is what the clocks leave open of glass to glass, empty where they share one.
    """
    if sight is None:
        return []
    columns = ("figure", Column("value", words=True, wraps=True))
    return [Table("Sight", columns, _rows(sight, bounds), _NOTE)]


def sight_markup(sight: SightFigures | None, bounds: Statistics) -> tuple[str, str]:
    """Return the table of a page, and the paragraph before its figures, "" without sight."""
    if sight is None:
        return "", ""
    text = f'<p class="answer">{escape(nonbreaking_units(answer_text(sight)))}</p>'
    tables = (nonbreaking_units(table.html()) for table in sight_tables(sight, bounds))
    return folded("Each figure of sight", "".join(tables)), text


def _rows(sight: SightFigures, bounds: Statistics) -> list[tuple[str, str]]:
    frames = ", ".join(f"{number(sight.frames[name])} {name}" for name in STATES if sight.frames.get(name))
    used = ", ".join(f"{number(n)} {name}" for name, n in sight.fragments.items() if n)
    rows = [
        ("frames", f"{number(sight.frames['sent'])} sent: {frames}; {number(sight.pictures)} shown"),
        ("whole, all they refer to", _beside(sight.decodable_pct, sight.expected_decodable_pct)),
        ("not all of them arrived", _beside(sight.incomplete_pct, sight.expected_incomplete_pct)),
        *([] if HAND_TO_EYE in sight.not_measured else [("hand to eye", _spread(sight.hand_to_eye_ms))]),
        ("glass to glass", _spread(sight.glass_to_glass_ms, bounds)),
        ("arrived to shown", _spread(sight.screen_ms)),
        ("freezes", _freezes(sight)),
        ("pictures per s", number(sight.pictures_per_s)),
        ("bit rate", number(sight.kbit_s, " kbit/s")),
        *([("messages of the picture", used)] if used else []),
        *([("not measured", "; ".join(sight.not_measured))] if sight.not_measured else []),
    ]
    if (like := sight.quality) is not None:
        ratio, alike = like.psnr_db, like.ssim
        text = f"PSNR median {number(ratio['p50'], ' dB')}, p5 {number(ratio['p5'], ' dB')}; "
        text += f"SSIM {number(alike['p50'])}, {number(alike['p5'])}; of {number(like.n)} pictures"
        rows.append(("beside what the camera drew", text))
    if (touch := sight.asynchrony) is not None:
        late = touch.touch_after_sight_ms
        text = f"{number(touch.n)}, of which {number(touch.noticed)} would be noticed"
        rows.append(("contacts felt and seen", text))
        rows.append(("touch after sight", f"median {number(late['p50'], ' ms')}, p95 {number(late['p95'], ' ms')}"))
    if (waits := sight.force_waits) is not None:
        rows.append(("forces behind the picture", _waits(waits)))
    return rows


_NAMES: Final = {"p50": "median", "p95": "p95", "p99": "p99", "max": "largest"}


def _spread(values: Statistics, bounds: Statistics | None = None) -> str:
    known = bounds or {}
    return ", ".join(f"{words} {with_uncertainty(values[n], known.get(n), ' ms')}" for n, words in _NAMES.items())


def _beside(found: float | None, expected: float | None) -> str:
    theory = "" if expected is None else f"; in theory {number(expected, ' %')}"
    return f"{number(found, ' %')}{theory}"


def _freezes(sight: SightFigures) -> str:
    if not sight.freezes:
        return "none"
    share, longest = number(sight.freeze_pct, " %"), number(sight.longest_freeze_ms, " ms")
    return f"{number(sight.freezes)}, {share} of the time, the longest {longest}"


def _waits(waits: ForceWaits) -> str:
    share = percent(waits.behind_video / waits.n) if waits.n else "0"
    text = f"{share} % of {number(waits.n)}"
    if waits.behind_video:
        text += f", at most {number(waits.wait_ms['max'], ' ms')}"
    return (
        text if waits.expected_max_ms is None else f"{text}; in theory at most {number(waits.expected_max_ms, ' ms')}"
    )
