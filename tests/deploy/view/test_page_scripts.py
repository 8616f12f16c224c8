"""The pure parts of the live page's scripts, in a browser without a page."""

import csv
import itertools
import json
from collections.abc import Iterator
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING, Any

import pytest

import tis.deploy.view
from tests.system.browser import chromium, watched_page

if TYPE_CHECKING:
    from playwright.sync_api import Page

_HERE = Path(tis.deploy.view.__file__).parent
_PLAY = """(places) => {
  const { begin, step, isOver, rowOf } = window.touchTask
  let task = begin([10, 20], { delay_ms: 300, ghost: false })
  for (const [at_ms, arm_mm] of places) task = step(task, at_ms, arm_mm)
  return { next: task.next, misses: task.n_misses, over: isOver(task), row: isOver(task) ? rowOf(task) : null }
}"""
_FOLLOW = """(moves) => {
  let view = null
  return moves.map(([places, size]) => {
    view = window.pictureLayout.follow(view, [0, 0, 0], places, size, 110)
    if (!view) return null
    const at = (place, axis) => size[axis] / 2 + (place[axis] - view.centre[axis]) * view.scale
    return places.map((place) => [at(place, 0), at(place, 1)])
  })
}"""


@pytest.fixture(scope="module")
def page() -> Iterator["Page"]:
    with chromium() as browser:
        page, errors = watched_page(browser)
        for name in ("touch_task.js", "picture_layout.js"):
            page.add_script_tag(path=_HERE / name)
        yield page
        assert errors == []


def test_a_lost_connection_says_that_the_run_may_have_ended_unless_it_is_known_to_have() -> None:
    with chromium() as browser:
        page, errors = watched_page(browser)
        lost = (_HERE / "page.html").read_text().partition('<p id="lost"')[2].partition("</p>")[0]
        page.set_content(f'<p id="opening"></p><select id="arm"></select><p id="lost"{lost}</p>')
        page.add_script_tag(path=_HERE / "page.js")
        page.evaluate("() => { window.n_said = 0; window.live.say = () => { window.n_said += 1 } }")
        page.evaluate("() => window.live.lose({ is_over: true })")
        assert page.locator("#lost").is_hidden()
        page.evaluate("() => window.live.lose({ is_over: false })")
        assert "may have ended" in page.locator("#lost").inner_text()
        assert page.evaluate("() => window.n_said") == 2
        assert errors == []


def test_a_page_that_is_drawn_late_does_not_go_on_saying_that_nobody_answers() -> None:
    with chromium() as browser:
        page, errors = watched_page(browser)
        page.clock.install()
        page.set_content('<p id="opening">Opening …</p><select id="arm"></select>')
        page.add_script_tag(path=_HERE / "page.js")
        page.clock.run_for(11_000)
        assert "does not answer" in page.locator("#opening").inner_text()
        page.evaluate("() => { window.Bokeh = { documents: [1] } }")
        page.clock.run_for(1_000)
        assert page.locator("#opening").count() == 0
        assert errors == []


def _targets(page: "Page") -> list[list[float]]:
    found: list[list[float]] = page.evaluate("() => window.touchTask.begin([10, 20], {}).targets")
    return found


def test_a_task_is_spoilt_by_a_change_of_the_network_and_once_it_counts_by_a_stop(page: "Page") -> None:
    """Its row names a delay alone: an outage, a loss or a stop within it would stand there as that delay's."""
    words = """([first, n_ms, messages]) => {
      const { begin, step, noted, spoilt } = window.touchTask
      let task = begin([10, 20], { delay_ms: 100, ghost: false }, 3)
      for (const at_ms of n_ms) task = step(task, at_ms, first)
      return messages.map((seen) => spoilt(task = noted(task, seen.set), seen))
    }"""
    first = _targets(page)[0]

    def found(counts: bool, *messages: tuple[float | None, float | None, float | None, bool]) -> list[str]:
        seen = [
            {"set": {"at_s": at_s, "delay": [delay, delay], "loss": [loss, loss]}, "stopped": stopped}
            for at_s, delay, loss, stopped in messages
        ]
        told: list[str] = page.evaluate(words, [first, [0, 300] if counts else [], seen])
        return told

    other, changed = "Ended: the delay is no longer", "Ended: the network was changed"
    clean = (3.5, 50.0, 0.0, False)
    for counts in (False, True):
        for then, why in (
            ((3.5, 50.0, 0.0, True), "Ended: the arms were stopped" if counts else ""),
            ((4.2, 50.0, 80.0, False), changed),
            ((4.2, 150.0, 0.0, False), other),
            ((4.2, None, 0.0, False), other),  # a profile
            ((None, 90.0, 0.0, False), other),  # a reset
            ((None, None, None, False), ""),  # netem does not answer, as at the end of the run
        ):
            [before, after] = found(counts, clean, then)
            assert before == ""
            assert after.startswith(why)
            assert bool(after) == bool(why)
    # what was set before the click may be the same delay
    assert found(False, (1.0, 50.0, 20.0, False), (3.5, 50.0, 0.0, False)) == ["", ""]


def test_the_targets_lie_on_a_ring_each_across_from_the_last(page: "Page") -> None:
    targets = _targets(page)
    assert len({(round(x, 6), round(y, 6)) for x, y in targets}) == len(targets) == 9
    assert [((x - 10) ** 2 + (y - 20) ** 2) ** 0.5 for x, y in targets] == pytest.approx([22.0] * 9)
    steps = [((x - a) ** 2 + (y - b) ** 2) ** 0.5 for (x, y), (a, b) in itertools.pairwise(targets)]
    assert steps == pytest.approx([steps[0]] * 8)
    assert steps[0] > 40


def test_a_task_ends_at_the_last_target_with_time_path_and_misses_from_the_first_on(page: "Page") -> None:
    targets = _targets(page)
    places: list[Any] = [
        [0, targets[3]],
        [100, targets[0]],
        [200, [10, 20]],
    ]  # before the first target nothing counts
    at_ms = 1000
    for k, target in enumerate(targets):
        if k == 4:  # through the target and out of it again
            places += [[at_ms, target], [at_ms + 100, [10, 20]]]
            at_ms += 200
        places += [[at_ms, target], [at_ms + 299, target], [at_ms + 300, target]]
        at_ms += 1000
    found = page.evaluate(_PLAY, places)
    assert (found["next"], found["misses"], found["over"]) == (9, 1, True)
    row = found["row"]
    assert row["time_s"] == pytest.approx(8.2)
    chord = ((targets[0][0] - targets[1][0]) ** 2 + (targets[0][1] - targets[1][1]) ** 2) ** 0.5
    assert row["path_mm"] == pytest.approx(8 * chord + 2 * 22)
    assert (row["delay_ms"], row["ghost"], row["n_misses"]) == (300, False, 1)


def test_another_target_an_older_picture_and_a_short_stay_count_for_nothing(page: "Page") -> None:
    targets = _targets(page)
    places = [[0, targets[1]], [400, targets[1]], [500, targets[0]], [450, targets[0]], [799, targets[0]]]
    assert page.evaluate(_PLAY, places)["next"] == 0
    assert page.evaluate(_PLAY, [*places, [800, targets[0]]])["next"] == 1


@pytest.mark.parametrize("text", [None, "", "{", "7", '[1, {"time_s": "x"}]'])
def test_what_another_page_left_in_the_storage_is_no_row(page: "Page", text: str | None) -> None:
    assert page.evaluate("(text) => window.touchTask.read(text)", text) == []


def test_rows_are_read_again(page: "Page") -> None:
    row = {"delay_ms": 0, "ghost": True, "time_s": 9.5, "path_mm": 400.0, "n_misses": 2}
    assert page.evaluate("(text) => window.touchTask.read(text)", json.dumps([row])) == [row]


def test_rows_are_saved_as_a_table_that_other_programs_read(page: "Page") -> None:
    row = {"delay_ms": 300, "ghost": False, "time_s": 9.5, "path_mm": 400.25, "n_misses": 2}
    (read,) = csv.DictReader(page.evaluate("(rows) => window.touchTask.csvOf(rows)", [row]).splitlines())
    assert read == {
        "delay_there_and_back_ms": "300", "with_ghost": "false", "time_s": "9.500", "arm_path_mm": "400.25",
        "n_misses": "2",
    }  # fmt: skip


def test_the_arm_never_leaves_the_picture(page: "Page") -> None:
    draw = Random(1)
    moves: list[tuple[list[list[float]], list[int]]] = []
    for _ in range(300):
        reach = draw.choice((1, 30, 120, 2000))
        places = [[draw.uniform(-reach, reach) for _ in range(3)] for _ in range(draw.choice((1, 2, 5)))]
        moves.append((places, draw.choice(([860, 540], [380, 240], [200, 600]))))
    for (_, (wide, high)), seen in zip(moves, page.evaluate(_FOLLOW, moves), strict=True):
        assert all(0.1 * wide <= x <= 0.9 * wide and 0.1 * high <= y <= 0.9 * high for x, y in seen)


def test_a_resting_picture_looks_at_its_home(page: "Page") -> None:
    ((first,), (second,)) = page.evaluate(_FOLLOW, [[[[5, 5, 0]], [860, 540]], [[[0, 0, 0]], [860, 540]]])
    assert second == [430, 270]
    assert first[0] > 430 > first[1]


def test_a_picture_without_height_does_not_shrink_the_next_for_ever(page: "Page") -> None:
    places = [[5, 5, 0], [-5, -5, 0]]
    sizes = [[800, 500], [800, 0], [0, 500], [800, 500]]
    before, *_, after = page.evaluate(_FOLLOW, [[places, size] for size in sizes])
    assert after == before
    assert page.evaluate(_FOLLOW, [[places, [800, 0]], [places, [800, 500]]]) == [None, before]


def test_no_name_lies_on_another_or_outside(page: "Page") -> None:
    draw = Random(2)
    for _ in range(200):
        names = [
            {"text": str(k), "x": draw.uniform(20, 360), "y": draw.uniform(30, 210), "width": draw.uniform(30, 120)}
            for k in range(6)
        ]
        taken = [{"left": 0, "y": 25, "width": 120}]
        found = page.evaluate("([n, t]) => window.pictureLayout.placed(n, t, [380, 240])", [names, taken])
        assert len(found) >= 4
        boxes = [*taken, *found]
        for k, one in enumerate(boxes):
            assert 0 <= one["left"] <= 380 - one["width"]
            for other in boxes[:k]:
                beside = one["left"] >= other["left"] + other["width"] or other["left"] >= one["left"] + one["width"]
                assert beside or abs(one["y"] - other["y"]) >= 18


def test_an_arrow_is_as_long_as_its_force_and_points_along_it(page: "Page") -> None:
    long, twice, deep, cut = page.evaluate(
        "(forces) => forces.map((force_n) => window.pictureLayout.arrowOf(force_n, 100))",
        [[1, 2, 0], [2, 4, 0], [0, 0, 5], [3000, 4000, 0]],
    )
    assert long["dx"] > 0 > long["dy"], "up on the canvas is towards smaller numbers"
    assert (twice["dx"], twice["dy"]) == pytest.approx((2 * long["dx"], 2 * long["dy"]))
    assert (deep["size_n"], deep["dx"], abs(deep["dy"])) == (5, 0, 0)
    assert (cut["dx"], cut["dy"], cut["isCut"]) == (pytest.approx(60), pytest.approx(-80), True)


@pytest.mark.parametrize("force_n", [None, [], [1, 2], [1, 2, None], ["9", 0, 0], [0, 0.05, 0], {"x": 1}])
def test_what_is_no_force_has_no_arrow_and_pushes_nobody(page: "Page", force_n: Any) -> None:
    assert page.evaluate("(force_n) => window.pictureLayout.arrowOf(force_n, 100)", force_n) is None
    assert page.evaluate("(force_n) => window.pictureLayout.yielded([0, 0, 0], force_n, 500)", force_n) is None


def test_a_hand_is_pushed_by_force_over_stiffness(page: "Page") -> None:
    found = page.evaluate("() => window.pictureLayout.yielded([1, 2, 3], [0, 5, -1], 500)")
    assert found == pytest.approx([1, 12, 1])
    assert page.evaluate("() => window.pictureLayout.yielded([1, 2, 3], [0, 5, -1], null)") is None


def test_a_force_is_told_with_its_age_and_its_limit(page: "Page") -> None:
    words = "(felt) => window.pictureLayout.feltWords(felt)"
    felt = {"hand_n": [3.0, 4.0, 0.0], "late_ms": 52.4, "limited": ""}
    assert "5.0 N" in page.evaluate(words, felt)
    assert "52 ms" in page.evaluate(words, felt)
    assert "tool 0 ms ago" in page.evaluate(words, {**felt, "late_ms": -2.3})
    assert len(page.evaluate(words, {**felt, "limited": "force"})) > len(page.evaluate(words, felt))
    assert "undefined" not in page.evaluate(words, {**felt, "late_ms": None, "limited": "toString"})


def test_a_loop_is_told_with_its_stiffness_and_theorys_limit(page: "Page") -> None:
    words = "(seen) => window.pictureLayout.loopWords(seen)"
    loop = {"state": "unstable", "over_s": 15.0, "young_s": 5.0, "swing": None}
    found = page.evaluate(words, {"loop": loop, "wall_n_m": 400, "limit_n_m": 188, "late_ms": 352.4})
    assert all(part in found for part in ("unstable", "last 15 s", "400 N/m", "188 N/m", "of now, 352 ms"))
    alone = page.evaluate(words, {"loop": {**loop, "state": "not_decidable"}, "wall_n_m": None, "limit_n_m": None})
    assert "do not tell" in alone
    assert "N/m" not in alone
    early = {"loop": {**loop, "over_s": 2.0}, "wall_n_m": 400, "limit_n_m": 294, "late_ms": 5}
    assert "294" not in page.evaluate(words, early)  # a round trip of before the change
    assert "touches nothing" in page.evaluate(words, {"loop": {**loop, "state": "not_decidable", "stands": "free"}})
    assert page.evaluate(words, {"loop": None, "wall_n_m": 400}) == ""
    assert page.evaluate(words, {"loop": {"state": "constructor"}}) == ""


def test_a_swing_too_small_to_be_seen_is_told_with_its_growth(page: "Page") -> None:
    words = "(loop) => window.pictureLayout.loopWords({ loop })"
    swing = {"size_mm": 0.0213, "growth_pct": 9.24, "seen_in_s": 41.7}
    loop = {"state": "unstable", "over_s": 15.0, "young_s": 5.0, "swing": swing}
    grows = "a swing of 0.02 mm grows by 9 % a period"
    assert page.evaluate(words, loop) == f"The loop is unstable: {grows}; it will be seen in some 42 s."
    wide = {**swing, "size_mm": 3.14, "seen_in_s": None}
    assert page.evaluate(words, {**loop, "swing": wide}).endswith("over the last 15 s: the hand swings, by 3 mm.")
    assert f"stable: {grows}." in page.evaluate(words, {**loop, "state": "not_decidable"})
    young = page.evaluate(words, {**loop, "state": "not_yet", "over_s": 2.0, "swing": None})
    assert young.startswith("Not judged yet: 2 of 5 s.")


@pytest.mark.parametrize(
    ("late_ms", "network_ms", "rate_hz", "shares"),
    [
        (233.0, 200.1, 30, ("230 ms", "200 ms", "30 ms")),
        (666.0, 600.2, 30, ("670 ms", "600 ms", "70 ms")),
        (71.4, 0.3, 30, ("71 ms", "0 ms", "71 ms")),
        (1266.0, 1200.0, 30, ("1.27 s", "1.20 s", "70 ms")),
        (105.0, 97.4, 200, ("105 ms", "97 ms", "8 ms")),
    ],
)
def test_the_parts_of_the_lateness_add_up_as_they_are_read(
    page: "Page", late_ms: float, network_ms: float, rate_hz: int, shares: tuple[str, str, str]
) -> None:
    found = page.evaluate("([...each]) => window.pictureLayout.sharesOf(...each)", [late_ms, network_ms, rate_hz])
    assert (found["whole"], found["part"], found["rest"]) == shares


def test_what_waits_for_the_ticks_depends_on_the_delay_and_is_there_without_a_network(page: "Page") -> None:
    words = "([...each]) => window.pictureLayout.partsWords(...each)"
    found = page.evaluate(words, [330, 300, 3, 30])
    assert (
        "takes 300 ms both ways (medians of the last 3 s, of the same messages); the rest, 30 ms, is waiting" in found
    )
    assert "depends on how the delay falls between them. " in found
    assert "Without a network it is one to two ticks, 33 ms to 67 ms at 30 Hz. How far the arm is behind" in found
    assert "one to two ticks. " in page.evaluate(words, [330, 300, 3, 0])
    assert (
        page.evaluate(words, [90, 100, 3, 30])
        == " The network took 100 ms both ways (medians of the last 3 s, of the same messages)."
    )


def test_a_page_that_is_late_does_not_blame_the_picture(page: "Page") -> None:
    def silence(drawn_ms: float, unlooked_ms: float | None, came_ms: float) -> Any:
        words = "([...each]) => window.pictureLayout.silence(...each)"
        return page.evaluate(words, [drawn_ms, unlooked_ms, came_ms])

    assert silence(400, 300, 400) is None
    still = silence(3500, 600, 3500)
    assert (still["state"], still["text"]) == ("frozen", "No newer picture for 3.5 s.")
    late = silence(3500, 2900, 3500)
    assert late["state"] == "late"
    assert late["text"].startswith("This page is 2.9 s late")
    assert silence(900, 606, 850) is None, "nothing is known that would be late or missing: answers come as often"
    slow = silence(1100, 200, 300)  # pictures came, and the page drew none
    assert slow["text"].startswith("This page is 1.1 s late")
    assert silence(3500, None, 3500) is None
