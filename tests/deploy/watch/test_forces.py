"""Forces of touch that an observer sees, and what it refuses to believe."""

from typing import Any

import pytest

from tis.common.messages import ShownForce, Vector3, Wrench, encode
from tis.common.units import NS_PER_MS, NS_PER_S
from tis.deploy.watch.book import LiveBook, Sighting
from tis.deploy.watch.forces import Forces

_BACK, _SHOWN = "tis/PSM2/measured_cf", "tis/MTML/servo_cf"


def _along_y(value: float) -> Vector3:
    return Vector3(x=0.0, y=value, z=0.0)


def _wrench(t_ms: int, force_n: float) -> bytes:
    return encode(
        Wrench(
            sample_ns=t_ms * NS_PER_MS, tick=0, force_n=_along_y(force_n), energy_j=None, wave=None, active=True,
            command_sample_ns=None,
        )
    )  # fmt: skip


def _shown(t_ms: int, force_n: float, y_m: float, **other: Any) -> bytes:
    fields: dict[str, Any] = {
        "sample_ns": t_ms * NS_PER_MS, "hand": "left", "tick": 0, "position_m": _along_y(y_m),
        "intended_m": _along_y(0.0), "force_n": _along_y(force_n), "age_ns": 0, "limited": "", "sent": True,
        "command_ns": None,
    }  # fmt: skip
    return encode(ShownForce(**fields | other))


def test_a_row_has_both_forces_how_late_the_one_on_the_tool_is_and_the_energy_so_far() -> None:
    forces = Forces("tis")
    assert forces.take(_BACK, _wrench(1000, 3.0), NS_PER_S)
    # 2 N held over 10 mm along it give 20 mJ; then 1 N over 30 mm against it take 30 mJ
    for t_ms, force_n, y_m in ((1010, 2.0, 0.0), (1020, 1.0, 0.010), (1030, 0.0, -0.020)):
        assert forces.take(_SHOWN, _shown(t_ms, force_n, y_m), NS_PER_S)
    rows = forces.rows["PSM2"].all()
    assert [row.hand_n[1] for row in rows] == [2.0, 1.0, 0.0]
    assert [row.late_ns for row in rows] == [10 * NS_PER_MS, 20 * NS_PER_MS, 30 * NS_PER_MS]
    assert rows[-1].tool_n == (0.0, 3.0, 0.0)
    assert [row.put_in_j for row in rows] == pytest.approx([0.0, -0.020, 0.010])
    assert rows[-1].most_given_j == pytest.approx(0.020)


def test_at_1_khz_every_message_counts_and_every_tenth_is_kept() -> None:
    forces = Forces("tis")
    for t_ms in range(1000, 2000):
        forces.take(_SHOWN, _shown(t_ms, 1.0, 1e-5 * (t_ms - 1000)), NS_PER_S)
    assert forces.rows["PSM2"].n == 100
    assert forces.newest["PSM2"].put_in_j == pytest.approx(-999e-5)


@pytest.mark.parametrize(
    "payload",
    [
        b"", b"{}", b"\xff", b"[" * 5000, _shown(1000, 9.0, 0.0), _shown(1010, 9.0, 0.0, hand="right"),
        _shown(20_000, 9.0, 0.0), _shown(1010, 1001.0, 0.0), _shown(1010, float("nan"), 0.0),
    ],
)  # fmt: skip
def test_what_is_none_is_old_of_the_other_hand_far_ahead_or_too_strong_is_ignored(payload: bytes) -> None:
    forces = Forces("tis")
    forces.take(_SHOWN, _shown(1000, 1.0, 0.0), NS_PER_S)
    assert forces.take(_SHOWN, payload, NS_PER_S)
    assert forces.newest["PSM2"].hand_n == (0.0, 1.0, 0.0)
    assert forces.rows["PSM2"].n == 1


def test_a_force_of_the_tool_beyond_belief_is_ignored_and_a_leap_gives_no_energy() -> None:
    forces = Forces("tis")
    for payload in (_wrench(1000, 3.0), _wrench(1010, 10_001.0), _wrench(900, 1.0), _wrench(99_000, 1.0), b"{}"):
        forces.take(_BACK, payload, NS_PER_S)
    forces.take(_SHOWN, _shown(1010, 1.0, 0.0), NS_PER_S)
    forces.take(_SHOWN, _shown(1020, 1.0, 1e9), NS_PER_S)
    assert forces.newest["PSM2"].tool_n == (0.0, 3.0, 0.0)
    assert forces.newest["PSM2"].put_in_j == 0.0


def test_the_book_hears_forces_in_the_west_only() -> None:
    book = LiveBook("tis")
    assert sorted(book.forces.keys()) == ["tis/MTML/servo_cf", "tis/MTMR/servo_cf", "tis/PSM1/measured_cf", _BACK]
    for network in ("east", "west"):
        assert book.forces.newest == {}
        book.take(Sighting(network, _SHOWN, 0, b"", _shown(1000, 1.0, 0.0)))
    assert book.forces.newest["PSM2"].hand_n == (0.0, 1.0, 0.0)
