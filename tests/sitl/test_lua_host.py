"""The host runs scripts as ArduPilot does: when asked to, with 32-bit time, and to their first error."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any, cast

import pytest

from sitl.autopilot.lua_host import Autopilot, LuaHost


@dataclass
class Told:
    texts: list[tuple[int, str]] = field(default_factory=list)
    logged: list[tuple[Any, ...]] = field(default_factory=list)
    overrides: list[tuple[int, int, int]] = field(default_factory=list)


def autopilot(told: Told, **changes: Any) -> Any:
    """An autopilot of lambdas; `time` is settable."""
    ap = SimpleNamespace(time=0)
    functions = {
        "micros": lambda: ap.time,
        "add_parameter": lambda name, default: True,
        "get_parameter": {"FS_ACTION": 2.0}.get,
        "set_parameter": lambda name, value, save: name == "FS_ACTION",
        "rc_pwm": {1: 1500}.get,
        "override_rc": lambda channel, us: told.overrides.append((channel, us, 0)),
        "rc_with_option": {300: 6}.get,
        "aux_position": lambda function: None,
        "rc_valid": lambda: True,
        "armed": lambda: False,
        "disarm": lambda: True,
        "mode": lambda: 4,
        "set_mode": lambda mode: mode == 4,
        "servo_channel": lambda function: 2 if function == 26 else None,
        "override_servo": lambda *call: told.overrides.append(call),
        "servo_pwm": lambda channel: 1500 + channel,
        "gyro": lambda: (0.1, 0.2, 0.3),
        "accel": lambda: (0.0, 0.0, -9.8),
        "attitude": lambda: (0.5, 0.6, 0.7),
        "velocity_ned": lambda: None,
        "gcs_last_seen_ms": lambda: 250,
        "log_write": lambda *call: told.logged.append(call),
        "statustext": lambda severity, text: told.texts.append((severity, text)),
        "named_float": lambda name, value: None,
    }
    vars(ap).update(functions | changes)
    return ap


def evaluate(expression: str, time: int = 0, **changes: Any) -> str:
    """What a script prints of an expression."""
    told = Told()
    ap = autopilot(told, **changes)
    ap.time = time
    host = LuaHost(cast(Autopilot, ap), f"print({expression})", "test.lua")
    host.poll()
    return told.texts[-1][1]


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        ("uint32_t(5) - uint32_t(7)", "4294967294"),
        ("uint32_t(-1)", "4294967295"),
        ("uint32_t(-1) + 2", "1"),
        ("uint32_t(7) / 2", "3"),
        ("uint32_t(3) * uint32_t(2147483648)", "2147483648"),
        ("uint32_t(12) >> 2 | 16", "19"),
        ("uint32_t(1) < uint32_t(2) and uint32_t(2) <= 2 and uint32_t(2) == uint32_t(2)", "true"),
        ("uint32_t(2) == 2", "false"),
        ("uint32_t(4000000000):toint()", "-294967296"),
        ("uint32_t(16777217):tofloat()", "16777216.0"),
        ("(micros() - uint32_t(4294967290)):tofloat()", "26.0"),
        ("millis()", "4294967"),
    ],
)
def test_uint32(expression: str, value: str) -> None:
    assert evaluate(expression, time=2**32 + 20) == value


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("x = nil + 1", "test.lua:1: attempt to perform arithmetic on a nil value"),
        ("\nahrs:no_such_call()", "test.lua:2: attempt to call a nil value (method 'no_such_call')"),
        ("Parameter('NOPE')", "No parameter: NOPE"),
        ("SRV_Channels:set_output_pwm_chan_timeout(0, 1500.5, 100)", "argument out of range"),
        ("SRV_Channels:set_output_pwm_chan_timeout(0, 70000, 100)", "argument out of range"),
        ("rc.get_pwm(6)", "use a colon"),
        ("rc:get_pwm()", "expects 1 arguments, got 0"),
        ("gcs:send_text(6)", "expects 2 arguments, got 1"),
        ("logger:write('TOOLONG', 'A', 'f', 1)", "Name must be 4 or less chars long"),
        ("logger:write('ABC', 'A,B', 'f', 1)", "label does not match format"),
        ("logger:write('ABC', 'A,B', 'ff', 1)", "format does not match No. of arguments"),
        ("logger:write('ABC', 'A', 'B', 256)", "argument out of range"),
        ("while true do end", "exceeded time limit"),
        ("return 1", "returned bad result count (1)"),
        ("return 1, 2", "did not return a function"),
        ("return print, print", "did not return a delay"),
        ("x = = 1", "Error: test.lua:1: unexpected symbol"),
    ],
)
def test_error_stops_the_script_and_is_told(source: str, message: str) -> None:
    told = Told()
    host = LuaHost(cast(Autopilot, autopilot(told)), source, "test.lua")
    host.poll()
    assert host.error and message in host.error and not host.running
    assert told.texts == [(2, f"Lua: {host.error}")]
    assert not host.poll()


def test_runs_when_asked_to() -> None:
    told = Told()
    ap = autopilot(told)
    host = LuaHost(cast(Autopilot, ap), "local function f() print(millis()) return f, 20 end return f, 10.9")
    ran = []
    for time in range(0, 60_000, 3000):
        ap.time = time
        if host.poll():
            ran.append(time // 1000)
    assert ran == [0, 12, 33, 54] and [text for _, text in told.texts] == ["12", "33", "54"]


def test_log_values_reach_the_autopilot_with_units() -> None:
    told = Told()
    source = (
        "logger:write('ABCD', 'A,B,C', 'fBN', '---', '---', 1.5, 2, 'x') logger:write('AB', 'D', 'f', 0/0)"
    )
    LuaHost(cast(Autopilot, autopilot(told)), source).poll()
    assert told.logged[0] == ("ABCD", "A,B,C", "fBN", (1.5, 2, "x"), "---", "---")
    assert told.logged[1][:3] == ("AB", "D", "f") and told.logged[1][4:] == ("", "")


def test_removed_calls_are_nil_and_must_exist() -> None:
    told = Told()
    source = "print(SRV_Channels.get_output_pwm_chan) print(logger) print(SRV_Channels.find_channel ~= nil)"
    removed = {"SRV_Channels:get_output_pwm_chan", "logger"}
    LuaHost(cast(Autopilot, autopilot(told)), source, removed=removed).poll()
    assert [text for _, text in told.texts] == ["nil", "nil", "true"]
    with pytest.raises(ValueError, match="no rc:no_such"):
        LuaHost(cast(Autopilot, autopilot(told)), source, removed={"rc:no_such"})


def test_exception_of_the_autopilot_is_not_the_scripts_error() -> None:
    def broken() -> bool:
        raise KeyError("a mistake in the embedded rover")

    with pytest.raises(KeyError, match="a mistake"):
        evaluate("arming:is_armed()", armed=broken)


def test_a_channel_is_an_object_whose_override_ends() -> None:
    told = Told()
    source = "rc:get_channel(3):set_override(0) rc:find_channel_for_option(300):set_override(1100)"
    LuaHost(autopilot(told), source).poll()
    assert told.overrides == [(3, 0, 0), (6, 1100, 0)]
    source = "gcs:send_text(6, tostring(rc:find_channel_for_option(301)))"
    LuaHost(autopilot(told), source).poll()
    assert told.texts[-1][1] == "nil"
