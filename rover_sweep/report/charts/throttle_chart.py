"""A throttle sweep as it was driven, the speed's response to the throttle, and the predicted step."""

from __future__ import annotations

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.data.throttle_run import ThrottleRun
from rover_sweep.gains.speed_proposal import AssessedSpeed, SpeedProposal
from rover_sweep.gains.speed_tuning import BEFORE as STEP_AT
from rover_sweep.gains.speed_tuning import driven_step
from rover_sweep.identification.speed.speed_fit import PERIOD, SpeedFit, fitted_speed
from rover_sweep.identification.speed.throttle_coherence import GOOD, ThrottleCoherence
from rover_sweep.report.charts.chart import Chart, Curve, Panel, Stack
from rover_sweep.report.charts.colours import AFTER, BEFORE, DATA, MARK, OUTSIDE
from rover_sweep.report.charts.response_charts import limits_around

AHEAD, COASTED = 3.0, 8.0  # s shown before and after the sweep
SHOWN = 5.0  # s of a predicted step


def throttle_run_chart(run: ThrottleRun, fit: SpeedFit | None, k: int) -> Chart:
    """Throttle and speed over time, with the law's speed. k: index of the run in the fit."""
    start, end = run.span
    first = max(start - AHEAD, run.pwm.t[0], run.speed.t[0])
    last = min(end + COASTED, run.pwm.t[-1], run.speed.t[-1])
    t = start + PERIOD * np.arange(np.ceil((first - start) / PERIOD), (last - start) // PERIOD)
    speeds = [Curve("measured", run.speed.on(t), DATA, width=1.2)]
    if fit is not None:
        at, v = fitted_speed(fit, run, fit.starts[k])
        within = (t >= at[0] - PERIOD / 2) & (t <= at[-1] + PERIOD / 2)
        law = np.where(within, np.interp(t, at, v), np.nan)
        speeds.append(Curve("simulated by the law", law, **AFTER))
    x = t - start
    panels = (
        Panel("throttle, %", x, (Curve("throttle", 100 * run.drive(t), DATA, width=1.2, step=True),)),
        Panel("speed, m/s", x, tuple(speeds), height=170),
    )
    outside = ((-AHEAD, 0.0, OUTSIDE), (end - start, end - start + COASTED, OUTSIDE))
    words = f"{run.name}: throttle sweep of {end - start:.0f} s"
    span = float(x[0]), float(x[-1])
    return Chart((Stack(words, "time since the sweep began, s", panels, span, shades=outside),))


def throttle_response_chart(found: ThrottleCoherence, fit: SpeedFit) -> Chart:
    """Gain, phase and coherence of the speed to the throttle, measured and of the law."""
    w, h = found.w, fit.model.response(found.w)
    low, high = found.band or (float(w[0]), float(w[-1]))
    inside = (w >= 0.999 * low) & (w <= 1.001 * high)
    db, law_db = 20 * np.log10(np.maximum(found.gain, 1e-9)), 20 * np.log10(np.abs(h))
    law_deg = np.degrees(np.unwrap(np.angle(h)))
    deg = np.degrees(found.phase)
    deg = deg - 360.0 * np.round(float(np.median((deg - law_deg)[inside])) / 360.0)
    panels = (
        Panel("magnitude, dB", w, _both(db, law_db), limits=_around(db, law_db, inside, 20), height=170),
        Panel("phase, deg", w, _both(deg, law_deg), limits=_around(deg, law_deg, inside, 60), height=140),
        Panel(
            "coherence",
            w,
            (Curve("coherence", found.coherence, DATA),),
            limits=(0.0, 1.04),
            levels=(GOOD,),
            height=80,
        ),
    )
    shades = ((1e-3, low, OUTSIDE), (high, 1e4, OUTSIDE)) if found.band else ()
    marks = ((low, MARK), (high, MARK)) if found.band else ()
    span = 0.93 * float(w[0]), 1.07 * float(w[-1])
    words = "speed / throttle, m/s per full throttle"
    return Chart((Stack(words, "frequency, rad/s", panels, span, "log", shades, marks),))


def speed_step_chart(proposal: SpeedProposal) -> Chart:
    """The predicted step of the commanded speed, with the current and the proposed settings."""
    tuned = proposal.tuned or proposal.loop
    drives = [
        (words, style, driven_step(loop, plant, judged.settings, judged.step.start, judged.step.size))
        for words, style, loop, judged in (
            ("now", BEFORE, proposal.loop, proposal.now),
            ("proposed", AFTER, tuned, proposal.proposed),
        )
        if judged is not None and (plant := proposal.found.plant) is not None
    ]
    wanted, first = drives[0][2]
    x = first.t - STEP_AT
    kept = x <= SHOWN
    speeds = [Curve("commanded", wanted[kept], DATA, dash=(2, 2), step=True)]
    speeds += [Curve(words, d.speed[kept, 0], **style) for words, style, (_, d) in drives]
    throttle = [Curve(words, 100 * d.throttle[kept, 0], **style) for words, style, (_, d) in drives]
    panels = (
        Panel("speed, m/s", x[kept], tuple(speeds), height=170),
        Panel("throttle, %", x[kept], tuple(throttle)),
    )
    return Chart((Stack(_step_words(proposal.now), "time since the step, s", panels, (-STEP_AT, SHOWN)),))


def _step_words(judged: AssessedSpeed | None) -> str:
    assert judged is not None
    step = judged.step
    return f"predicted step from {step.start:.2f} to {step.start + step.size:.2f} m/s"


def _both(measured: Array, law: Array) -> tuple[Curve, ...]:
    return Curve("measured", measured, DATA, width=2.0), Curve("law", law, **AFTER)


def _around(measured: Array, law: Array, inside: np.ndarray, least: float) -> tuple[float, float]:
    return limits_around([measured[inside], law[inside]], least)
