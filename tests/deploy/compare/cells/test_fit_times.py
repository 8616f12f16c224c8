import time

import pytest

from tis.deploy.compare.cells.cell import FitTimes


@pytest.fixture
def fits(monkeypatch: pytest.MonkeyPatch) -> FitTimes:
    """Return the times of an identification of 10 s: 1 s for `arx_kf`, 2 s twice for `paper`, 5 s for all."""
    now_s = iter([0.0, 1.0, 3.0, 5.0, 7.0, 9.0])
    monkeypatch.setattr(time, "process_time", lambda: next(now_s))
    times = FitTimes()
    for name in ("arx_kf", "paper", "paper"):
        with times.stage(name):
            pass
    return times


@pytest.mark.parametrize(
    ("name", "alone_s"), [("hold", 5.0), ("arx_kf", 6.0), ("paper", 9.0), ("paper_as_printed", 9.0)]
)
def test_an_estimator_alone_takes_the_common_part_and_its_own(fits: FitTimes, name: str, alone_s: float) -> None:
    assert fits.alone_s(name, 10.0) == alone_s


def test_a_fit_that_fails_has_taken_its_time(fits: FitTimes, monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = iter([0.0, 4.0])
    monkeypatch.setattr(time, "process_time", lambda: next(now_s))
    with pytest.raises(ValueError, match="no"), fits.stage("direct_ls"):
        raise ValueError("no")
    assert fits.alone_s("direct_ls", 14.0) - fits.alone_s("hold", 14.0) == 4.0
