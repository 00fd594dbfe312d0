"""Multisine and bias sweep on the command line, and as the parameters that make the applet drive them."""

from __future__ import annotations

import click
import pytest

from rover_sweep.cli.driving_options import LIMIT, Manoeuvres, manoeuvre_type
from rover_sweep.errors import UsageError
from rover_sweep.manoeuvre.multisine import Multisine
from rover_sweep.manoeuvre.sweep import (
    BiasSweep,
    Doublet,
    Manoeuvre,
    Sweep,
    parameters_of,
    refuse_undersampled,
)
from rover_sweep.session.content import SessionRun
from rover_sweep.session.simulated_rover import SimulatedRover, simulated_plan


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ("240", Multisine(amplitude=240)),
        ("200,0.5,20,40,4", Multisine(amplitude=200, w_min=0.5, w_max=20, t_rec=40, periods=4)),
        ("200,trec=40,periods=4,fade=1", Multisine(amplitude=200, t_rec=40, periods=4, fade=1)),
        ("80,-100", BiasSweep(amplitude=80, bias=-100)),
        ("80,100,0.5,20,40", BiasSweep(amplitude=80, bias=100, w_min=0.5, w_max=20, t_rec=40)),
    ],
)
def test_numbers_in_order_or_by_name(text: str, meant: Manoeuvre) -> None:
    assert manoeuvre_type(type(meant)).convert(text, None, None) == meant


@pytest.mark.parametrize(
    ("kind", "text", "said"),
    [
        (Multisine, "200,periods=2.5", "periods must be a whole number"),
        (Multisine, "200,periods=1", "2, 3 .. whole periods"),
        (Multisine, "200,bias=50", "there is no 'bias'"),
        (BiasSweep, "80,100,5,2", "need 0 < w_min < w_max"),
        (BiasSweep, "80,,", "is not a number"),
    ],
)
def test_nonsense_is_refused(kind: type[Manoeuvre], text: str, said: str) -> None:
    with pytest.raises(click.BadParameter, match=said):
        manoeuvre_type(kind).convert(text, None, None)


def test_parameters_of_the_applet() -> None:
    values = parameters_of(Multisine(amplitude=200, periods=4))
    assert (values["SWP_TYPE"], values["SWP_AMP"], values["SWP_COUNT"]) == (2, 200, 4)
    values = parameters_of(BiasSweep(amplitude=80, bias=-100))
    assert (values["SWP_TYPE"], values["SWP_AMP"], values["SWP_BIAS"]) == (3, 80, -100)
    sweep = parameters_of(Sweep(amplitude=120, w_max=20), v_max=3.0)
    assert (sweep["SWP_TYPE"], sweep["SWP_AMP"], sweep["SWP_WMAX"], sweep["SWP_V_MAX"]) == (0, 120, 20, 3)
    doublet = parameters_of(Doublet(pulse=0.5))
    assert (doublet["SWP_TYPE"], doublet["SWP_PULSE"], doublet["SWP_COUNT"]) == (1, 0.5, 2)
    with pytest.raises(UsageError, match="SWP_COUNT 21"):
        parameters_of(Multisine(periods=21))
    with pytest.raises(UsageError, match="amplitude, kind: set by the manoeuvre"):
        parameters_of(Multisine(), amplitude=3, kind=1)


@pytest.mark.parametrize("text", ["v_max=nan", "v_max=-inf", "v_max=", "v_max=fast"])
def test_a_limit_that_is_no_number_is_refused(text: str) -> None:
    with pytest.raises(click.BadParameter, match="is not a number"):
        LIMIT.convert(text, None, None)


def test_what_is_too_fast_or_too_far_is_refused_before_anything_starts() -> None:
    with pytest.raises(UsageError, match="samples per period"):
        refuse_undersampled(Multisine(w_max=40, periods=4), 50.0)
    with pytest.raises(UsageError, match="a run of 420 us exceeds the 400 us"):
        simulated_plan((SessionRun("far", BiasSweep(amplitude=220, bias=-200)),), SimulatedRover())
    given = Manoeuvres((), (Doublet(),), (Multisine(),), (BiasSweep(amplitude=180, bias=200),), ())
    plan = simulated_plan(given.runs, SimulatedRover())
    assert [run.name for run in plan.runs] == ["multisine1", "bias-sweep1", "doublet"]
    assert plan.settings.extra["pwm_max"] == 380
