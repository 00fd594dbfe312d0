"""ArduPilot's rules in the embedded rover's parts: parameters, radio, servos, streams, failsafes, the log."""

from __future__ import annotations

import io
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from pymavlink import DFReader

from sitl.autopilot.log_records import LogRecords
from sitl.autopilot.radio import TRANSMITTER, Radio
from sitl.autopilot.rover import MANUAL, Rover
from sitl.autopilot.servo_outputs import ServoOutputs
from sitl.autopilot.vehicle_parameters import ParameterStore
from sitl.flash_log.dataflash_writer import DataFlashWriter, LogFormat
from sitl.flash_log.formats import FORMATS
from sitl.ground.log_transfer import LogTransfer
from sitl.ground.message_intervals import ACCEPTED, DENIED, StreamSchedule
from sitl.ground.messages import raw_imu, servo_output_raw
from sitl.plant.variant import load_variant


@pytest.fixture
def store(tmp_path: Path) -> ParameterStore:
    return ParameterStore(tmp_path / "parameters.txt")


@pytest.fixture
def rover(tmp_path: Path, store: ParameterStore) -> Rover:
    return Rover(tmp_path, load_variant("nominal"), 1, store)


def run(rover: Rover, seconds: float) -> None:
    for _ in range(round(seconds * rover.loop_rate)):
        rover.step()


# ---- parameters


def test_parameters_outlive_a_reboot_but_a_radio_failure_does_not(store: ParameterStore) -> None:
    store.set("SCHED_LOOP_RATE", 400)
    store.set("SIM_RC_FAIL", 1)
    again = ParameterStore(store.file)
    assert again["SCHED_LOOP_RATE"] == 400
    assert again["SIM_RC_FAIL"] == 0


def test_a_scripts_parameter_is_listed_from_the_second_boot_on(store: ParameterStore) -> None:
    store.set("SCR_ENABLE", 1)
    assert store.add("SWP_AMP", 150)
    assert store["SWP_AMP"] == 150
    assert "SWP_AMP" not in [p.name for p in store.listed()]
    store.set("SWP_AMP", 80)
    again = ParameterStore(store.file)
    assert "SWP_AMP" not in again
    again.add("SWP_AMP", 150)
    assert again["SWP_AMP"] == 80
    assert "SWP_AMP" in [p.name for p in again.listed()]


def test_no_number_is_no_value(store: ParameterStore) -> None:
    assert store.set("FS_TIMEOUT", math.nan) is None
    assert store.set("FS_TIMEOUT", math.inf) is None
    assert store["FS_TIMEOUT"] == 1.5
    assert store.set("INITIAL_MODE", 200) is not None and store["INITIAL_MODE"] == 127
    assert not store.add("A_NAME_OF_17_CHAR", 0)
    store.file.write_text("FS_TIMEOUT 1.5\nrubbish\n")
    with pytest.raises(ValueError, match="line 2: 'rubbish'"):
        ParameterStore(store.file)


# ---- radio


def test_meaning_of_override_values(store: ParameterStore) -> None:
    radio = Radio(store)
    radio.override([1600] * 8 + [1700] * 8, 0)
    radio.update(0)
    assert radio.pwm == [1600] * 8 + [1700] * 8
    radio.override([0, 65535, *[65535] * 6, 0, 65535, 65534, *[0] * 5], 100)
    radio.update(100)
    assert radio.pwm[:2] == [TRANSMITTER[0], 1600]  # 0 gives back, 65535 leaves
    assert radio.pwm[8:11] == [1700, 1700, 0]  # above 8: 0 and 65535 leave, 65534 gives back


@pytest.mark.parametrize(("timeout", "held_ms"), [(3.0, 2999), (0.5, 499), (0.0, -1), (-1.0, 10**9)])
def test_override_time(store: ParameterStore, timeout: float, held_ms: int) -> None:
    store.set("RC_OVERRIDE_TIME", timeout)
    radio = Radio(store)
    radio.override([1600], 0)
    if held_ms >= 0:
        assert radio.overridden(0, held_ms)
    assert timeout < 0 or not radio.overridden(0, held_ms + 1)


def test_switch_is_debounced_200_ms(store: ParameterStore) -> None:
    store.set("RC6_OPTION", 300)
    radio = Radio(store)
    radio.update(0)
    changes = {ms: radio.switch_changes(ms) for ms in range(0, 500, 100)}
    assert [ms for ms, found in changes.items() if found] == [200]
    radio.override([65535] * 5 + [1801], 500)
    radio.update(500)
    changes = {ms: radio.switch_changes(ms) for ms in range(500, 1000, 100)}
    assert {ms: found for ms, found in changes.items() if found} == {700: [(6, 300, 2)]}
    radio.override([65535] * 5 + [1800], 1000)  # 1800 is not yet high
    radio.update(1000)
    assert [radio.switch_changes(ms) for ms in (1000, 1100, 1200)][-1] == [(6, 300, 1)]


def test_stick_has_a_dead_zone_and_may_be_reversed(store: ParameterStore) -> None:
    radio = Radio(store)
    for pwm, expected in ((1530, 0), (1470, 0), (1715, 2250), (1900, 4500), (1100, -4500)):
        radio.override([pwm], 0)
        radio.update(0)
        assert radio.angle(1, 4500) == expected
    store.set("RC1_REVERSED", 1)
    assert radio.angle(1, 4500) == 4500


# ---- servos


def test_pilots_outputs_stay_within_the_servos_range(store: ParameterStore) -> None:
    servos = ServoOutputs(store, 20_000)
    servos.update(9000, 0, True)
    assert servos.pwm[0] == 1900
    servos.update(-9000, 0, True)
    assert servos.pwm[0] == 1100
    store.set("SERVO1_REVERSED", 1)
    servos.update(4500, 0, True)
    assert servos.pwm[0] == 1100


def test_throttle_is_slew_limited_and_off_when_disarmed(store: ParameterStore) -> None:
    servos = ServoOutputs(store, 20_000)
    servos.update(0, 100, True)
    assert servos.throttle == pytest.approx(2.0)  # MOT_SLEWRATE 100 %/s
    servos.update(0, 100, False)
    assert servos.pwm[2] == 1500


def test_scripts_override_lasts_whole_loops_works_disarmed_and_is_not_limited(store: ParameterStore) -> None:
    servos = ServoOutputs(store, 20_000)
    servos.override(0, 2050, 50)  # ceil(50 / 20) loops
    assert servos.pwm[0] == 2050  # readable at once
    seen = []
    for _ in range(4):
        servos.update(0, 0, False)
        seen.append(servos.pwm[0])
    assert seen == [2050, 2050, 2050, 1500]
    servos.override(0, 1700, 1000)
    servos.override(0, 1700, 0)  # ends it
    servos.update(0, 0, True)
    assert servos.pwm[0] == 1500


def test_function_moves_with_the_parameter(store: ParameterStore) -> None:
    servos = ServoOutputs(store, 20_000)
    assert (servos.channel_of(26), servos.channel_of(70), servos.channel_of(33)) == (0, 2, None)
    store.set("SERVO1_FUNCTION", 0)
    store.set("SERVO4_FUNCTION", 26)
    servos.update(4500, 0, True)
    assert servos.channel_of(26) == 3 and servos.pwm[0] == 0 and servos.pwm[3] == 1900


# ---- streams


class Clock:
    now_ms = 0

    def __call__(self) -> int:
        return self.now_ms


def schedule(loop_hz: int, clock: Clock) -> StreamSchedule:
    return StreamSchedule(1_000_000 // loop_hz, clock, lambda message_id: 0 if message_id < 100 else None)


@pytest.mark.parametrize(
    ("loop_hz", "interval_us", "result"),
    [
        (50, 25_000, ACCEPTED),
        (50, 24_999, DENIED),
        (50, 20_000, DENIED),
        (100, 12_000, ACCEPTED),
        (100, 11_999, DENIED),
        (400, 10_000, ACCEPTED),
        (400, 5_000, ACCEPTED),
        (400, 3_003, ACCEPTED),
        (400, 2_999, DENIED),
        (400, 500, DENIED),
        (50, -2, DENIED),
    ],
)
def test_cap_of_the_loop_rate(loop_hz: int, interval_us: int, result: int) -> None:
    assert schedule(loop_hz, Clock()).request(1, interval_us) == result


def test_streams_wait_four_times_as_long_while_files_are_sent() -> None:
    clock = Clock()
    one = schedule(50, clock)
    one.set(1, 100)
    count = {False: 0, True: 0}
    for transferring in (False, True):
        for _ in range(200):
            clock.now_ms += 20
            count[transferring] += len(one.due(transferring))
    assert count == {False: 40, True: 10}


# ---- the vehicle


def test_servo_time_wraps_at_32_bits_and_imu_time_does_not(rover: Rover) -> None:
    run(rover, 0.1)
    rover.now_us = 2**32 + 5
    assert servo_output_raw(rover).time_usec == 5
    assert raw_imu(rover).time_usec == 2**32 + 5


def test_failsafe_action_none_and_terminate(rover: Rover, store: ParameterStore) -> None:
    run(rover, 4)
    assert rover.arm()
    store.set("FS_ACTION", 0)
    store.set("SIM_RC_FAIL", 1)
    run(rover, 3)
    assert rover.mode == MANUAL and rover.armed
    store.set("SIM_RC_FAIL", 0)
    run(rover, 1)
    store.set("FS_ACTION", 5)
    store.set("SIM_RC_FAIL", 1)
    run(rover, 3)
    assert not rover.armed


def test_arming_needs_a_booted_vehicle_and_honours_the_checks(rover: Rover, store: ParameterStore) -> None:
    texts: list[str] = []
    rover.on_text = lambda severity, text: texts.append(text)
    run(rover, 1)
    assert not rover.arm() and not rover.arm(forced=True)
    run(rover, 3)
    rover.radio.override([65535, 65535, 1700], rover.now_ms)
    run(rover, 0.1)
    assert not rover.arm()
    assert texts[-1] == "Arm: Throttle (RC3) is not neutral"
    store.set("ARMING_CHECK", 0)
    assert rover.arm()
    assert "Warning: Arming Checks Disabled" in texts


def test_a_script_that_fails_forbids_arming(tmp_path: Path, store: ParameterStore) -> None:
    store.set("SCR_ENABLE", 1)
    (tmp_path / "scripts").mkdir()
    (tmp_path / "scripts" / "bad.lua").write_text("error('no such luck')")
    rover = Rover(tmp_path, load_variant("nominal"), 1, store)
    texts: list[str] = []
    rover.on_text = lambda severity, text: texts.append(text)
    run(rover, 4)
    assert not rover.arm()
    assert texts[-1].startswith("Arm: Scripting:") and "no such luck" in texts[-1]


# ---- the log


@pytest.mark.parametrize(("rotate", "files"), [(0, 1), (1, 2)])
def test_second_arming_goes_on_in_the_log_or_begins_another(
    rover: Rover, store: ParameterStore, rotate: int, files: int
) -> None:
    store.set("LOG_FILE_DSRMROT", rotate)
    run(rover, 4)
    assert rover.log.files() == []
    for _ in range(2):
        assert rover.arm()
        run(rover, 0.5)
        rover.disarm()
        run(rover, 14.5)
        assert rover.log.active
        run(rover, 1.0)
        assert not rover.log.active
    assert [p.name for p in rover.log.files()] == ["00000001.BIN", "00000002.BIN"][:files]


def test_writer_is_read_back_by_pymavlink(tmp_path: Path) -> None:
    """Every format character, with values at their limits."""
    plain = LogFormat(200, "TSTA", "QbBhHiIqfd", "TimeUS,b,B,h,H,i,I,q,f,d")
    packed = LogFormat(201, "TSTB", "QcCeELnNZ", "TimeUS,c,C,e,E,L,n,N,Z")
    values = (2**63, -128, 255, -32768, 65535, -(2**31), 2**32 - 1, -(2**62), 0.5, 1 / 3)
    scaled = (-327.68, 655.35, -21474836.48, 42949672.95, -35.3632621)
    buffer = io.BytesIO()
    writer = DataFlashWriter(buffer, FORMATS)
    for fmt in (plain, packed):
        writer.define(fmt)
    writer.write("TSTA", *values)
    writer.write("TSTB", 7, *scaled, "ABCD", "a name", "some words")
    path = tmp_path / "test.bin"
    path.write_bytes(buffer.getvalue())
    assert writer.bytes_written == len(buffer.getvalue())
    reader = DFReader.DFReader_binary(str(path))
    messages = [m for m in iter(reader.recv_msg, None) if m.get_type() != "FMT"]
    assert [m.get_type() for m in messages] == ["TSTA", "TSTB"]
    first, second = messages
    assert [getattr(first, c) for c in plain.columns.split(",")] == list(values)
    read = [getattr(second, c) for c in packed.columns.split(",")]
    assert read[1:6] == pytest.approx(scaled, abs=1e-9)
    assert read[6:] == ["ABCD", "a name", "some words"]


@pytest.mark.parametrize(
    ("name", "layout", "columns", "words"),
    [
        ("LONGER", "Q", "TimeUS", "more than 4 letters, 16 fields"),
        ("MANY", "Q" * 17, "T" + ",T" * 16, "more than 4 letters, 16 fields"),
        ("BAD", "Qf", "TimeUS", "does not fit columns"),
    ],
)
def test_what_a_log_cannot_hold_is_refused(name: str, layout: str, columns: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        LogFormat(200, name, layout, columns)


def test_a_log_can_be_fetched_while_it_is_still_being_written(rover: Rover, store: ParameterStore) -> None:
    """Within the 15 s after disarming: what is sent is everything so far, and nothing is logged meanwhile."""
    records, transfer = LogRecords(rover), LogTransfer(rover)
    sent: list[Any] = []
    run(rover, 4)
    rover.arm()
    for _ in range(100):
        rover.step()
        records.loop()
    rover.disarm()
    request = SimpleNamespace(id=1, ofs=0, count=0xFFFFFFFF)
    transfer.handle("LOG_REQUEST_DATA", request, sent.append)
    assert not rover.log.active
    while transfer.busy:
        rover.step()
        records.loop()
        transfer.pump(rover.loop_period_us)
    content = b"".join(bytes(m.data[: m.count]) for m in sent)
    assert content == rover.log.files()[0].read_bytes()
    assert content.count(b"\xa3\x95\xa3") == 100  # IMU is type 163
    assert rover.log.active


def test_failsafe_takes_the_overrides_away(rover: Rover, store: ParameterStore) -> None:
    store.set("RC_OVERRIDE_TIME", -1)  # would hold for ever
    store.set("FS_GCS_ENABLE", 1)
    run(rover, 4)
    rover.gcs_seen_ms = rover.now_ms
    rover.radio.override([1700], rover.now_ms)
    run(rover, 4.5)
    assert rover.radio.pwm[0] == 1700
    run(rover, 3)
    assert rover.radio.pwm[0] == TRANSMITTER[0]
