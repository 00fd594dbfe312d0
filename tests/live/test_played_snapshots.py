"""What is played agrees with what `rover_sweep.logs` reads, wherever it is played from and however fast."""

from __future__ import annotations

import math
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from rover_sweep.live.played_source import Track, open_track
from rover_sweep.live.source import Snapshot
from rover_sweep.logs.read import read_logs

RECORDINGS = (
    "ardurover-4.6.3/applet/run1.tlog",
    "ardurover-4.6.3/nominal/run1.BIN",
    "ardurover-4.5.7/nominal/run1.tlog",
)
# Largest differences of a message that is shown as it came from the channel of the logs, which comes from
# another message of the same instant (r: ATTITUDE, less the estimator's bias, for RAW_IMU), or lies
# between two samples.
TOLERANCE = {"r": 0.06, "p": 0.06, "ay": 0.25, "speed": 0.06, "phi": 0.02, "pwm": 25.0}


def same(one: Snapshot, other: Snapshot) -> list[str]:
    """Names of the fields in which two snapshots differ."""
    return [
        f.name
        for f in fields(Snapshot)
        if (a := getattr(one, f.name)) != (b := getattr(other, f.name))
        and not (isinstance(a, float) and math.isnan(a) and math.isnan(b))
    ]


@pytest.fixture(scope="module", params=RECORDINGS)
def path(request: pytest.FixtureRequest, data: Path) -> Path:
    return data / str(request.param)


@pytest.fixture(scope="module")
def track(path: Path) -> Track:
    return open_track(path)


def test_snapshots_agree_with_the_logs(track: Track, path: Path) -> None:
    (log,) = read_logs(str(path))
    channels = {**log.signals, "pwm": log.steering[0]}
    seen: dict[str, list[float]] = {name: [] for name in TOLERANCE}
    track.seek(0.0)
    for at in np.arange(2.0, track.length - 2.0, 0.91):
        list(track.play(at))
        now = track.snapshot()
        for name, errors in seen.items():
            signal = channels[name]
            errors.append(getattr(now, name) - float(np.interp(now.t, signal.t, signal.x)))
    for name, errors in seen.items():
        spread = float(np.sqrt(np.mean(np.square(errors))))
        assert spread < TOLERANCE[name], f"{name}: rms {spread:.3g}"
        assert spread < max(0.2 * float(np.std(channels[name].x)), 0.002), name  # a rover that does not roll


def test_a_jump_is_as_good_as_playing_up_to_there(track: Track) -> None:
    places = [0.0, 0.05 * track.length, *(share * track.length for share in (0.2, 0.5, 0.7, 0.93, 1.0))]
    played = []
    track.seek(0.0)
    for at in places:
        list(track.play(at))
        played.append(track.snapshot())
    for at, expected in reversed(list(zip(places, played, strict=True))):
        track.seek(at)
        assert same(track.snapshot(), expected) == []


def test_the_same_happens_in_small_steps_and_in_one(track: Track) -> None:
    track.seek(0.0)
    whole = list(track.play(track.length))
    track.seek(0.0)
    pieces = [e for at in np.linspace(0.0, track.length, 29) for e in track.play(float(at))]
    assert pieces == whole and len(whole) > 300


def test_a_restart_of_the_vehicle_takes_no_time(data: Path, tmp_path: Path) -> None:
    parts = [data / f"ardurover-4.6.3/{folder}/run1.tlog" for folder in ("applet", "nominal")]
    both = tmp_path / "both.tlog"
    both.write_bytes(b"".join(part.read_bytes() for part in parts))
    first, second, joined = (open_track(part) for part in (*parts, both))
    assert joined.length == pytest.approx(first.length + second.length, abs=0.1)
    assert [place.from_applet for place in joined.places] == [True, False]
    offset = joined.length - second.length
    assert joined.places[1].begin == pytest.approx(offset + second.places[0].begin, abs=0.1)
    for at in (20.0, 70.0):
        for alone, there in ((first, at), (second, at + offset)):
            alone.seek(at)
            joined.seek(there)
            assert joined.snapshot().t == pytest.approx(alone.snapshot().t, abs=0.1)
            assert joined.snapshot().speed == pytest.approx(alone.snapshot().speed, abs=0.05)
            assert joined.snapshot().state == alone.snapshot().state


def test_the_state_of_the_applet_is_shown_with_progress_and_frequency(data: Path) -> None:
    shown = []
    for kind in ("tlog", "BIN"):
        track = open_track(data / f"ardurover-4.6.3/applet/run1.{kind}")
        (place,) = track.places
        begin = place.run.begin  # the same instant on the vehicle's clock in both
        track.seek(place.begin + 60.0 + 47.4 - begin)
        shown.append(track.snapshot())
    for now in shown:
        assert now.armed and now.mode == 0 and now.ekf and now.fix >= 3 and now.switch > 1800
        assert (now.state, now.state_name) == (6, "manoeuvre")
        assert now.progress == pytest.approx((now.t - 52.14) / 67.0, abs=0.01)
    assert shown[0].t == pytest.approx(shown[1].t, abs=0.05)
    assert shown[0].frequency == pytest.approx(shown[1].frequency, rel=0.05)
    assert 7.0 < shown[0].frequency < 25.0
