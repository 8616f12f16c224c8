"""What is said while a comparison computes."""

import io

from rich.console import Console

from deploy.compare.progress import CompareProgress


class _Clock:
    now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def test_without_a_terminal_a_plain_line_says_the_phase_every_10_s() -> None:
    out, clock = io.StringIO(), _Clock()
    with CompareProgress(Console(file=out, width=80), 64, clock) as progress:
        progress.settled(3)  # computed before
        progress.begin(4)
        for second in range(1, 36):
            clock.now_s = 100.0 + second
            if second in (12, 21):
                progress.trained()
            if second > 21:
                progress.settled(2)
            progress.wait()
    assert out.getvalue().splitlines() == [
        "  10 s  models identified 0/4, twins 3/64",
        "  20 s  models identified 1/4, twins 3/64",
        "  30 s  models identified 2/4, twins 21/64",
    ]


def test_where_models_are_at_hand_they_are_not_spoken_of() -> None:
    out, clock = io.StringIO(), _Clock()
    with CompareProgress(Console(file=out, width=80), 5, clock) as progress:
        clock.now_s += 10
        progress.wait()
    assert out.getvalue() == "  10 s  twins 0/5\n"


def test_a_terminal_gets_a_bar_for_each_phase_and_is_left_clean() -> None:
    out = io.StringIO()
    with CompareProgress(Console(file=out, width=80, force_terminal=True), 64) as progress:
        progress.begin(4)
        progress.trained()
        progress.settled(2)
    text = out.getvalue()
    for words in ("models identified", "1/4", "twins", "2/64"):
        assert words in text
    assert text.rindex("\x1b[2K") > text.rindex("2/64")
