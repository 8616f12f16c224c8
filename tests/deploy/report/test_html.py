"""The report: one file, the answer first, whatever is left of a run; and it opens in a browser without a network."""

import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from tests.deploy.report import hand_made
from tests.deploy.report.hand_made import (
    COMMAND,
    a_scenario,
    crossing,
    estimate,
    fresh,
    message,
    tick,
    truth,
    write_log,
    write_run,
)
from tests.deploy.report.outline import Outline
from tests.deploy.report.partial import summary_of
from tests.patient_side.arm_models import static_model
from tis.common.channels import Side
from tis.common.scenario import Scenario
from tis.deploy.logs.read.clocks import SideClock
from tis.deploy.logs.read.load import RunLogs, load_run
from tis.deploy.present import page as shell
from tis.deploy.present.numbers import number
from tis.deploy.present.page import nonbreaking_units
from tis.deploy.present.palette import TONES, look_of
from tis.deploy.report.answer import answer
from tis.deploy.report.contents import report_html
from tis.deploy.report.measured_run import MeasuredRun
from tis.deploy.report.run_view import RunView, arms_of
from tis.deploy.report.summarise import build_summary
from tis.deploy.report.summary import Summary
from tis.deploy.run.conclude import Ending, Outputs, conclude
from tis.deploy.run.resolve import resolve
from tis.deploy.run.twin import build_sides, run_twin
from tis.deploy.shell import run_dir as folder

DURATION_S = 8.0
SIDES: tuple[Side, ...] = ("surgeon", "netem", "patient")
MODEL = static_model()
_COMPLAINT = re.compile(r":(ERROR|WARNING):CONSOLE|uncaught|violates|failed|error", re.IGNORECASE)
_FIGURE = re.compile(r"-|[-\u00b1]?\d[\d.]*(e[-+]\d+)?( (to|\u00b1) [-\d.]+)?|not resolvable|about .*")
LOSSY = (
    "limits.end_to_end_p99_ms=100",
    "limits.p_loss_max=0.5",
    "network.forward.ordering=drop_late",
    "network.timeline=[{at_s: 4, for_s: 1, set: {outage: true}}]",
)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run with two hands, a servo, loss, reordering, an outage and limits, with its report."""
    path = tmp_path_factory.mktemp("finished")
    scenario = resolve("lossy", LOSSY, None, DURATION_S)
    nodes, models, _ = build_sides(scenario)
    folder.write(path / folder.SCENARIO_FILE, "")
    run_twin(scenario, nodes, models, path)
    ending = Ending("twin", "tis twin lossy --set 'a=<b>'", 0, {})
    conclude(path, scenario, ending, Console(quiet=True), Outputs(merge=False))
    return path


def _page(path: Path) -> Outline:
    return Outline((path / "report.html").read_text())


def _summary_of(path: Path) -> dict[str, Any]:
    summary = folder.read_json(path / "summary.json")
    assert summary is not None
    return summary


def test_the_file_needs_nothing_else_and_is_small(finished: Path) -> None:
    page = (finished / "report.html").read_text()
    found = Outline(page)
    beside = {given["href"] for given, _ in found.all("a") if not given["href"].startswith("#")}
    assert beside == {"scenario.yaml", "model.json", "summary.json", "manifest.json"}  # links are not fetched
    fetched = [target for target in found.fetched if target not in beside]
    assert all(target.startswith(("#", "data:")) for target in fetched), fetched
    policy = next(given["content"] for given, _ in found.all("meta") if "http-equiv" in given)
    assert policy.startswith("default-src 'none';")
    assert "http" not in policy
    css = re.findall(r"<style>(.*?)</style>", page, re.DOTALL)
    assert len(css) == 1
    scripts = [shell.text_of(name) for name in shell.SCRIPTS]
    script = "".join(scripts)
    assert script in page
    for fetching in ("@import", "url(", "fetch(", "XMLHttpRequest", "import(", "http:", "https:", "//cdn"):
        assert fetching not in css[0] + script, fetching
    assert (finished / "report.html").stat().st_size < 1_975_000  # that of a minute is some 30 % larger


def test_the_answer_comes_first_and_then_what_it_rests_on(finished: Path) -> None:
    summary, text = _summary_of(finished), _page(finished).text
    words = nonbreaking_units(answer(Summary.model_validate(summary), resolve("lossy", LOSSY, None, DURATION_S)))
    parts = [
        "lossy", "valid measurement", "synthetic movement", "seed 7", "8 s",
        words, "How late", "How lossy", "How accurate", "the scenario's limits",
        "Error over time: left hand", "Error over time: right hand", "Verdict on each set of requirements",
        "the scenario's limits", "Accuracy at the tick, left hand", "Accuracy at the tick, right hand",
        "Path in space: left hand", "Path in space: right hand", "Position over time: left hand (PSM2, synthetic)",
        "Position over time: right hand (PSM1, synthetic)", "Where the time goes", "one clock",
        "The model in numbers", "spectral radius", "singular values, left hand", "Delay over time", "outage",
        "How the latency is distributed", "limit", "Error against age", "How the delays are distributed",
        "How losses are bunched", "faithful",
        "forward: the network was the one that the scenario requests", "requested, decided and realised",
        "tis/MTML/measured_cp, forward", "delay, requested", "delay, decided", "delay, realised", "RFC 3550 jitter",
        "Unplanned loss: 0.", "Packets, by direction", "In virtual time every tick",
        "tis twin lossy --set 'a=<b>'", "The seed 7 determines", "Versions", "eclipse-zenoh",
    ]  # fmt: skip
    at = 0
    for part in parts:
        assert part in text[at:], part
        at = text.index(part, at)
    for entries in summary["accuracy_by_hand"].values():
        for entry in entries.values():
            assert number(entry["rmse_3d_mm"]) in text
    for verdict in summary["verdicts"]:
        assert verdict["title"] in text
        assert verdict["source"] in text


def test_the_first_figure_after_the_answer_is_the_error_of_estimate_and_hold(finished: Path) -> None:
    page = (finished / "report.html").read_text()
    first = page[page.index("<figure aria-labelledby") :]
    assert re.match(r'<figure aria-labelledby="error-1"', first)
    pressed = re.findall(r'data-series="([^"]+)" aria-pressed="true"', first[: first.index("</figure>")])
    assert set(pressed) == {"hold", "innovations_kf"}


def test_all_tables_are_of_one_style(finished: Path) -> None:
    """Each column has a name; words stand at the left, and what stands at the right is a number without a unit."""
    page = _page(finished)
    heads = [(given, text) for given, text in page.all("th") if given["scope"] == "col"]
    assert len(heads) > 40
    assert all(text for _, text in heads)
    assert not [text for _, text in heads if re.search(r"\bp50\b|average", text)]
    words = [text for given, text in page.all("td") if given.get("class") != "text" and not _FIGURE.fullmatch(text)]
    assert words == []


def test_the_figures_at_the_top_say_which_statistic_they_are_and_what_lies_between(finished: Path) -> None:
    text = " ".join(_page(finished).text.replace("\u00a0", " ").split())
    late = _summary_of(finished)["latency_ms"]["end_to_end"]
    tile = f"from a new sample to the estimate with it; in 99 of 100 cases at most {number(late['p99'])} ms (p99)"
    assert f"median, end to end: {tile}" in text
    assert f"is {number(late['p50'])} ms old in the median, and at most {number(late['p99'])} ms in 99 of 100" in text
    assert "RMSE of innovations_kf, in 3D" in text
    assert "It can be below a link's one-way delay" in text
    assert "topology observer" not in text


def test_in_topology_observer_the_page_says_whose_latency_it_is(tmp_path: Path) -> None:
    page = _report(write_run(tmp_path, **_a_run()), a_scenario(topology="observer"))
    assert "Here, in topology observer, commands cross unimpaired" in page


def test_every_figure_says_what_to_see_and_has_words_for_a_screen_reader(finished: Path) -> None:
    page = (finished / "report.html").read_text()
    figures = re.findall(r'<figure aria-labelledby="[^"]+"[^>]*>(.*?)</figure>', page, re.DOTALL)
    # two hands: position, two errors, two ages, path, set point, singular values, poles; delay, two distributions,
    # losses
    assert len(figures) == 2 * 9 + 4
    for figure in figures:
        says = re.search(r'<figcaption><h3 id="[^"]+">[^<]+</h3><p>([^<]+)</p></figcaption>', figure)
        alt = re.search(r'role="group" aria-label="([^"]+)"', figure)
        assert says
        assert alt
        assert says[1].endswith(".")
        assert len(says[1]) > 60
        assert len(alt[1]) > 30
    # in nearly all the sentence has figures of this run in it
    assert sum(bool(re.search(r"<p>[^<]*\d", figure)) for figure in figures) >= len(figures) - 1


def test_nobody_stumbles_over_the_page(finished: Path) -> None:
    found = _page(finished)
    assert found.faults() == []
    first = next(given for given, text in found.all("a") if text.startswith("Skip"))
    assert first["href"] == "#answer"
    assert found.tags.index("a") < found.tags.index("header")
    toggles = [given for given, _ in found.all("button") if "data-series" in given]
    assert {given["aria-pressed"] for given in toggles} == {"true", "false"}
    assert {"truth", "hold", "moesp_kf", "lost"} <= {given["data-series"] for given in toggles}


def test_every_name_that_can_be_pressed_is_that_of_something_drawn(finished: Path) -> None:
    page = (finished / "report.html").read_text()
    drawn = set(re.findall(r'"name":"([^"]+)"', page))
    assert {given["data-series"] for given, _ in Outline(page).all("button") if "data-series" in given} <= drawn


def test_every_colour_of_a_figure_has_one_for_a_dark_page(finished: Path) -> None:
    page = (finished / "report.html").read_text()
    known = {tone.light for tone in TONES}
    used = set(re.findall(r'"[a-z_]+_color":(?:\{"type":"value","value":)?"(#[0-9a-f]{6})"', page))
    assert len(used) > 8
    assert used <= known


def test_a_synthetic_source_is_named_in_every_part_that_shows_the_movement(finished: Path) -> None:
    page = (finished / "report.html").read_text()
    for anchor in ("answer", "error", "accuracy", "path", "distributions", "model"):
        section = page[page.index(f'<section id="{anchor}"') :]
        assert '<span class="tag open">synthetic</span></h2>' in section[:400], anchor
    recorded = a_scenario(source={"kind": "jigsaws"}, rate_hz=30)
    summary = _summary_of(finished) | {"source": "recorded Suturing D002, left hand"}
    for model in summary["identification_by_hand"].values():
        model["pairing"] = "MTML -> PSM2 (by name)"
    logs = load_run(finished)
    assert "synthetic" not in Outline(_report(logs, recorded, summary)).text


def _report(logs: RunLogs, scenario: Scenario, summary: dict[str, Any] | None = None) -> str:
    if summary is None:
        summary = build_summary(logs, scenario, (MODEL,), "live", None, "tis run x.yaml")
    return _page_of(logs, scenario, Summary.model_validate(summary), {})


def _page_of(logs: RunLogs, scenario: Scenario, summary: Any, versions: dict[str, str | None]) -> str:
    return report_html(RunView(MeasuredRun(logs, scenario, arms_of(scenario, {})), summary, versions))


def _a_run() -> dict[Side, list[Any]]:
    """Three commands that arrive, the estimates of them, and some that can be scored."""
    surgeon = [message(COMMAND, k, 33 * k + 0.5, sample_ms=33 * k) for k in range(3)]
    surgeon += [hand_made.answer(k, 33 * k + 18, 33 * k, log_ms=33 * k + 29) for k in range(3)]
    surgeon += [truth(k, 100 * k, (0.001 * k, 0, 0)) for k in range(60)]
    netem = [record for k in range(3) for record in crossing(COMMAND, k, 33 * k + 0.5)]
    patient = [message(COMMAND, k, 33 * k + 0.5, log_ms=33 * k + 11, sample_ms=33 * k) for k in range(3)]
    for k in range(3):
        patient += [
            tick(k, 33 * k + 15, 33 * k + 15.1),
            fresh(k, k, 33 * k),
            hand_made.answer(k, 33 * k + 18, 33 * k),
        ]
        patient += [estimate(k, 2100 + 100 * k, name, (0.02, 0, 0)) for name in ("hold", "innovations_kf")]
    return {"surgeon": surgeon, "netem": netem, "patient": patient}


def test_a_run_without_any_log_gives_a_page_that_says_so(tmp_path: Path) -> None:
    scenario = a_scenario(limits={"end_to_end_p99_ms": 9, "p_loss_max": 0.01})
    logs = load_run(tmp_path)
    summary = build_summary(logs, scenario, (), "live", None, "")
    text = Outline(_report(logs, scenario, summary)).text
    for words in (
        "not a valid measurement", "surgeon: log is missing", "How late the estimates were is not known.",
        "not decidable", "No estimate could be scored.", "Nothing to draw",
    ):  # fmt: skip
        assert words in text, words


@pytest.mark.parametrize("missing", SIDES)
def test_what_is_there_is_shown_when_a_log_is_missing(tmp_path: Path, missing: Side) -> None:
    for side, records in _a_run().items():
        if side != missing:
            write_log(tmp_path, side, records)
    page = _report(load_run(tmp_path), a_scenario())
    assert f"{missing}: log is missing" in page
    shown = {
        "surgeon": ("Position over time", "Delay over time"),
        "netem": ("Error over time", "Where the time goes"),
        "patient": ("Position over time", "Delay over time"),
    }
    for title in shown[missing]:
        assert re.search(f'<h3 id="[^"]+">{title}', page)


def test_a_log_cut_anywhere_gives_a_page(tmp_path: Path) -> None:
    write_run(tmp_path, **_a_run())
    whole = _report(load_run(tmp_path), a_scenario())
    assert "is damaged" not in whole
    for side, cut in zip(SIDES, (0, -40, 0), strict=True):  # the summary is made of every cut of every log
        path = tmp_path / f"{side}.mcap"
        data = path.read_bytes()
        path.write_bytes(data[:cut])
        assert f"{side}: log is damaged" in _report(load_run(tmp_path), a_scenario()), (side, cut)
        path.write_bytes(data)


def test_names_and_texts_of_a_run_cannot_become_markup(tmp_path: Path) -> None:
    evil = "</script><script>alert(1)</script><b x='\""
    run = _a_run()
    run["patient"] += [estimate(k, 2100 + 100 * k, evil, (0.02, 0, 0)) for k in range(3)]
    logs = write_run(tmp_path, **run)
    scenario = a_scenario()
    model = replace(MODEL, method=evil, warnings=(evil,), train=evil)
    summary = build_summary(logs, scenario, (model,), evil, None, evil)
    assert evil in summary["accuracy"]
    summary |= {"source": evil, "problems": [evil], "valid": False}
    summary["verdicts"][0] |= {"title": evil, "line": evil, "source": evil}
    summary["clocks"] = {evil: SideClock(discipline=None).summary() | {"kind": evil}}
    summary["links"]["forward"]["dropped_by"] = {evil: 1}
    page = _page_of(logs, scenario, summary_of(summary), {evil: evil})
    assert "alert(1)" in page
    assert "<script>alert" not in page
    assert "<b x=" not in page
    harmless = _report(logs, a_scenario(), build_summary(logs, scenario, (MODEL,), "", None, ""))
    assert Outline(page).tags.count("script") == Outline(harmless).tags.count("script")


@pytest.fixture(scope="module")
def chromium() -> str:
    path = shutil.which("chromium")
    if path is None:
        pytest.skip("no Chromium here to open the report in: apt-get install chromium")
    return path


@pytest.fixture
def browse(chromium: str, tmp_path: Path) -> Callable[[Path], tuple[str, Path]]:
    """Return a function that opens a file without a network: the console's lines and a screenshot."""

    def open_file(page: Path) -> tuple[str, Path]:
        shot = tmp_path / "shot.png"
        done = subprocess.run(
            [  # as root there is no sandbox to be had
                chromium,
                "--headless",
                "--no-sandbox",
                "--disable-gpu",
                "--enable-logging=stderr",
                "--hide-scrollbars",
                "--host-resolver-rules=MAP * ~NOTFOUND",
                f"--user-data-dir={tmp_path / 'profile'}",
                "--virtual-time-budget=10000",
                "--window-size=1280,7000",
                f"--screenshot={shot}",
                page.as_uri(),
            ],
            capture_output=True,
            text=True,
            timeout=120,
            check=True,
        )
        lines = [line for line in done.stderr.splitlines() if ":CONSOLE:" in line]
        return "\n".join(lines), shot

    return open_file


def test_a_browser_draws_it_without_a_network_and_without_a_complaint(
    browse: Callable[[Path], tuple[str, Path]], finished: Path
) -> None:
    console, shot = browse(finished / "report.html")
    assert "document idle" in console  # Bokeh's word for: all is drawn
    assert not _COMPLAINT.search(console), console
    image = pytest.importorskip("PIL.Image").open(shot).convert("RGB")
    colours = {bytes(colour).hex(): n for n, colour in image.getcolors(image.width * image.height)}
    # the lines of the active estimator and of hold, and the dots of the delays
    assert colours.get(look_of("innovations_kf").tone.light[1:], 0) > 5000
    assert colours.get(look_of("hold").tone.light[1:], 0) > 500


def test_the_page_forbids_itself_to_fetch_anything(
    browse: Callable[[Path], tuple[str, Path]], finished: Path, tmp_path: Path
) -> None:
    """And the test above would notice if it tried. The page is one without figures, which has the same policy."""
    greedy, scenario, logs = tmp_path / "greedy.html", a_scenario(), load_run(tmp_path)
    page = _report(logs, scenario, build_summary(logs, scenario, (), "live", None, ""))
    policy = re.search("<meta http-equiv=[^>]+>", page)
    assert policy
    assert policy[0] in (finished / "report.html").read_text()
    greedy.write_text(page.replace("</main>", '</main><img src="https://example.org/x.png" alt="">'))
    console, _ = browse(greedy)
    assert re.search(r"violates.*Content Security Policy", console, re.DOTALL)
    assert _COMPLAINT.search(console)
