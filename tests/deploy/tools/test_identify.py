import json
import sys
from pathlib import Path

import pytest

from tests.deploy.commands import Call, call
from tis.common.extras import GET_REPORT
from tis.deploy.tools.synth import write_trials


@pytest.fixture
def tis(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Call:
    """Return a function that calls `tis identify` in an empty folder: exit code, output, diagnostics."""
    monkeypatch.chdir(tmp_path)

    def identify(*words: str) -> tuple[int, str, str]:
        return call("identify", *words)

    return identify


PAPER = ("--set", "identification={method: moesp_paper, order: 10, train_samples: 600}")


def test_the_table_has_every_rules_order_and_the_figure_is_written(tis: Call) -> None:
    code, out, err = tis("default", *PAPER, "--figure", "f.svg", "--out", "m.json")
    assert code == 0, err
    for text in ("moesp_paper, 10 block rows", "85 % energy", "largest log-gap", "figure written to f.svg"):
        assert text in out
    assert Path("f.svg").read_bytes().startswith(b"<?xml")
    assert Path("m.json").is_file()
    code, out, _ = tis("default", "--set", "identification.train=m.json")
    assert code == 0
    assert "the model comes from a file" in out


def test_a_figure_that_cannot_be_drawn_is_refused_at_once(tis: Call, monkeypatch: pytest.MonkeyPatch) -> None:
    code, out, err = tis("default", "--set", "identification.train=m.json", "--figure", "f.gif", "--out", "m.txt")
    assert (code, out) == (2, "")
    assert [line.removeprefix("tis: ") for line in err.splitlines()] == [
        "tis identify: --out: must end in .json (got 'm.txt')",
        "tis identify: --figure: must end in .svg, .pdf or .png (got 'f.gif')",
        "tis identify: --figure: requires training rows: identification.train must not be a model file "
        "(got 'm.json')",
    ]
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    code, out, err = tis("default", "--figure", "f.png")
    assert (code, out) == (2, "")
    rule = f"requires matplotlib, which is missing: {GET_REPORT}"
    assert err.strip().removeprefix("tis: ") == f"tis identify: --figure: {rule}"
    assert not list(Path().iterdir())


def test_a_trial_need_not_be_longer_than_its_training_rows(tis: Call) -> None:
    """The scenario's 20 s are a run's: here none is."""
    write_trials(Path("data"), 1, "Suturing", 1, 1260 / 30, "a test")
    trial = "{kind: jigsaws, path: data, task: Suturing, trial: S001}"
    code, out, err = tis("default", "--set", f"source={trial}")
    assert code == 0, err
    assert "own_head: rows 0-1239 of Suturing_S001" in out


def test_a_folder_that_is_not_there_is_one_line(tis: Call) -> None:
    code, out, err = tis("default", "--figure", "absent/f.png", "--out", "gone/m.json")
    assert (code, out) == (4, "")  # before anything is computed
    assert err.splitlines() == [
        "tis: gone/m.json: cannot be written: No such file or directory",
        "tis: absent/f.png: cannot be written: No such file or directory",
    ]


@pytest.mark.parametrize(
    ("setting", "line"),
    [
        ("identification.epsilon_q=0", "identification.epsilon_q: must be greater than 0 (got 0)"),
        ("identification.epsilon_r=-1", "identification.epsilon_r: must be greater than 0 (got -1)"),
        (
            "identification.method=subspace",
            "identification.method: must be 'moesp', 'pi_moesp', 'n4sid', 'cva', 'arx', 'moesp_paper', 'narx', "
            "'gpr', 'srlsmf', 'srlsmf_l1', 'transformer', 'informer' or 'cnn' (got 'subspace')",
        ),
        (
            "identification.order=best",
            "identification.order: must be an integer >= 0 or one of auto, energy, gap, criterion, validation"
            " (got 'best')",
        ),
    ],
)
def test_settings_that_make_no_sense_are_one_line(tis: Call, setting: str, line: str) -> None:
    code, _, err = tis("default", "--set", setting)
    assert code == 2
    assert line in err
    assert len(err.strip().splitlines()) == 1


def test_only_a_file_without_orientations_is_told_to_be_identified_again(tis: Call) -> None:
    code, _, err = tis("default", *PAPER)
    assert code == 0
    assert "nothing for" not in err
    assert tis("default", *PAPER, "--out", "m.json")[0] == 0
    found = json.loads(Path("m.json").read_text())
    for model in found["models"]:
        del model["wrist"]
    Path("m.json").write_text(json.dumps(found))
    code, _, err = tis("default", "--set", "identification.train=m.json")
    assert code == 0, err
    assert "nothing for patient.orientation.active" in err
