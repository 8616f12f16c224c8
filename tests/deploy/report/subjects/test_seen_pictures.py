"""Pictures decoded again from a log, beside those that the camera drew."""

from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from tis.common.metrics.sight import psnr_db
from tis.common.scenario import Scenario
from tis.common.sight.codec import encoder_of
from tis.common.sight.stamp import read_stamps
from tis.deploy.logs.log_paths import log_files
from tis.deploy.logs.merge import merge_logs
from tis.deploy.logs.read.load import load_run
from tis.deploy.logs.viewer.drawn import CAMERA_VIDEO, RunTopics
from tis.deploy.report.subjects.pictures import Pictures
from tis.deploy.report.subjects.seen_pictures import quality, seen_pictures
from tis.deploy.run.resolve import resolve
from tis.deploy.run.twin import build_sides, run_twin


@pytest.fixture(scope="module")
def lossy(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Scenario, Pictures]:
    """Return a twin of two seconds in which fragments are lost."""
    network = "network={feedback: {loss: {kind: bernoulli, p_loss: 0.05}, delay: {kind: constant, delay_ms: 20}}}"
    scenario, folder = (
        resolve("default", ("duration_s=2", "sight={}", network), None, None),
        tmp_path_factory.mktemp("l"),
    )
    nodes, models, _ = build_sides(scenario)
    run_twin(scenario, nodes, models, folder)
    found = Pictures.of(load_run(folder), scenario)
    assert found is not None
    return folder, scenario, found


def test_a_whole_picture_is_the_drawn_one_encoded_and_decoded(lossy: tuple[Path, Scenario, Pictures]) -> None:
    folder, scenario, found = lossy
    assert scenario.sight is not None
    pictures = list(seen_pictures(folder, scenario, found, 1000))
    assert [one.frame for one in pictures] == sorted(found.seen.frame.tolist())
    for one in pictures:
        assert one.state == "complete"
        assert np.abs(one.seen.astype(int) - one.original).mean() < 3
        top, _ = read_stamps(one.original)
        assert top is not None
        assert top.frame == one.frame
    sent = encoder_of(scenario.sight).encode(pictures[0].original).data
    assert len(sent) == found.camera.n_bytes[pictures[0].frame]


def test_a_damaged_picture_has_its_gaps(lossy: tuple[Path, Scenario, Pictures]) -> None:
    """A newer frame takes its place on the screen, but it can be looked at."""
    folder, scenario, found = lossy
    damaged = found.screen.frame[found.screen.where("state", "concealed")].tolist()
    pictures = list(seen_pictures(folder, scenario, found, 3, damaged[:3]))
    assert [one.frame for one in pictures] == damaged[:3]
    for one in pictures:
        assert one.state == "concealed"
        assert psnr_db(one.seen, one.original) < 35


def test_the_quality_is_that_of_the_pictures_shown(lossy: tuple[Path, Scenario, Pictures]) -> None:
    folder, scenario, found = lossy
    of_all = quality(folder, scenario, found)
    assert of_all is not None
    assert of_all.n == len(found.seen)
    assert of_all.psnr_db["p50"] == pytest.approx(42, abs=5)
    assert of_all.ssim["p50"] == pytest.approx(1.0, abs=0.01)
    assert quality(folder / "elsewhere", scenario, found) is None


def test_viewers_get_each_frame_as_an_image(lossy: tuple[Path, Scenario, Pictures], tmp_path: Path) -> None:
    folder, scenario, found = lossy
    logs = {side: paths for side, paths in log_files(folder).items() if paths[0].is_file()}
    merge_logs(logs, tmp_path / "run.mcap", RunTopics.of(scenario, {}), {})
    with (tmp_path / "run.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        images = [image for _, _, _, image in reader.iter_decoded_messages([CAMERA_VIDEO])]
    assert len(images) == len(found.camera)
    assert images[0].format == "jpeg"
    assert images[0].data.startswith(b"\xff\xd8")


def test_a_camera_with_a_log_of_its_own_is_read(lossy: tuple[Path, Scenario, Pictures], tmp_path: Path) -> None:
    """Live, the camera is a process of its own."""
    folder, scenario, found = lossy
    (tmp_path / "patient_camera.mcap").write_bytes((folder / "patient.mcap").read_bytes())
    assert quality(tmp_path, scenario, found) == quality(folder, scenario, found)
