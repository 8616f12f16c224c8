"""What an observer knows of the surgeon's displays, beside rows worked by hand."""

from math import sqrt

import pytest

from tests.deploy.watch.making import LEFT, sighting
from tis.common.messages import FeedbackPose, PredictedPose, Quaternion, Vector3
from tis.common.units import NS_PER_MS
from tis.deploy.watch.book import LiveBook
from tis.deploy.watch.displays import ArmRow, DisplayRow, Displays

_LEVEL = Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)


def _display(t_ms: int, shown_m: float, predicted_m: float, late_ms: int = 200) -> bytes:
    message = PredictedPose(
        sample_ns=t_ms * NS_PER_MS, position_m=Vector3(x=predicted_m, y=0.0, z=0.0), orientation=_LEVEL,
        gripper_rad=0.0, hand="left", tick=0, shown_tick=0, shown_m=Vector3(x=shown_m, y=0.0, z=0.0),
        command_ns=(t_ms - late_ms) * NS_PER_MS, round_trip_ns=180 * NS_PER_MS,
    )  # fmt: skip
    return message.model_dump_json().encode()


def _arm(t_ms: int, x_m: float, command_ms: int | None) -> bytes:
    message = FeedbackPose(
        sample_ns=t_ms * NS_PER_MS, position_m=Vector3(x=x_m, y=0.0, z=0.0), orientation=_LEVEL, gripper_rad=0.0,
        tick=0, command_sample_ns=None if command_ms is None else command_ms * NS_PER_MS,
    )  # fmt: skip
    return message.model_dump_json().encode()


def _filled() -> Displays:
    displays = Displays("tis")
    for t_ms, shown_m, predicted_m in ((1000, 0.010, 0.014), (1100, 0.012, 0.018), (1200, 0.014, 0.022)):
        displays.take("west", "tis/PSM2/predicted_cp", _display(t_ms, shown_m, predicted_m), 0)
    # the command of 1000 ms acts at 1130 ms; that of 1100 was lost, so 1200 acts in its place; nothing acts after it
    for t_ms, x_m, command_ms in ((1090, 0.009, 990), (1130, 0.015, 1000), (1340, 0.019, 1200)):
        displays.take("east", "tis/PSM2/measured_cp", _arm(t_ms, x_m, command_ms), 0)
    return displays


def test_errors_are_against_the_arm_that_has_the_command() -> None:
    found = _filled().errors(0)
    assert found is not None
    # 10 and 14 mm against 15; 12 and 18, and 14 and 22, against 19
    assert found.feedback_mm == pytest.approx(sqrt((5**2 + 7**2 + 5**2) / 3))
    assert found.predicted_mm == pytest.approx(sqrt((1**2 + 1**2 + 3**2) / 3))


def test_only_displays_of_the_window_count() -> None:
    found = _filled().errors(1_150 * NS_PER_MS)
    assert found is not None
    assert (found.feedback_mm, found.predicted_mm) == pytest.approx((5.0, 3.0))
    assert _filled().errors(2_000 * NS_PER_MS) is None
    assert Displays("tis").errors(0) is None


def test_rows_are_kept_by_arm_and_only_newer_readable_ones_are_added() -> None:
    displays = _filled()
    key, other = "tis/PSM2/predicted_cp", "tis/PSM2/measured_cp"
    for payload in (b"", b"{}", b'{"sample_ns": 1}', _display(1200, 9.0, 9.0), _display(99_000, 9.0, 9.0)):
        displays.take("west", key, payload, 1_300 * NS_PER_MS)
    for payload in (_arm(1300, 9.0, 1200), _arm(1400, 9.0, None), b"\xff"):
        displays.take("east", other, payload, 1_300 * NS_PER_MS)
    newest = displays.rows["PSM2"].all()[-1]
    assert newest == DisplayRow(1_200 * NS_PER_MS, (0.014, 0.0, 0.0), (0.022, 0.0, 0.0), 200 * NS_PER_MS)
    assert displays.arms["PSM2"].all()[-1] == ArmRow(1_340 * NS_PER_MS, (0.019, 0.0, 0.0), 1_200 * NS_PER_MS)
    assert displays.rows["PSM1"].n == 0


def test_the_book_listens_to_the_display_in_the_west_and_to_the_arm_in_the_east() -> None:
    book = LiveBook("tis")
    assert sorted(book.displays.keys("west")) == ["tis/PSM1/predicted_cp", "tis/PSM2/predicted_cp"]
    assert sorted(book.displays.keys("east")) == ["tis/PSM1/measured_cp", "tis/PSM2/measured_cp"]
    for network, channel, payload in (
        ("west", LEFT.predicted, _display(1000, 0.010, 0.014)),
        ("west", LEFT.measured, _arm(1010, 9.0, 1000)),  # as it arrives: that is no news
        ("east", LEFT.measured, _arm(1130, 0.015, 1000)),
    ):
        book.take(sighting(network, channel, 0, 0, 0, payload))  # type: ignore[arg-type]
    assert book.figures().display == pytest.approx((5.0, 1.0))
