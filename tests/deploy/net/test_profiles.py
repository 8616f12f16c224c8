"""The library: every profile is whole, accounts for its numbers, and amounts to what its source says."""

import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.stats import poisson

from tis.common.errors import InputError
from tis.common.scenario.control import profile_requests
from tis.deploy.net.profiles import (
    SHIPPED,
    build_profile,
    dump_profile,
    find_profile,
    library,
    read_profile,
    shipped_names,
)
from tis.deploy.studies.paper.cells import ROWS, PaperRow
from tis.netem.expected.figures import direction_figures
from tis.netem.expected.simulate import simulate

EXPECTED = {
    *(f"paper_{n}" for n in range(1, 7)),
    *(f"paper_{n}_samples" for n in range(1, 6)),
    *(f"netfi_{kind}_{n}" for kind in ("dlm", "plm", "clm") for n in (1, 2, 3)),
    *("urllc_5g_28ghz", "mmwave_5g_sa_26ghz", "midband_5g_sa_3g7", "lte_netfi", "wifi_bad"),
    *("telesurgery_5g_china_2025", "telesurgery_5g_urology_2024", "telesurgery_swine_2020", "lindbergh_2001"),
    *("transatlantic_fiber", "starlink_2022_eu", "geo_satellite"),
    *("starlink_2025", "lte_handover", "nr_handover", "private_5g", "hospital_wifi", "ambulance_lte"),
    *("bufferbloated_access", "fiber_new_york_london"),
}


def test_the_library_is_complete() -> None:
    assert set(shipped_names()) == EXPECTED


@pytest.mark.parametrize("name", shipped_names())
def test_a_profile_is_named_as_its_file_and_survives_yaml(name: str) -> None:
    profile = read_profile(SHIPPED / f"{name}.yaml")
    assert profile.name == name
    assert build_profile(yaml.safe_load(dump_profile(profile)), "again") == profile


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"row {row.number}")
def test_the_papers_profiles_are_the_rows_of_its_table(row: PaperRow) -> None:
    # no trial is long enough for row 6 in samples
    readings = {f"paper_{row.number}": 1.0} | ({f"paper_{row.number}_samples": 1000 / 30} if row.number < 6 else {})
    for name, scale in readings.items():
        forward = find_profile(name).network.forward
        assert forward.delay is not None
        assert forward.loss is not None
        assert forward.jitter is not None
        delay = forward.delay.model_dump()
        bounds = [delay.get(bound, delay.get("delay_ms")) for bound in ("low_ms", "high_ms")]
        assert bounds == pytest.approx([scale * row.low_ms, scale * row.high_ms], rel=1e-5)
        assert forward.loss.model_dump()["p_loss"] == pytest.approx(row.loss_pct / 100)
        assert forward.jitter.model_dump()["std_ms"] == pytest.approx(scale * row.jitter_ms, rel=1e-5)


@pytest.mark.parametrize(
    ("name", "mean_ms"),
    [
        ("netfi_dlm_1", 100.0),
        ("netfi_dlm_2", 299.2),
        ("netfi_dlm_3", 500.1),
        ("lte_netfi", 53.0),
        ("transatlantic_fiber", 58.95 / 2),
        ("geo_satellite", 300),
        ("telesurgery_5g_urology_2024", 55.30 / 2),
        ("telesurgery_5g_china_2025", 38.38 / 2),
    ],
)
def test_means_are_those_of_the_source(name: str, mean_ms: float) -> None:
    assert direction_figures(find_profile(name).network, "feedback").mean_ms == pytest.approx(mean_ms, abs=0.06)


@pytest.mark.parametrize(
    ("name", "loss_pct", "outage_pct"),
    [
        ("netfi_plm_1", 9.8, 0),
        ("netfi_plm_2", 30.4, 0),
        ("netfi_plm_3", 50.4, 0),
        ("netfi_clm_1", 0, 15.0),
        ("netfi_clm_2", 0, 33.3),
        ("netfi_clm_3", 0, 50.0),
    ],
)
def test_losses_are_the_real_ones(name: str, loss_pct: float, outage_pct: float) -> None:
    for direction in ("forward", "feedback"):
        of = direction_figures(find_profile(name).network, direction)
        assert of.loss_pct == pytest.approx(loss_pct, abs=0.05)
        assert of.outage_pct == pytest.approx(outage_pct, abs=0.05)


@pytest.mark.parametrize(
    ("name", "mean_ms", "std_ms", "loss_pct"),
    [
        ("telesurgery_5g_urology_2024", 55.30, 39.64, None),
        ("telesurgery_swine_2020", 114.0, 0.0, 1.20),
        ("telesurgery_5g_china_2025", 38.38, 0.39, None),
    ],
)
def test_figures_of_round_trips_are_those_of_the_source(
    name: str, mean_ms: float, std_ms: float, loss_pct: float | None
) -> None:
    """Of a message and its answer: the two ways are drawn independently, with keys of their own."""
    network, n = find_profile(name).network, 400_000
    offered_ns = np.arange(n) * 40_000_000
    there = simulate(network, "forward", 1, offered_ns, key="there")
    back = simulate(network, "feedback", 1, offered_ns, key="back")
    through = ~(there.lost | back.lost)
    round_trip_ms = (there.delay_ns + back.delay_ns)[through] / 1e6
    assert round_trip_ms.mean() == pytest.approx(mean_ms, rel=0.03)
    assert round_trip_ms.std() == pytest.approx(std_ms, rel=0.05, abs=1e-3)
    if loss_pct is not None:
        assert 100 * (1 - through.mean()) == pytest.approx(loss_pct, rel=0.05)


@pytest.mark.parametrize(
    ("name", "down", "up"),
    [
        ("urllc_5g_28ghz", (0.763, 1.080, 2.444), (0.687, 0.916, 1.091)),
        ("mmwave_5g_sa_26ghz", (1.503, 2.370, 6.812), (2.489, 2.873, 3.135)),
        ("midband_5g_sa_3g7", (5.299, 10.84, 14.70), (6.411, 9.945, 13.07)),
    ],
)
def test_the_quantiles_of_5g_are_the_published_ones(
    name: str, down: tuple[float, ...], up: tuple[float, ...]
) -> None:
    network = find_profile(name).network
    for pipeline, published in ((network.forward, down), (network.feedback, up)):
        assert pipeline.delay is not None
        assert pipeline.delay.kind == "quantiles"
        points = {point.p: point.delay_ms for point in pipeline.delay.points}
        assert (points[0.5], points[0.99], points[0.9999]) == published


def test_bad_wifi_is_the_published_formula() -> None:
    """Poisson(1) - U(0, 1), with probability 6 / 84 in addition 7.5 (Poisson(12) - U(0, 1)): drawn, at J = 7 ms."""
    rng = np.random.default_rng(8)
    n = 400_000
    short = rng.poisson(1, n).astype(float)
    short -= np.where(short > 0, rng.random(n), 0)
    long = rng.poisson(12, n).astype(float)
    long -= np.where(long > 1, rng.random(n), 0)
    drawn = short + np.where(rng.random(n) < 6 / 84, 7.5 * long, 0)
    delay = find_profile("wifi_bad").network.forward.delay
    assert delay is not None
    assert delay.kind == "quantiles"
    p, ms = np.array([(point.p, point.delay_ms) for point in delay.points]).T
    table = np.interp(np.sort(rng.random(n)), p, ms)
    assert table.mean() == pytest.approx(drawn.mean(), rel=0.02)
    assert np.quantile(table, [0.5, 0.9, 0.99, 0.999]) == pytest.approx(
        np.quantile(drawn, [0.5, 0.9, 0.99, 0.999]), rel=0.02
    )
    assert np.mean(drawn == 0) == pytest.approx(poisson.pmf(0, 1) * (1 - 6 / 84), abs=0.003)
    assert p[np.flatnonzero(ms == 0)[-1]] == pytest.approx(poisson.pmf(0, 1) * (1 - 6 / 84), abs=0.001)


def test_bad_wifi_loses_nothing_and_says_so() -> None:
    profile = find_profile("wifi_bad")
    assert (profile.network.forward.loss, profile.network.feedback.loss, profile.network.outages) == (None, None, ())
    assert "no loss" in profile.title


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("name: x\ntitle: X\nnetwork: {}\n", "sources: is required"),
        ("- a\n", "must be a mapping"),
        ("name: x\nname: y\n", "line 2"),
        ("\0", "not YAML"),
        ("name: x y\ntitle: X\nsources: {a: b}\nnetwork: {}\n", "name: must consist of at most 64"),
        (
            "name: x\ntitle: X\nsources: {a: b}\nnetwork: {forward: {delay: {kind: quantiles, points: "
            "[{p: 0, delay_ms: 2}, {p: 1, delay_ms: 1}]}}}\nnumbers: [{of: forward, source: a, basis: measured}]\n",
            "network.forward.delay: points must have strictly ascending p",
        ),
    ],
)
def test_a_bad_file_is_refused_with_its_name(tmp_path: Path, text: str, rule: str) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        read_profile(path)
    assert str(caught.value).startswith(str(path))
    assert rule in str(caught.value)


def test_the_manual_names_those_that_cannot_be_set_while_a_network_runs() -> None:
    manual = (Path(__file__).parents[3] / "docs/emulator/describe_network.md").read_text(encoding="utf-8")
    (sentence,) = re.findall("Of the library it refuses (.*?):", manual, re.DOTALL)
    refused = []
    for name in shipped_names():
        try:
            profile_requests(name, library(name))
        except InputError:
            refused.append(name)
    assert re.findall("`(.*?)`", sentence) == refused


def test_a_file_that_is_not_there_is_named() -> None:
    with pytest.raises(InputError, match="must be a profile of the library or a file"):
        find_profile("nowhere.yaml")
