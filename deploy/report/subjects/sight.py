"""Sight: what became of each frame of the picture, how old it is when it is seen, and how well it is seen."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from tis.common.channels import VIDEO, Hand, hand_channels, is_shown_force
from tis.common.channels import Arm as ArmName
from tis.common.messages import CODE_BYTES, HEADER_BYTES
from tis.common.metrics.percentiles import Summary, summarise, uncertainties
from tis.common.metrics.sight import asynchrony_ns, behind_others, onsets
from tis.common.records import CONTACTS
from tis.common.scenario import Scenario
from tis.common.scenario.network.capacity import Rate
from tis.common.sight_records import FRAGMENT_COUNTERS
from tis.common.units import NS_PER_MS, NS_PER_S
from tis.deploy.logs.read.columns import joined
from tis.deploy.logs.read.frame import Frame
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.logs.read.packets import fates_by_key, releases_by_key
from tis.deploy.report.section import LATE, Section, Statistics, means, statistics
from tis.deploy.report.subjects.logs import counters_of
from tis.deploy.report.subjects.network.requested import Requested
from tis.deploy.report.subjects.pictures import STATES, Pictures
from tis.netem.expected.frames import FrameShares, frame_shares, transmission_ns

GLASS: Final = "sight.glass_to_glass_ms"
"""The place of the figure that spans two clocks."""
HAND_TO_EYE: Final = "hand to eye"
TORN: Final = "torn frames"
LIKENESS: Final = "likeness to what the camera saw (PSNR, SSIM)"
NOTICED_MS: Final = (-15.0, 50.0)
"""Touch so long before and after sight goes unnoticed (Di Luca and Mahnan 2019)."""


class Asynchrony(Section):
    """What is felt beside what is seen, at each contact."""

    n: int = means("Contacts that were both felt and seen.")
    noticed: int = means("Those felt more than 15 ms before or 50 ms after they were seen, which people notice.")
    touch_after_sight_ms: Statistics = statistics("How much later than seen they were felt.", "mean p5 p50 p95")


class ForceWaits(Section):
    """Forces in the queue of a rate that they share with the picture."""

    n: int = means("Forces that left netem.")
    behind_video: int = means("Those that waited for a message of the picture that had come before them.")
    wait_ms: Statistics = statistics("Time in the queue of these, their own transmission included.")
    expected_max_ms: float | None = means(
        "Longest wait in theory, behind the largest frame: 8 (bytes + overhead of each message) / rate, and the "
        "force's own transmission; 0 where keys are ruled apart, `null` without one constant rate."
    )


class Quality(Section):
    """The pictures shown beside those drawn, without the stamps."""

    n: int = means("Pictures compared, evenly spaced among those shown.")
    psnr_db: Statistics = statistics("Peak signal-to-noise ratio, 100 for equal pictures.", "mean p5 p50")
    ssim: Statistics = statistics("Structural similarity of the brightness, 1 for equal pictures.", "mean p5 p50")


class SightFigures(Section):
    """What the surgeon saw."""

    not_measured: list[str] = means(
        "What the picture of an external camera does not tell: hand to eye, torn frames and the likeness of pictures "
        "need stamps, or a camera of ours; absent for ours.",
        default=[],
    )
    frames: dict[str, int] = means(
        "Frames by what became of them: `sent`; `complete`, with all that they refer to; `concealed`, the decoder "
        "filled gaps; `torn`, stamps contradict each other (absent without stamps); `undecodable`; `lost`, nothing "
        "arrived."
    )
    frames_due: int | None = means("Frames that our camera had to capture in this time; `null` of an external one.")
    screen_ms: Statistics = statistics(
        "From the arrival of a frame's last message to the refresh that showed it, of frames that came whole: "
        "decoding and waiting, at a side that may be too busy for either.",
        LATE,
    )
    pictures: int = means("Frames that the screen showed; of those of one refresh the newest.")
    incomplete_pct: float | None = means("Frames of which not all messages arrived.")
    decodable_pct: float | None = means("Frames that arrived whole, and so did all frames that they refer to.")
    expected_incomplete_pct: float | None = means(
        "The same in theory, by the loss asked for; `null` where the network varies, is recorded or repeats losses."
    )
    expected_decodable_pct: float | None = means("The same in theory; `null` as above, and with an intra refresh.")
    hand_to_eye_ms: Statistics = statistics(
        "From the sample of a command to the first picture that shows it or a later one, by the stamps in the "
        "picture and the surgeon's clock alone; of each command that is the newest one of a frame, whether that came "
        "or not. What was not seen until the end counts with its age there, if that is longer than all that was "
        "seen. Of an external camera the commands that readable stamps name. `null` without stamps.",
        LATE,
    )
    glass_to_glass_ms: Statistics = statistics(
        "From the capture of a frame to the refresh that showed it; between two clocks. Of an external camera from "
        "the time that it tells, for frames that came whole.",
        LATE,
    )
    freezes: int = means("Freezes as W3C's webrtc-stats has them, and the time from the last picture to the end.")
    freeze_pct: float | None = means("Share of the time from the first picture on in freezes; `null` without any.")
    longest_freeze_ms: float | None = means("Length of the longest freeze.")
    pictures_per_s: float | None = means("Pictures per second, from the first one on.")
    kbit_s: float | None = means("Bit rate of the encoded frames, without headers.")
    fragments: dict[str, int] = means(
        "Messages of the picture that the screen could not use: `duplicated`, `reordered`, `corrupted`, `forged`, "
        "`late`; reordered ones are used."
    )
    quality: Quality | None = means(
        "Pictures beside those drawn; `null` where the log has no frames, or the camera was external.", default=None
    )
    asynchrony: Asynchrony | None = means("Touch beside sight; absent without touch.", default=None)
    force_waits: ForceWaits | None = means("Forces behind the picture; absent without touch.", default=None)


def sight_summary(
    found: Pictures | None, logs: RunLogs, scenario: Scenario, arms: Mapping[Hand, ArmName]
) -> dict[str, Any]:
    """Return the figures under ``sight``; nothing for a run without. Oracle: records written by hand, test_sight."""
    return {} if found is None else {"sight": _figures(found, logs, scenario, arms)}


def _figures(found: Pictures, logs: RunLogs, scenario: Scenario, arms: Mapping[Hand, ArmName]) -> SightFigures:
    camera, theory = found.camera, expected_shares(logs, scenario, found.camera)
    n, lasted_ns = len(camera), found.freezes.lasted_ns
    counts = {state: int(np.count_nonzero(found.states == state)) for state in STATES}
    counted = counters_of(logs, "surgeon")
    watched_s = found.freezes.watched_ns / NS_PER_S
    refreshed = scenario.sight is not None and scenario.sight.codec == "h264" and scenario.sight.intra_refresh
    figures: dict[str, Any] = {
        "frames": {"sent": n, **{state: k for state, k in counts.items() if state != "torn" or found.has_stamps}},
        "frames_due": None if found.is_external or scenario.sight is None else scenario.sight.n_due(found.until_ns),
        "screen_ms": summarise(found.screen_ns / NS_PER_MS),
        "pictures": len(found.seen),
        "incomplete_pct": 100.0 * float(np.mean(found.arrived < camera.n_fragments)),
        "decodable_pct": 100.0 * counts["complete"] / n,
        "expected_incomplete_pct": None if theory is None else 100.0 * theory.lost,
        "expected_decodable_pct": None if theory is None or refreshed else 100.0 * theory.decodable,
        "hand_to_eye_ms": summarise(found.hand_to_eye_ns / NS_PER_MS),
        "glass_to_glass_ms": summarise((found.shown_ns[found.dated] - found.captured_ns) / NS_PER_MS),
        "freezes": len(lasted_ns),
        "freeze_pct": found.freezes.share_pct,
        "longest_freeze_ms": float(lasted_ns.max()) / NS_PER_MS if len(lasted_ns) else None,
        "pictures_per_s": len(found.seen) / watched_s if watched_s > 0 else None,
        "kbit_s": _kbit_s(camera),
        "fragments": {name: counted.get(f"video_{name}", 0) for name in FRAGMENT_COUNTERS},
    }
    if found.is_external:
        figures |= {"not_measured": _not_measured(found)}
    if scenario.touch is not None:
        figures |= {"asynchrony": _asynchrony(found, logs, scenario, arms)}
        figures |= {"force_waits": _force_waits(logs, scenario, arms, camera)}
    return SightFigures(**figures)


def _not_measured(found: Pictures) -> list[str]:
    return [*([] if found.has_stamps else [HAND_TO_EYE, TORN]), LIKENESS]


def _kbit_s(camera: Frame) -> float | None:
    over_ns = int(camera.captured_ns[-1] - camera.captured_ns[0])
    return 8e6 * float(camera.n_bytes[:-1].sum()) / over_ns if over_ns else None


def glass_bounds(found: Pictures, logs: RunLogs) -> Summary | None:
    """Return what the clocks leave open of the figures of glass to glass, in ms; None where all share one clock."""
    if logs.clocks.all_shared and logs.clocks.all_known:
        return None
    shown_ns = found.shown_ns[found.dated]
    open_ns = logs.clocks.uncertainty_ns("patient", found.captured_ns, "surgeon", shown_ns)
    took_ns = shown_ns - found.captured_ns
    if open_ns is None:
        return dict.fromkeys(summarise(took_ns))
    return {name: None if ns is None else ns / NS_PER_MS for name, ns in uncertainties(took_ns, open_ns).items()}


def expected_shares(logs: RunLogs, scenario: Scenario, camera: Frame) -> FrameShares | None:
    """Return the shares of frames that the loss asked for gives in theory; None where there is none."""
    request = Requested.of(scenario, "feedback", logs)
    assigned = request.rules.assign(VIDEO.key(scenario.session))
    if request.varies or assigned is None or assigned.pipeline.recovery is not None:
        return None
    loss = assigned.pipeline.loss
    if (loss is not None and loss.kind == "trace") or not camera.is_key[0]:
        return None
    mtu = None if loss is None else loss.mtu_bytes
    each = 1 if mtu is None else -(-scenario.sight.fragment_bytes // mtu)  # type: ignore[union-attr]
    return frame_shares(loss, (camera.n_fragments * each).tolist(), camera.is_key.tolist())


def _asynchrony(found: Pictures, logs: RunLogs, scenario: Scenario, arms: Mapping[Hand, ArmName]) -> Asynchrony:
    parts = []
    for hand, arm in arms.items():
        contacts = logs.of_hand("patient", CONTACTS, hand).first_of_each("tick")
        ticks = logs.of_arm("surgeon", is_shown_force, hand)
        arrived = _feedback(logs, scenario, hand_channels(hand, arm).force.key(scenario.session))
        if ticks is None or arrived is None or len(contacts) < 2:
            continue
        tick_ns = np.append(np.sort(ticks.sample_ns), np.iinfo(np.int64).max)
        place = np.searchsorted(tick_ns, arrived.log_ns)
        felt = place < len(tick_ns) - 1
        begun = onsets(contacts.t_ns, np.linalg.norm(contacts.force_n, axis=1) > 0.0)
        shown_ns = found.shown_ns[found.dated]
        felt_ns = tick_ns[place[felt]]
        parts.append(asynchrony_ns(begun, arrived.sample_ns[felt], felt_ns, found.captured_ns, shown_ns))
    late_ms = joined(parts) / NS_PER_MS
    noticed = (late_ms < NOTICED_MS[0]) | (late_ms > NOTICED_MS[1])
    return Asynchrony(
        n=len(late_ms),
        noticed=int(np.count_nonzero(noticed)),
        touch_after_sight_ms=summarise(late_ms, (5, 50, 95), ("mean",)),
    )


def _feedback(logs: RunLogs, scenario: Scenario, key: str) -> Frame | None:
    return logs.messages("surgeon", "feedback", scenario.session).get(key)


def _force_waits(logs: RunLogs, scenario: Scenario, arms: Mapping[Hand, ArmName], camera: Frame) -> ForceWaits:
    releases = releases_by_key(logs, "feedback")
    video = releases.get(VIDEO.key(scenario.session))
    keys = [hand_channels(hand, arm).force.key(scenario.session) for hand, arm in arms.items()]
    waits_ns, n = [], 0
    for one in (releases[key] for key in keys if key in releases):
        left = one.at(one.released_ns > 0)
        n += len(left)
        if video is not None:
            ends_ns, others_ns = left.offered_ns + left.queued_ns, video.offered_ns + video.queued_ns
            waits_ns.append(left.queued_ns[behind_others(left.offered_ns, ends_ns, video.offered_ns, others_ns)])
    waited_ms = joined(waits_ns) / NS_PER_MS
    return ForceWaits(
        n=n,
        behind_video=len(waited_ms),
        wait_ms=summarise(waited_ms),
        expected_max_ms=_longest_ms(logs, scenario, keys, camera),
    )


def _longest_ms(logs: RunLogs, scenario: Scenario, keys: Sequence[str], camera: Frame) -> float | None:
    """Return the longest time of a force behind a frame in theory; 0 where keys are ruled apart, or without video."""
    request, fates = Requested.of(scenario, "feedback", logs), fates_by_key(logs, "feedback")
    key = VIDEO.key(scenario.session)
    video, forces = request.rules.assign(key), [request.rules.assign(one) for one in keys]
    rates = {one.pipeline.rate for one in forces if one is not None}
    rate = rates.pop() if len(rates) == 1 else None
    if not isinstance(rate, Rate) or request.varies or video is None or key not in fates:
        return None
    if all(one is None or one.group != video.group for one in forces):
        return 0.0
    sent, code_bytes = fates[key], CODE_BYTES if scenario.security.sign else 0
    above = HEADER_BYTES + code_bytes + rate.overhead_bytes
    frame = np.searchsorted(camera.first_seq, sent.seq, side="right") - 1
    n_bytes = np.bincount(frame[frame >= 0], weights=sent.n_bytes[frame >= 0] + above)
    own = max((int(fates[one].n_bytes.max()) for one in keys if one in fates), default=0) + above
    return transmission_ns(int(n_bytes.max(initial=0)) + own, 0, rate.kbit_s) / NS_PER_MS
