"""What is shown while a run lasts."""

import io
from functools import partial

from rich.console import Console

from tis.deploy.run.progress import RunProgress, figure_texts
from tis.deploy.watch.live_figures import CrossingFigures, LiveFigures


def _progress(duration_s: float = 12, terminal: bool = False) -> tuple[RunProgress, io.StringIO]:
    out = io.StringIO()
    return RunProgress(Console(file=out, width=200, force_terminal=terminal), duration_s), out


def _at(progress: RunProgress, side: str, now_s: float, **counters: int) -> None:
    named = {name.replace("__", "."): value for name, value in counters.items()}
    progress.take({"side": side, "event": "progress", "now_s": now_s, "counters": named})


def test_without_a_terminal_there_are_plain_lines_every_5_s() -> None:
    progress, out = _progress()
    progress.start()
    progress.take({"side": "surgeon", "event": "ready"})
    progress.take({"side": "patient", "event": "running", "duration_s": 12, "log": "x"})
    for half_s in range(1, 26):
        now_s = half_s / 2
        _at(progress, "surgeon", now_s, sent=half_s * 30)
        _at(progress, "netem", now_s, forward__dropped_loss=2, forward__held_at_end=3, feedback__dropped_loss=9)
        _at(progress, "patient", now_s, received=half_s * 29, estimates=half_s * 15, ticks_missed=1)
    progress.take({"side": "patient", "event": "ended", "counters": {}})
    progress.stop()
    assert progress.began
    assert "\x1b" not in out.getvalue()
    assert out.getvalue().splitlines() == [
        "starting surgeon, netem and patient",
        "surgeon is ready",
        "   0/12 s  sent 30  lost 2 there, 9 back  received 29  ticks missed 1",
        "   5/12 s  sent 300  lost 2 there, 9 back  received 290  ticks missed 1",
        "  10/12 s  sent 600  lost 2 there, 9 back  received 580  ticks missed 1",
    ]


def test_the_drain_is_not_counted_as_run_time() -> None:
    progress, out = _progress(duration_s=4)
    _at(progress, "patient", 4.7)
    assert out.getvalue().startswith("   4/4 s")


def test_warnings_are_shown_as_they_are_and_a_run_that_never_began_is_known() -> None:
    progress, out = _progress()
    progress.take({"side": "netem", "event": "warning", "warning": "the [clock] is coarse"})
    progress.take({"side": "netem", "event": "warning", "warning": "got round", "kind": "bypass"})
    progress.take({"side": "surgeon", "event": "failed", "exit_code": 3, "reasons": ["x"]})
    progress.stop()
    assert out.getvalue() == "netem: warning: the [clock] is coarse\nnetem: warning (bypass): got round\n"
    assert not progress.began


def test_a_terminal_gets_a_panel_that_is_left_clean() -> None:
    progress, out = _progress(terminal=True)
    progress.start()
    for side in ("surgeon", "netem", "patient"):
        progress.take({"side": side, "event": "running", "duration_s": 12, "log": "x"})
    _at(progress, "patient", 6, received=7)
    progress.stop()
    progress.stop()
    text = out.getvalue()
    assert "received 7" in text
    assert text.rindex("\x1b[?25h") > text.rindex("\x1b[?25l")  # the cursor is shown again
    assert text.rindex("\x1b[2K") > text.rindex("received 7")  # and the panel is wiped away


def _panel(progress: RunProgress) -> list[str]:
    out = io.StringIO()
    Console(file=out, width=100).print(progress._panel())
    return [line.strip("│╭╮╰╯─ \n") for line in out.getvalue().splitlines()]


def test_the_panel_says_how_each_side_is_and_what_is_seen() -> None:
    found = LiveFigures(
        streams={"arm": CrossingFigures(200, 3, 40.12), "answers": CrossingFigures(200, 1, 39.9)},
        end_to_end_p50_ms=69.4,
        end_to_end_p99_ms=97.2,
        rmse_mm=0.448,
        hold_rmse_mm=0.86,
    )
    progress = RunProgress(Console(file=io.StringIO(), width=100), 12, "default", lambda: found)
    progress.take({"side": "surgeon", "event": "waiting", "whom": "the patient"})
    progress.take({"side": "netem", "event": "running", "duration_s": 12, "log": "x"})
    progress.take({"side": "patient", "event": "failed", "exit_code": 4, "reasons": ["x"]})
    _at(progress, "netem", 5, forward__dropped_loss=2, forward__dropped_outage=3, forward__held_at_end=4,
        feedback__dropped_loss=1)  # fmt: skip
    _at(progress, "patient", 5, received=7, estimates=6, ticks_missed=1)
    lines = _panel(progress)
    assert lines[0] == "default  5 of 12 s"
    assert lines[2:] == [
        "surgeon  waiting for the patient",
        "netem    running                  lost 5 there, 1 back  under way 4 there",
        "patient  failed                   received 7  estimates 6  ticks missed 1",
        "in the last 5 s",
        "end to end  median 69.4 ms, p99 97.2 ms, from a new sample to its estimate",
        "one way     median 40.1 ms of all arm positions, back 39.9 ms",
        "loss        1.5 % of all poses to the patient, 0.5 % back",
        "error       RMSE 0.45 mm, 52 % of the 0.86 mm of hold",
        "",
    ]


def test_what_is_not_known_is_not_said() -> None:
    assert figure_texts(LiveFigures()) == {}
    assert figure_texts(LiveFigures(rmse_mm=1.0)) == {"error": "RMSE 1.00 mm"}


def test_plain_lines_have_the_figures_too() -> None:
    out = io.StringIO()
    found = LiveFigures(end_to_end_p50_ms=69.4, end_to_end_p99_ms=97.2, rmse_mm=0.5, hold_rmse_mm=1.0)
    progress = RunProgress(Console(file=out, width=80), 12, look=lambda: found)
    _at(progress, "patient", 6, received=7)
    assert out.getvalue().splitlines() == [
        "   6/12 s  sent -  lost -  received 7  ticks missed 0",
        "  last 5 s: latency p50 69.4, p99 97.2 ms; loss -; RMSE 0.50 mm",
    ]


def test_figures_of_long_ago_are_not_told_as_the_last_ones() -> None:
    """On a busy machine the observer reads on while the run goes on."""
    found = LiveFigures(end_to_end_p50_ms=52.2, end_to_end_p99_ms=52.8, now_s=7.0)
    for now_s, is_told in ((8, True), (31, False)):
        out = io.StringIO()
        progress = RunProgress(Console(file=out, width=80), 60, look=lambda: found)
        _at(progress, "patient", now_s, received=7)
        text = " ".join(out.getvalue().split())
        assert ("latency p50 52.2" in text) == is_told
        assert ("the observer is behind" in text) != is_told


def test_80_columns_hold_a_line_however_large_its_numbers() -> None:
    """An hour of two hands at 1 kHz, most of it lost, seconds late and decimetres off."""
    out = io.StringIO()
    found = LiveFigures(
        streams={"arm": CrossingFigures(3, 3), "answers": CrossingFigures(3, 3)},
        end_to_end_p50_ms=2345.6,
        end_to_end_p99_ms=3456.7,
        rmse_mm=123.45,
    )
    progress = RunProgress(Console(file=out, width=80), 3600, look=lambda: found)
    _at(progress, "surgeon", 3600, sent=14_400_000)
    _at(progress, "netem", 3600, forward__dropped_loss=10_000_000, feedback__dropped_loss=10_000_000)
    _at(progress, "patient", 3600, received=4_300_000, estimates=7_200_000, ticks_missed=36_000)
    lines = out.getvalue().splitlines()
    assert len(lines) == 3  # ten million lost both ways take a line more
    assert max(map(len, lines)) <= 80
    assert "back 100 %" in lines[2]


def test_a_line_tells_the_loss_of_both_ways_as_far_as_it_is_known() -> None:
    arm, answers = CrossingFigures(100, 0), CrossingFigures(1000, 21)
    both, alone = LiveFigures({"arm": arm, "answers": answers}, 69.4), LiveFigures({"arm": arm}, 69.4)
    back = LiveFigures({"answers": answers}, 69.4)
    commands = LiveFigures({"master": CrossingFigures(100, 30), "arm": arm}, 69.4)
    for found, words in (
        (commands, "15 % there"),
        (both, "0.0 %, back 2.1 %"), (alone, "0.0 % there"), (back, "back 2.1 %"), (LiveFigures({}, 69.4), "-"),
    ):  # fmt: skip
        out = io.StringIO()
        progress = RunProgress(
            Console(file=out, width=80), 12, look=partial(LiveFigures, found.streams, found.end_to_end_p50_ms)
        )
        _at(progress, "netem", 6, feedback__dropped_loss=21)
        _at(progress, "patient", 6, received=7)
        assert out.getvalue().splitlines() == [
            "   6/12 s  sent -  lost 0 there, 21 back  received 7  ticks missed 0",
            f"  last 5 s: latency p50 69.4 ms; loss {words}",
        ]


def test_nothing_is_received_before_it_was_sent_whoever_speaks_last() -> None:
    """The patient reports 4.3 s, the surgeon 4.0 s: shown are the patient's figures of 3.8 s."""
    progress, out = _progress()
    for now_s in (3.8, 4.3):
        _at(progress, "patient", now_s, received=int(now_s * 60), estimates=int(now_s * 30))
    _at(progress, "surgeon", 4.0, sent=240)
    _at(progress, "netem", 3.9, forward__dropped_loss=1, forward__held_at_end=2)
    _at(progress, "patient", 5.0, received=300, estimates=150)
    assert out.getvalue().splitlines()[-1] == (
        "   5/12 s  sent 240  lost 1 there, 0 back  received 228  ticks missed 0"
    )


def test_a_side_that_has_ended_holds_nobody_back() -> None:
    progress, out = _progress(duration_s=4)
    _at(progress, "surgeon", 3.9, sent=110)
    progress.take({"side": "surgeon", "event": "ended", "counters": {"sent": 120}})
    _at(progress, "netem", 4.6, forward__dropped_loss=1, forward__held_at_end=0)
    _at(progress, "patient", 4.5, received=119, estimates=120)
    assert out.getvalue().splitlines()[-1].endswith("sent 120  lost 1 there, 0 back  received 119  ticks missed 0")


def test_after_ctrl_c_no_side_has_failed() -> None:
    progress, out = _progress(terminal=True)
    progress.start()
    progress.take({"side": "netem", "event": "ending"})
    progress.take({"side": "netem", "event": "waiting", "whom": "the patient"})
    progress.take({"side": "netem", "event": "failed", "exit_code": 3, "reasons": ["the surgeon has left"]})
    progress.stop()
    assert "failed" not in out.getvalue()
