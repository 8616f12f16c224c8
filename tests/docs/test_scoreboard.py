"""The scoreboard's rows: whole, of the protocol as it is, and shown with the best first."""

import json
import re
from pathlib import Path

import pytest

from from_code.scoreboard import put_in, rows_of
from from_code.study_tables import DOCS
from tis.deploy.studies.score.command import as_text
from tis.deploy.studies.score.protocol import Track, content, digest, settings
from tis.deploy.studies.score.stability import as_text as as_stability
from tis.deploy.studies.score.stability import pairs

TRACKS: tuple[Track, ...] = ("open", "jigsaws")
FILES = sorted((DOCS / "studies" / "scoreboard").glob("*/*.json"))


@pytest.mark.parametrize("track", TRACKS)
def test_each_row_is_a_whole_one_of_this_protocol(track: Track) -> None:
    rows = rows_of(track)
    shipped = {"hold", "arx_kf", "moesp_kf", "innovations_kf"}
    assert track == "jigsaws" or shipped <= {row["estimator"] for row in rows}
    for row in rows:
        assert (row["protocol_sha256"], row["track"], row["quick"], row["seed"]) == (digest(), track, False, 1)
        assert list(row["settings"]) == [each.name for each in settings(track, False)]
        low, high = row["score_interval_95"]
        assert 0 < low <= row["score"] <= high
        assert row["machine"]["step_ratio"] > 0
    people = {"open": content()["tracks"]["open"]["scored"]["people"], "jigsaws": 4}
    assert {row["n_people"] for row in rows} <= {people[track]}


@pytest.mark.parametrize("file", FILES, ids=lambda file: f"{file.parent.name}-{file.stem}")
def test_each_file_is_as_the_command_writes_it_and_without_a_path(file: Path) -> None:
    text = file.read_text(encoding="utf-8")
    assert as_text(json.loads(text)) == text
    assert "/" not in text.replace("protocol_v1/", "")


def test_the_stability_is_of_20_seeds_of_this_protocol_and_shown() -> None:
    file = DOCS / "studies" / "scoreboard" / "stability_open_quick.json"
    found = json.loads(file.read_text(encoding="utf-8"))
    assert (found["protocol_sha256"], found["seeds"]) == (digest(), list(range(1, 21)))
    assert as_stability(found) == file.read_text(encoding="utf-8")
    page = put_in((DOCS / "research" / "scoreboard.md").read_text(encoding="utf-8"))
    assert page.count(" of 20 |") == len(pairs(found["scores"]))


def test_the_page_shows_all_rows_the_best_first() -> None:
    page = put_in((DOCS / "research" / "scoreboard.md").read_text(encoding="utf-8"))
    shown = re.findall(r"^\| `(\S+)` \| ([\d.]+) \(", page, re.MULTILINE)
    assert [name for name, _ in shown] == [row["estimator"] for track in TRACKS for row in rows_of(track)]
    scores = [float(score) for _, score in shown[: len(rows_of("open"))]]
    assert scores == sorted(scores)
