"""What is said while a command computes for long."""

import io

from rich.console import Console

from tis.deploy.shell.progress import PhaseProgress, RunTime


class _Clock:
    now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def test_without_a_terminal_a_plain_line_says_the_phases_every_10_s() -> None:
    out, clock = io.StringIO(), _Clock()
    with PhaseProgress(Console(file=out, width=80), clock) as progress:
        progress.total("models identified", 4)
        progress.total("twins", 64, 3)  # computed before
        for second in range(1, 36):
            clock.now_s = 100.0 + second
            if second in (12, 21):
                progress.advance("models identified")
            if second > 21:
                progress.advance("twins", 2)
            progress.wait()
    assert out.getvalue().splitlines() == [
        "  10 s  models identified 0/4, twins 3/64",
        "  20 s  models identified 1/4, twins 3/64",
        "  30 s  models identified 2/4, twins 21/64, about 22 s left",
    ]


def test_of_rounds_the_time_left_is_that_of_the_present_one() -> None:
    out, clock = io.StringIO(), _Clock()
    with PhaseProgress(Console(file=out, width=80), clock, in_rounds=True) as progress:
        progress.total("twins", 8)
        for _ in range(7):
            clock.now_s += 2
            progress.advance("twins")
    assert out.getvalue() == "  10 s  twins 5/8, about 6 s left of this round: more may follow\n"


def test_a_part_that_is_done_says_so_without_being_waited_for() -> None:
    out, clock = io.StringIO(), _Clock()
    with PhaseProgress(Console(file=out, width=80), clock) as progress:
        progress.total("simulations", 2)
        clock.now_s += 10
        progress.advance("simulations")
        progress.advance("simulations")
    assert out.getvalue() == "  10 s  simulations 1/2\n"


def test_a_terminal_gets_a_bar_for_each_phase_and_is_left_clean() -> None:
    out = io.StringIO()
    with PhaseProgress(Console(file=out, width=80, force_terminal=True)) as progress:
        progress.total("models identified", 4)
        progress.advance("models identified")
        progress.total("twins", 64)
        progress.advance("twins", 2)
    text = out.getvalue()
    for words in ("models identified", "1/4", "twins", "2/64"):
        assert words in text
    assert text.rindex("\x1b[2K") > text.rindex("2/64")


def test_a_phase_that_grows_has_one_bar() -> None:
    out = io.StringIO()
    with PhaseProgress(Console(file=out, width=100, force_terminal=True)) as progress:
        progress.total("twins", 2)
        progress.advance("twins", 2)
        progress.total("twins", 3, 1)
    assert "3/5" in out.getvalue()


def test_the_run_time_of_a_twin_is_a_bar_in_a_terminal_and_nothing_elsewhere() -> None:
    for terminal in (True, False):
        out = io.StringIO()
        with RunTime(Console(file=out, width=100, force_terminal=terminal), 600) as bar:
            bar.reached(150_000_000_000)
        assert ("150 of 600 s" in out.getvalue()) == terminal
        assert bar.now_s == 150
