"""A throttle sweep: it moves the motor alone, about the pilot's throttle, and has every stop of the rest."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import pytest
from applet_bench import HIGH, LABELS, LOW, SOONEST_S, Bench, Drive, happen, thrown, without

from firmware_params.applet_parameters import applet_source

MOTOR, NEUTRAL, HELD = 2, 1500, 1660
SETTINGS = {"TYPE": 4, "AMP": 60, "STRAIGHT": 1, "FADE": 1, "DWELL": 1, "TREC": 20, "STILL": 0}
ENDS = {"TRIM": NEUTRAL, "MIN": 1100, "MAX": 1900}
VEHICLE = {f"SERVO{n}_{name}": value for n in (1, 3) for name, value in ENDS.items()}
VEHICLE |= {"RCMAP_THROTTLE": 3, "RC3_TRIM": 1500} | {f"SWP_{name}": v for name, v in SETTINGS.items()}


@dataclass
class MotorBench(Bench):
    """A rover at 2 m/s whose pilot holds the throttle at `HELD`; the motor is output 3, steering output 1."""

    parameters: dict[str, float] = field(default_factory=lambda: dict(VEHICLE))
    rc: dict[int, int] = field(default_factory=lambda: {1: 1500, 3: 1660, 6: 1100})
    velocity: tuple[float, float, float] | None = (1.2, 1.6, 0.0)
    pilot_pwm: int = HELD
    motor_channel: int | None = MOTOR
    messages: list[str] = field(default_factory=list)

    def servo_channel(self, function: int) -> int | None:
        return {26: 0, 70: self.motor_channel}.get(function)

    def override_servo(self, channel: int, pwm: int, timeout_ms: int) -> None:
        assert channel == MOTOR, "a throttle sweep moves the motor alone"
        self.override = (pwm, self.now + timeout_ms * 1000)
        self.overrides.append((self.now, pwm, timeout_ms, self.is_armed))

    def log_write(
        self, name: str, labels: str, format: str, values: tuple[Any, ...], units: str, multipliers: str
    ) -> None:
        assert (labels, format, units) == (LABELS, "HBfffff", "--sYYnn")
        self.messages.append(name)
        self.log.append({"t": self.now * 1e-6, **dict(zip(labels.split(","), values, strict=True))})


def swept(source: str | None = None, state: int = 6, **settings: float) -> Drive:
    """A drive in the middle of a throttle sweep."""
    bench = MotorBench()
    bench.parameters |= {f"SWP_{name.upper()}": value for name, value in settings.items()}
    drive = thrown(bench, source)
    drive.run_until(state)
    drive.run(0.5)
    assert bench.state == state, bench.said
    return drive


def test_sweeps_about_the_pilots_throttle_and_gives_it_back() -> None:
    drive = swept(state=3)
    bench = drive.bench
    assert isinstance(bench, MotorBench)
    drive.run_until(0)
    sent = [pwm for _, pwm, timeout, _ in bench.overrides if timeout]
    assert max(sent) == HELD + 60 and min(sent) == HELD - 60 and sent[0] == sent[-1] == HELD
    assert bench.overrides[-1][2] == 0 and bench.texts[-1] == "SWP: run 1 done"
    assert set(bench.messages) == {"SWET"}, "nothing may take it for steering"


STOPS: dict[str, tuple[dict[str, Any], str, str]] = {
    "switch low": ({"switch": LOW}, "switch low", "if seen.switch ~= HIGH then return"),
    "disarm": ({"is_armed": False}, "disarmed", "if not seen.armed then return"),
    "mode": ({"current_mode": 4}, "mode 4, not MANUAL", "if seen.mode ~= MANUAL then return"),
    "RC loss": ({"is_rc_valid": False}, "RC lost", "if not seen.rc_valid then return"),
    "GCS loss": ({"heard_ms": 1000}, "GCS lost", "(seen.gcs_age_ms <= GCS_LOST_MS)"),
    "another motor": ({"motor_channel": 3}, "SERVO3 drives no more", "~= v.channel then return"),
    "no motor": ({"motor_channel": None}, "SERVO3 drives no more", "~= v.channel then return"),
    "output": ({"forced_output": 1911}, "throttle 251.0 > 250 us", "not (off <= v.PWM_MAX)"),
    "stick back": ({"rc": {1: 1500, 3: 1605}}, "throttle stick moved", "not (stick_off(v) <= v.axis.moved)"),
    "stick gone": ({"rc": {1: 1500}}, "throttle stick moved", "not (stick_off(v) <= v.axis.moved)"),
    "roll": ({"roll": math.radians(-31)}, "roll 31.0 > 30 deg", "not (roll <= v.ROLL_MAX)"),
    "yaw": ({"rates": (0, 0, -3.0)}, "yaw rate 171.9 > 150 deg/s", "not (r <= v.R_MAX)"),
    "fast": ({"velocity": (3, 3, 0)}, "speed 4.2 > 4 m/s", "not (seen.speed <= v.V_MAX)"),
    "slow": ({"velocity": (0.3, 0, 0)}, "speed 0.3 < 0.5 m/s", "not (seen.speed >= v.V_MIN)"),
    "no EKF": ({"velocity": None}, "no velocity estimate", "if not seen.speed then return"),
}


@pytest.mark.parametrize("name", STOPS)
def test_every_stop_gives_the_throttle_back_at_once(name: str) -> None:
    changes, said, _ = STOPS[name]
    drive = swept(gcs=1 if name == "GCS loss" else 0)
    bench = drive.bench
    happen(drive.bench, changes)
    bench.pilot_pwm, moved = 1555, bench.now
    drive.run(SOONEST_S)
    assert bench.texts[-1] == f"SWP: run 1 stopped: {said}"
    count = len(bench.overrides)
    assert bench.overrides[-1][2] == 0 and bench.overrides[-1][0] - moved <= SOONEST_S * 1e6
    drive.run(2)
    bench.forced_output = None
    assert len(bench.overrides) == count and bench.servo_pwm(MOTOR) == 1555


@pytest.mark.parametrize("name", [n for n in STOPS if n not in ("another motor", "no motor", "stick gone")])
def test_without_its_line_nothing_stops(name: str) -> None:
    changes, _, line = STOPS[name]
    drive = swept(without(line), gcs=1 if name == "GCS loss" else 0)
    happen(drive.bench, changes)
    drive.run(1)
    assert "stopped" not in drive.bench.said and drive.host.error is None


def test_disarmed_motor_is_set_to_neutral_not_left_at_the_last_override() -> None:
    drive = swept()
    drive.bench.is_armed = False
    drive.run(SOONEST_S)
    _, pwm, timeout, armed = drive.bench.overrides[-1]
    assert (pwm, timeout, armed) == (NEUTRAL, 0, False)


def test_paused_script_does_not_take_the_motor_again() -> None:
    drive = swept()
    drive.pause(0.15)
    drive.run(0.5)
    assert drive.bench.texts[-1] == "SWP: run 1 stopped: script paused 150 ms"
    assert drive.bench.overrides[-1][2] == 0


def test_steering_stick_is_the_pilots() -> None:
    drive = swept()
    drive.bench.rc[1] = 1900
    drive.run(1)
    assert drive.bench.state == 6


def test_stick_that_moves_while_waiting_starts_the_second_again() -> None:
    bench = MotorBench()
    drive = thrown(bench)
    for _ in range(8):
        drive.run(0.5)
        bench.rc[3] += 30
    assert bench.state == 2 and not bench.overrides
    drive.run(1.2)
    assert bench.state == 3


@pytest.mark.parametrize(
    ("pwm", "said"), [(1550, "1550+-60 not in 1500..1900"), (1860, "1860+-60 not in 1500..1900")]
)
def test_sweep_past_neutral_or_full_is_refused(pwm: int, said: str) -> None:
    bench = MotorBench(pilot_pwm=pwm)
    thrown(bench, seconds=3)
    assert bench.texts[-1] == f"SWP: run 1 stopped: {said}" and not bench.overrides


def test_reversed_motor_stays_on_its_side_of_neutral() -> None:
    bench = MotorBench(pilot_pwm=1340)
    thrown(bench, seconds=15)
    sent = [pwm for _, pwm, timeout, _ in bench.overrides if timeout]
    assert sent and min(sent) >= 1280 and max(sent) <= 1400


def test_wrong_wave_never_passes_neutral() -> None:
    wave = "return state, envelope * offset"
    source = applet_source().replace(wave, "return state, 5.0 * envelope * offset")
    drive = swept(source, state=5, pwm_max=400)
    drive.run(10)
    sent = [pwm for _, pwm, timeout, _ in drive.bench.overrides if timeout]
    assert min(sent) == NEUTRAL and max(sent) == 1900


def test_no_motor_is_refused() -> None:
    bench = MotorBench(motor_channel=None)
    thrown(bench, seconds=0.5)
    assert bench.texts[-1] == "SWP: refused: no servo has function 70 (throttle)"
    assert bench.switch == HIGH and not bench.overrides
