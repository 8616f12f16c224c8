import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.common.sources.trials import rows_of, text_of
from tis.common.errors import DataError, InputError
from tis.common.runtime.recordings import load_recording, load_training, load_trials, located
from tis.common.scenario import Scenario
from tis.common.scenario.reading import build_scenario, digest
from tis.common.sources.jigsaws import parse_trial
from tis.deploy.tools.synth import write_trials


@pytest.fixture(autouse=True)
def _nothing_from_outside(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("TIS_JIGSAWS", raising=False)


def folder_of(root: Path, task: str = "Suturing") -> Path:
    return root / task / "kinematics" / "AllGestures"


def write_trial(root: Path, trial: str, n_rows: int, task: str = "Suturing") -> Path:
    file = folder_of(root, task) / f"{task}_{trial}.txt"
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text_of(rows_of(n_rows, seed=sum(map(ord, trial)))))
    return file


def scenario_of(root: Path | str | None, duration_s: float = 2, train: str = "own_head", **source: Any) -> Scenario:
    raw = {
        "version": 1,
        "name": "s",
        "duration_s": duration_s,
        "source": {"kind": "jigsaws", "path": None if root is None else str(root), "trial": "D002", **source},
        "identification": {"train": train, "train_samples": 100},
    }
    return build_scenario(raw, "s.yaml")


def synthetic_scenario(train: str = "own_head", **source: Any) -> Scenario:
    raw = {
        "version": 1,
        "name": "s",
        "seed": 5,
        "duration_s": 2,
        "rate_hz": 50,
        "source": {"kind": "synthetic", **source},
        "identification": {"train": train, "train_samples": 100},
    }
    return build_scenario(raw, "s.yaml")


def test_a_trial_with_its_training_rows_before_the_start(tmp_path: Path) -> None:
    write_trial(tmp_path, "D002", 161)  # 100 to train on, 60 samples of 2 s, 1 for the truth after the last
    recording = load_recording(scenario_of(tmp_path, hands=["right", "left"]))
    rows = rows_of(161, seed=sum(map(ord, "D002")))
    assert (recording.label, recording.rate_hz, recording.start, len(recording)) == ("Suturing_D002", 30, 100, 161)
    assert [(hand.hand, hand.arm) for hand in recording.hands] == [("right", "PSM1"), ("left", "PSM2")]
    assert np.abs(recording.hands[0].command.position_m - rows[:, 19:22]).max() <= 0.5e-8
    assert np.abs(recording.hands[0].follower.position_m - rows[:, 38:41]).max() <= 0.5e-8
    assert np.abs(recording.hands[1].command.position_m - rows[:, 0:3]).max() <= 0.5e-8
    assert np.abs(recording.hands[1].follower.position_m - rows[:, 57:60]).max() <= 0.5e-8
    assert recording.hands[1].follower.gripper_rad == pytest.approx(0.3)
    assert recording.warnings == ()
    assert "MTML -> PSM2 (auto; " in recording.pairing
    [training] = load_training(scenario_of(tmp_path), recording)
    assert len(training) == 100
    assert np.array_equal(training.hands[0].command.position_m, recording.hands[0].command.position_m[:100])


def test_rows_of_a_recorder_are_played_at_even_instants_or_as_they_are(tmp_path: Path) -> None:
    (file,) = write_trials(tmp_path / "made", 1, "Suturing", 3, 30.0, "a test")
    even, raw = (
        load_recording(scenario_of(tmp_path / "made", trial="S001", clock=clock)) for clock in ("auto", "as_recorded")
    )
    rows = parse_trial(file.read_text(), "s")
    assert np.array_equal(raw.hands[0].command.position_m, rows[:, 0:3])
    changes = [np.mean(np.abs(np.diff(each.hands[0].follower.position_m, 2, axis=0))) for each in (even, raw)]
    assert changes[0] < 0.7 * changes[1]
    assert even.digest != raw.digest


@pytest.mark.parametrize(
    ("train", "start", "duration_s", "expected"),
    [
        ("own_head", "auto", 2, "must have 161 rows (100 before the start + 60 samples of 2 s + 1); "
         "duration_s can be at most 1.966, or auto to play all of it (got 160)"),
        ("own_head", 120, 2, "must have 181 rows (120 before the start + 60 samples of 2 s + 1); "
         "duration_s can be at most 1.300, or auto to play all of it (got 160)"),
        ("others", "auto", 6, "must have 181 rows (0 before the start + 180 samples of 6 s + 1); "
         "duration_s can be at most 5.300, or auto to play all of it (got 160)"),
        ("others", 159, 2, "must have 220 rows (159 before the start + 60 samples of 2 s + 1); "
         "it is too short for any duration_s with this start and these training rows (got 160)"),
    ],
)  # fmt: skip
def test_a_trial_that_is_too_short_says_how_long_the_run_may_be(
    tmp_path: Path, train: str, start: int | str, duration_s: float, expected: str
) -> None:
    file = write_trial(tmp_path, "D002", 160)
    with pytest.raises(DataError) as caught:
        load_recording(scenario_of(tmp_path, duration_s, train, start=start))
    assert str(caught.value) == f"{file}: {expected}"


def test_a_byte_order_mark_and_other_line_ends_are_no_data(tmp_path: Path) -> None:
    file = write_trial(tmp_path, "D002", 160)
    plain = load_recording(scenario_of(tmp_path, 1.0))
    file.write_bytes(b"\xef\xbb\xbf" + file.read_bytes().replace(b"\n", b" \t\r\n") + b"\r\n")
    marked = load_recording(scenario_of(tmp_path, 1.0))
    assert np.array_equal(plain.hands[0].follower.position_m, marked.hands[0].follower.position_m)
    assert plain.digest == marked.digest


def test_the_longest_duration_that_the_error_names_fits(tmp_path: Path) -> None:
    write_trial(tmp_path, "D002", 160)
    recording = load_recording(scenario_of(tmp_path, 1.966))
    assert len(recording) == 160


def test_a_run_may_not_begin_within_its_training_rows(tmp_path: Path) -> None:
    write_trial(tmp_path, "D002", 400)
    for scenario in (scenario_of(tmp_path, start=99), synthetic_scenario(start=99)):
        with pytest.raises(InputError) as caught:
            load_recording(scenario)
        assert str(caught.value) == (
            "scenario s: source.start: must be auto or at least train_samples = 100, "
            "since own_head trains on the rows before (got 99)"
        )
    assert load_recording(scenario_of(tmp_path, start=100)).start == 100
    assert load_recording(scenario_of(tmp_path, train="model.json", start=7)).start == 7
    assert load_recording(scenario_of(tmp_path, train="others")).start == 0


def test_without_the_data_the_error_says_what_they_are_and_how_one_gets_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(DataError) as caught:
        load_recording(scenario_of("nowhere"))
    text = str(caught.value)
    place = folder_of(tmp_path / "nowhere") / "Suturing_D002.txt"
    assert text.startswith(
        f"{place}: does not exist, nor does its folder (folder given by source.path). JIGSAWS (the JHU-ISI"
    )
    for part in ("da Vinci", "Johns Hopkins University (the CIRL group)", "on request", "source.path", "TIS_JIGSAWS"):
        assert part in text
    assert "\n" not in text
    assert caught.value.exit_code == 4


def test_a_file_in_the_place_of_the_folder_is_said_to_be_one(tmp_path: Path) -> None:
    (tmp_path / "mine.csv").write_text("1,2,3\n")
    with pytest.raises(DataError) as caught:
        load_recording(scenario_of(tmp_path / "mine.csv"))
    text = str(caught.value)
    assert text.startswith(f"{tmp_path / 'mine.csv'}: is a file; needed is the folder that holds TASK/kinematics/")
    assert "JIGSAWS" not in text


def test_a_missing_trial_is_answered_with_those_that_are_there(tmp_path: Path) -> None:
    for trial in ("E001", "B003"):
        write_trial(tmp_path, trial, 3)
    (folder_of(tmp_path) / "notes.txt").write_text("")
    (folder_of(tmp_path) / "Suturing_D002.txt.bak").write_text("")
    with pytest.raises(DataError, match="does not exist; Suturing trials in its folder: B003, E001 "):
        load_recording(scenario_of(tmp_path))
    folder_of(tmp_path, "Knot_Tying").mkdir(parents=True)
    with pytest.raises(DataError, match="does not exist, nor does any other Knot_Tying trial "):
        load_recording(scenario_of(tmp_path, task="Knot_Tying"))


def test_the_environment_names_the_folder_when_the_scenario_does_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write_trial(tmp_path / "here", "D002", 161)
    monkeypatch.setenv("TIS_JIGSAWS", str(tmp_path / "here"))
    assert len(load_recording(scenario_of(None))) == 161
    monkeypatch.setenv("TIS_JIGSAWS", str(tmp_path / "there"))
    for scenario in (scenario_of(None), located(scenario_of(None))):
        with pytest.raises(DataError, match=r"/there/Suturing/.* \(folder given by TIS_JIGSAWS\)"):
            load_recording(scenario)
    monkeypatch.setenv("TIS_JIGSAWS", "")
    with pytest.raises(DataError, match=r"/data/jigsaws/Suturing/.* \(folder given by source.path\)"):
        load_recording(scenario_of(None))


def test_a_path_that_is_given_counts_before_the_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own, other = (write_trial(tmp_path / name, "D002", 161) for name in ("own", "other"))
    other.write_text(text_of(rows_of(161, seed=99)))
    monkeypatch.setenv("TIS_JIGSAWS", str(tmp_path / "other"))
    scenario = scenario_of(tmp_path / "own")
    recording = load_recording(scenario)
    assert recording.file == str(own)
    rows = rows_of(161, seed=sum(map(ord, "D002")))
    assert np.abs(recording.hands[0].command.position_m - rows[:, :3]).max() <= 0.5e-8
    assert located(scenario) == scenario
    with pytest.raises(DataError, match=r"folder given by source.path, which precedes TIS_JIGSAWS"):
        load_recording(scenario_of(tmp_path / "nowhere"))


def test_what_is_recorded_is_what_was_read_but_hosts_need_not_agree_on_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_trial(tmp_path / "there", "D002", 161)
    monkeypatch.setenv("TIS_JIGSAWS", str(tmp_path / "there"))
    asked = scenario_of(None)
    told = located(asked)
    assert told.source.kind == "jigsaws"
    assert told.source.path == str(tmp_path / "there")
    assert digest(told) == digest(asked) == digest(scenario_of("elsewhere"))
    assert digest(told) != digest(scenario_of(None, start=100))
    monkeypatch.delenv("TIS_JIGSAWS")
    assert load_recording(told).file == load_recording(located(told)).file
    assert located(synthetic_scenario()) == synthetic_scenario()


def test_a_recording_is_told_by_its_numbers_wherever_it_lies(tmp_path: Path) -> None:
    for root, trial, seed in (("a", "D002", 1), ("b", "E003", 1), ("c", "D002", 2)):
        write_trial(tmp_path / root, trial, 161).write_text(text_of(rows_of(161, seed)))
    a, b, c = (
        load_recording(scenario_of(tmp_path / root, trial=trial)).digest
        for root, trial in (("a", "D002"), ("b", "E003"), ("c", "D002"))
    )
    assert a == b != c
    usual = load_recording(synthetic_scenario()).digest
    assert usual == load_recording(synthetic_scenario(hands=["right"], start=200)).digest
    assert usual != load_recording(synthetic_scenario(tremor_hz=8.0)).digest


def test_damage_is_said_with_the_trial_and_the_rows(tmp_path: Path) -> None:
    rows = rows_of(161)
    rows[:, :3] *= 1000
    rows[50:56, 19:22] = 0.0
    write_trial(tmp_path, "D002", 161).write_text(text_of(rows))
    [units] = load_recording(scenario_of(tmp_path, hands=["left"])).anomalies
    assert re.fullmatch(r"Suturing_D002: MTML moves over \d+\.?\d* m, .* millimetres\?", units)
    [zeros] = load_recording(scenario_of(tmp_path, hands=["right"])).anomalies
    assert zeros == "Suturing_D002: MTMR is at exactly 0 0 0 in rows 50-55: were rows filled in?"


def test_of_the_real_trials_only_d001_raises_a_doubt_its_known_jump(jigsaws_dir: Path) -> None:
    files = sorted(jigsaws_dir.glob("*/kinematics/AllGestures/*.txt"))
    doubts: dict[str, tuple[str, ...]] = {}
    for file in files:
        task, _, trial = file.stem.rpartition("_")
        scenario = scenario_of(jigsaws_dir, task=task, trial=trial, hands=["left", "right"])
        doubts[file.stem] = load_recording(scenario).anomalies
    assert files
    known = doubts.pop("Suturing_D001", None)  # its recorder lost rows of all devices
    of_each = (("MTML", 21), ("MTMR", 49), ("PSM2", 11), ("PSM1", 24))
    assert known is None or known == tuple(
        f"Suturing_D001: {device} jumps as no hand moves it, from row 856 to 857 ({size} mm): are rows missing? "
        "If so, cut it there"
        for device, size in of_each
    )
    assert set(doubts.values()) <= {()}


def test_files_that_cannot_be_read_are_one_line(tmp_path: Path) -> None:
    file = write_trial(tmp_path, "D002", 161)
    file.write_bytes(file.read_bytes()[:5000] + b"\xff\xfe" + file.read_bytes()[5000:])
    with pytest.raises(DataError) as caught:
        load_recording(scenario_of(tmp_path))
    assert str(caught.value) == f"{file}: is not UTF-8 text (at byte 5000)"
    file.unlink()
    file.mkdir()
    with pytest.raises(DataError) as caught:
        load_recording(scenario_of(tmp_path))
    assert str(caught.value) == f"{file}: cannot be read: Is a directory"
    file.rmdir()
    file.write_text("")
    with pytest.raises(DataError) as caught:
        load_recording(scenario_of(tmp_path))
    assert str(caught.value) == f"{file}: is empty, must have lines of 76 numbers"


def test_a_pairing_that_the_data_contradict_is_a_warning(tmp_path: Path) -> None:
    write_trial(tmp_path, "D002", 161)
    recording = load_recording(scenario_of(tmp_path, pairing="same_name"))
    assert [hand.arm for hand in recording.hands] == ["PSM1"]
    [text] = recording.warnings
    assert text.startswith("Suturing_D002: PSM1 is used for MTML as told (pairing: same_name), but PSM2 follows it: ")
    assert load_recording(scenario_of(tmp_path, pairing="cross")).warnings == ()


def test_named_trials_are_training_data_whoever_made_them(tmp_path: Path) -> None:
    for trial, n_rows in (("D002", 161), ("D001", 50), ("F003", 30)):
        write_trial(tmp_path, trial, n_rows)
    write_trial(tmp_path, "B001", 40).write_text("damaged\n")
    scenario = scenario_of(tmp_path, train="others", hands=["right"])
    found = load_trials(scenario, load_recording(scenario), ("B001", "D001", "F003"))
    assert [(t.label, len(t), len(t.hands)) for t in found] == [("Suturing_D001", 50, 2), ("Suturing_F003", 30, 2)]
    assert found[0].left_out
    assert all("Suturing_B001" in text for text in found[0].left_out)


def test_the_pairing_of_own_head_looks_at_training_rows_only(tmp_path: Path) -> None:
    file = write_trial(tmp_path, "D002", 400)
    rows = rows_of(400, seed=1)
    # after the training rows the arms change roles, and move ten times as far
    rows[100:, 38:41] = 5 * rows[100:, 0:3]
    rows[100:, 57:60] = 5 * rows[100:, 19:22]
    file.write_text(text_of(rows))
    recording = load_recording(scenario_of(tmp_path, hands=["left", "right"]))
    assert [hand.arm for hand in recording.hands] == ["PSM2", "PSM1"]
    assert recording.warnings == ()
    by_model = load_recording(scenario_of(tmp_path, train="model.json", hands=["left"]))
    assert [hand.arm for hand in by_model.hands] == ["PSM1"]


def test_training_on_others_takes_all_other_subjects_of_the_task(tmp_path: Path) -> None:
    for trial, n_rows in (("D002", 161), ("D001", 50), ("F003", 30), ("B001", 40), ("C002", 20)):
        write_trial(tmp_path, trial, n_rows)
    write_trial(tmp_path, "E001", 40, task="Knot_Tying")
    scenario = scenario_of(tmp_path, train="others", hands=["right"])
    trainings = load_training(scenario, load_recording(scenario))
    assert [(t.label, len(t), t.start) for t in trainings] == [
        ("Suturing_B001", 40, 0),
        ("Suturing_C002", 20, 0),
        ("Suturing_F003", 30, 0),
    ]
    assert {(hand.hand, hand.arm) for t in trainings for hand in t.hands} == {
        ("left", "PSM2"),
        ("right", "PSM1"),
    }


def swapped(n_rows: int, seed: int) -> str:
    """Return the text of a trial whose arms follow the masters of their own name."""
    rows = rows_of(n_rows, seed)
    rows[:, [*range(38, 41), *range(57, 60)]] = rows[:, [*range(57, 60), *range(38, 41)]]
    return text_of(rows)


def test_the_pairing_of_others_is_decided_by_the_training_trials(tmp_path: Path) -> None:
    write_trial(tmp_path, "D002", 161)
    write_trial(tmp_path, "B001", 161).write_text(swapped(161, seed=3))
    write_trial(tmp_path, "C001", 161).write_text(swapped(90, seed=4) + "damaged\n")
    write_trial(tmp_path, "E001", 161).write_text("damaged\n")
    scenario = scenario_of(tmp_path, train="others", hands=["left", "right"])
    recording = load_recording(scenario)
    assert [hand.arm for hand in recording.hands] == ["PSM1", "PSM2"]
    assert recording.warnings[0].startswith(
        "Suturing_D002: PSM1 is used for MTML as in the training trials, but PSM2 follows it: "
    )
    assert recording.pairing.startswith("MTML -> PSM1 (auto; ")
    [training] = load_training(scenario, recording)
    assert [hand.arm for hand in training.hands] == ["PSM1", "PSM2"]
    assert training.warnings == ()


def test_no_row_that_others_score_has_a_say_in_the_pairing(tmp_path: Path) -> None:
    write_trial(tmp_path, "B001", 161)
    arms = set()
    for text in (text_of(rows_of(161, seed=1)), swapped(161, seed=1)):
        write_trial(tmp_path, "D002", 161).write_text(text)
        recording = load_recording(scenario_of(tmp_path, train="others", hands=["left", "right"]))
        arms.add(tuple(hand.arm for hand in recording.hands))
    assert arms == {("PSM2", "PSM1")}


def test_training_trials_keep_the_arms_of_the_run(tmp_path: Path) -> None:
    write_trial(tmp_path, "D002", 161)
    write_trial(tmp_path, "B001", 161).write_text(swapped(161, seed=3))
    for pairing, arms in (("cross", ["PSM2", "PSM1"]), ("same_name", ["PSM1", "PSM2"])):
        told = scenario_of(tmp_path, train="others", pairing=pairing)
        [training] = load_training(told, load_recording(told))
        assert [hand.arm for hand in training.hands] == arms
        assert bool(training.warnings) == (pairing == "cross")


def test_training_on_others_without_others_names_what_is_there(tmp_path: Path) -> None:
    for trial in ("D002", "D001"):
        write_trial(tmp_path, trial, 161)
    scenario = scenario_of(tmp_path, train="others")
    with pytest.raises(DataError) as caught:
        load_training(scenario, load_recording(scenario))
    assert str(caught.value) == (
        "scenario s: identification.train: others: needs Suturing trials of other subjects than D in "
        f"{folder_of(tmp_path)}; found: D001, D002"
    )


def test_a_broken_or_empty_training_trial_is_left_out_and_named(tmp_path: Path) -> None:
    write_trial(tmp_path, "D002", 161)
    whole = write_trial(tmp_path, "E001", 10)
    broken, empty = (write_trial(tmp_path, trial, 10) for trial in ("B001", "C001"))
    broken.write_text(broken.read_text() + "1 2 3\n")
    empty.write_text("")
    scenario = scenario_of(tmp_path, train="others")
    [training] = load_training(scenario, load_recording(scenario))
    assert training.file == str(whole)
    assert training.left_out[0] == f"trained without {broken}: line 11: must have 76 columns (got 3)"
    assert training.left_out[1].startswith(f"trained without {empty}: ")
    assert len(training.left_out) == 2


def test_where_every_training_trial_is_broken_each_is_named(tmp_path: Path) -> None:
    write_trial(tmp_path, "D002", 161)
    broken = [write_trial(tmp_path, trial, 10) for trial in ("B001", "C001")]
    for file in broken:
        file.write_text(file.read_text() + "1 2 3\n")
    scenario = scenario_of(tmp_path, train="others")
    with pytest.raises(DataError) as caught:
        load_training(scenario, load_recording(scenario))
    assert str(caught.value).splitlines() == [f"{file}: line 11: must have 76 columns (got 3)" for file in broken]


def test_a_model_file_needs_no_training(tmp_path: Path) -> None:
    write_trial(tmp_path, "D002", 161)
    scenario = scenario_of(tmp_path, train="model.json")
    assert load_training(scenario, load_recording(scenario)) == []


def test_a_synthetic_source_is_as_long_as_the_run_needs() -> None:
    scenario = synthetic_scenario()
    recording = load_recording(scenario)
    assert (recording.rate_hz, recording.start, len(recording)) == (50, 100, 201)
    assert recording.label == "synthetic surgeon, seed 5"
    [training] = load_training(scenario, recording)
    assert len(training) == 100
    again = load_recording(synthetic_scenario(start=300))
    assert (again.start, len(again)) == (300, 401)
    assert np.array_equal(again.hands[0].command.position_m[:201], recording.hands[0].command.position_m)
    by_model = synthetic_scenario(train="model.json")
    assert load_recording(by_model).start == 0
    assert load_training(by_model, load_recording(by_model)) == []


def test_the_real_trial_of_the_paper_has_room_for_30_s(jigsaws_dir: Path) -> None:
    if not (folder_of(jigsaws_dir) / "Suturing_D002.txt").is_file():
        pytest.skip(f"no Suturing_D002 in {jigsaws_dir}")
    scenario = build_scenario(
        {"version": 1, "name": "s", "duration_s": 30, "source": {"kind": "jigsaws", "path": str(jigsaws_dir)}}, "s"
    )
    recording = load_recording(scenario)
    assert (recording.label, recording.start, len(recording)) == ("Suturing_D002", 1240, 2214)
    assert recording.hands[0].arm == "PSM2"
    assert recording.warnings == ()
