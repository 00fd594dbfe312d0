"""parameters.py is what the applet has; the .param files read back; differences are found as float32."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from applet_bench import Bench, Drive
from lupa.lua53 import LuaRuntime

from firmware_params import applet_parameters, param_files
from firmware_params.applet_parameters import PARAMETERS, STATES, applet_source, applet_version, for_manoeuvre


def test_names_and_defaults_are_those_that_the_applet_adds() -> None:
    bench = Bench(parameters={})
    Drive(bench)
    version = {"SWP_VER": float(np.float32(applet_version()))}
    assert bench.parameters == {p.name: float(np.float32(p.default)) for p in PARAMETERS} | version
    assert all(len(p.name) <= 16 for p in PARAMETERS)


def test_ranges_are_those_that_the_applet_refuses_beyond() -> None:
    table = re.search(r"local PARAMETERS = \{(.*?)\n\}", applet_source(), re.DOTALL)
    assert table and len(STATES) == 11
    rows = re.findall(r'\{ "(\w+)", (\S+), (\S+), (\S+) \}', table[1])
    assert f"local AUX_FUNCTION = {applet_parameters.AUX_FUNCTION} " in applet_source()
    assert [("SWP_" + n, float(d), float(lo), float(hi)) for n, d, lo, hi in rows] == [
        (p.name, p.default, p.low, p.high) for p in PARAMETERS
    ]


def test_main_chunk_has_no_more_locals_than_the_autopilot_allows() -> None:
    """ArduPilot's Lua allows 100, a desktop Lua 200; a local more and the script does not load there."""
    load = LuaRuntime(register_eval=False).globals().load

    def loads_beside(others: int) -> bool:
        names = ", ".join(f"_{k}" for k in range(others))
        return not isinstance(load(f"local {names}\n{applet_source()}"), tuple)

    assert loads_beside(100)
    assert not loads_beside(200 - 40)  # and the test can tell


def test_values_for_a_manoeuvre() -> None:
    values = for_manoeuvre("doublet", amplitude=120, pulse=0.5, v_min=1, pwm_max=200)
    assert values == {"SWP_TYPE": 1, "SWP_AMP": 120, "SWP_PULSE": 0.5, "SWP_V_MIN": 1, "SWP_PWM_MAX": 200}
    for kind, numbers, complaint in (
        ("chirp", {}, "no manoeuvre 'chirp'"),
        ("sweep", {"amplitud": 3}, "no parameter for amplitud"),
        ("sweep", {"t_rec": 0}, "SWP_TREC 0 s is outside 1 to 600"),
        ("sweep", {"run": 4}, "no parameter for run"),
    ):
        with pytest.raises(ValueError, match=complaint):
            for_manoeuvre(kind, **numbers)


@pytest.mark.parametrize("name", ["identification", "raw_imu"])
def test_shipped_files_have_a_reason_on_every_line(name: str) -> None:
    wanted = param_files.read(param_files.shipped(name))
    assert wanted and all(len(p.reason) > 10 and len(p.name) <= 16 for p in wanted)
    reboot = {p.name for p in wanted if p.needs_reboot}
    assert reboot == {p.name for p in wanted} & {"SCR_ENABLE", "SCR_HEAP_SIZE", "SCHED_LOOP_RATE"}
    with pytest.raises(ValueError, match="'race'; there are identification, raw_imu"):
        param_files.shipped("race")


def test_formats_of_parameter_files() -> None:
    text = "# heading\n\nINS_GYRO_FILTER,20\nRC6_OPTION\t300 # switch [reboot]\nLOG_BITMASK = 0xFFFF"
    text += "\nA 1 @READONLY"
    assert param_files.parse(text) == (
        param_files.WantedParameter("INS_GYRO_FILTER", 20),
        param_files.WantedParameter("RC6_OPTION", 300, "switch", True),
        param_files.WantedParameter("LOG_BITMASK", 65535),
        param_files.WantedParameter("A", 1),
    )


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("A 1\nB", "file, line 2: 'B' is not NAME value"),
        ("A one", "line 1: 'A one'"),
        ("A 1 2", "line 1: 'A 1 2'"),
        ("A 1\nA 2", "line 2: A is there twice"),
    ],
)
def test_bad_lines_are_named(text: str, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        param_files.parse(text, "file")


def test_differences_are_those_of_float32() -> None:
    wanted = param_files.parse(
        "FS_TIMEOUT 1.1 # as the firmware\nSCR_ENABLE 1 # Lua [reboot]\nRC6_OPTION 300\nGONE 0"
    )
    vehicle = {"FS_TIMEOUT": float(np.float32(1.1)), "SCR_ENABLE": 0.0, "RC6_OPTION": 300.0}
    scripting, gone = param_files.compare(vehicle, wanted)
    assert scripting == param_files.Difference(
        "SCR_ENABLE", 1, 0, "Lua", True, "SCR_ENABLE is 0, wanted 1: Lua (counts after a reboot)"
    )
    assert gone.found is None and gone.sentence == "GONE does not exist on this vehicle, wanted 0"
    assert param_files.compare(vehicle | {"FS_TIMEOUT": 1.1000003}, wanted[:1])


def test_larger_value_will_do_where_the_line_says_so() -> None:
    (heap,) = param_files.parse("SCR_HEAP_SIZE 102400 # room [at least] [reboot]")
    assert heap == param_files.WantedParameter("SCR_HEAP_SIZE", 102400, "room", True, True)
    assert param_files.compare({"SCR_HEAP_SIZE": 204800}, [heap]) == ()
    (small,) = param_files.compare({"SCR_HEAP_SIZE": 43008}, [heap])
    assert small.sentence == "SCR_HEAP_SIZE is 43008, wanted at least 102400: room (counts after a reboot)"


def test_imports_nothing_of_the_other_parts() -> None:
    for module in Path(applet_parameters.__file__).parent.glob("*.py"):
        assert not re.search(
            r"^\s*(from|import) (rover_sweep|sitl)", module.read_text(encoding="utf-8"), re.M
        )
