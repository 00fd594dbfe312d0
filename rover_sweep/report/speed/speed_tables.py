"""The response of the speed, the proposed settings and the recordings as tables."""

from __future__ import annotations

from collections.abc import Mapping

from rover_sweep.gains.speed_proposal import AssessedSpeed, SpeedProposal
from rover_sweep.gains.steering_limits import SteeringLimits
from rover_sweep.identification.speed.identify_speed import SpeedResult
from rover_sweep.identification.speed.speed_parameters import SHARE, SpeedParameter, speed_parameters
from rover_sweep.report.identification.comparison import Cell, Table
from rover_sweep.report.wording.number_format import number, unit

UNITS = {
    "CRUISE_SPEED": "m/s",
    "CRUISE_THROTTLE": "%",
    "ATC_SPEED_P": "",
    "ATC_SPEED_I": "",
    "ATC_SPEED_D": "",
    "ATC_ACCEL_MAX": "m/s²",
}
FREEWHEELS = "The motor freewheels at neutral, so the dead zone cannot be separated from the drag."
NOT_COASTED = "No coasting was recorded: let the rover roll out with the throttle at neutral."


def speed_parameter_table(result: SpeedResult) -> Table | None:
    """Gain, lag, delay, dead zone and drag with their intervals; None without a law."""
    if result.fit is None:
        return None
    found = speed_parameters(result)
    rows = tuple(_parameter(p) for p in found)
    note = "" if "dead_zone" in found else FREEWHEELS if result.coasting is not None else NOT_COASTED
    share = f"The law explains {number(100 * result.fit.fit, 3)} % of the speed's variation."
    headings = ("", "meaning, unit", "value", "90 %")
    return Table("Response of the speed to the throttle", headings, rows, f"{share} {note}".strip(), 2)


def _parameter(p: SpeedParameter) -> tuple[Cell, ...]:
    scale, shown = {SHARE: (100.0, "% throttle"), "s": (1.0, "s")}.get(p.unit, (1.0, unit(p.unit)))
    scale, shown = (1000.0, "ms") if p.name == "delay" else (scale, shown)
    low, high = (number(scale * end, 3) for end in p.interval_90)
    value = Cell(number(scale * p.value, 3), "strong")
    words = Cell(f"{p.meaning}, {shown}")
    name = "coasting" if p.name == "coasting_drag" else p.name.replace("_", " ")  # short, for a phone
    return Cell(name, "strong"), words, value, Cell(f"{low}…{high}")


def speed_gains_table(
    proposal: SpeedProposal, limits: SteeringLimits | None, current: Mapping[str, float]
) -> Table | None:
    """Parameters, current and proposed; None without settings to compare."""
    if proposal.now is None or proposal.proposed is None:
        return None
    new = proposal.proposed.settings.parameters
    rows = [
        _setting(name, UNITS[name], value, new[name], name in proposal.loop.assumed)
        for name, value in proposal.now.settings.parameters.items()
    ]
    if proposal.throttle_min is not None:
        rows.append(_setting("MOT_THR_MIN", "%", 100 * proposal.loop.least, proposal.throttle_min, False))
    if limits is not None:
        rows += [
            _setting(name, shown, current.get(name), value, False)
            for name, shown, value in (
                ("ATC_STR_RAT_MAX", "deg/s", limits.rate_max),
                ("ATC_TURN_MAX_G", "g", limits.turn_g),
            )
            if value is not None
        ]
    note = (
        "ATC_STR_RAT_MAX: 90 % of what the steering's stops reach. ATC_TURN_MAX_G: confirmed by the runs."
        if limits is not None
        else "ATC_STR_RAT_MAX and ATC_TURN_MAX_G need steering sweeps in the same folder of results."
    )
    if limits is not None and limits.lowers:
        note += " It is below the current value only because more was not tested: keep the current one."
    return Table("Settings", ("parameter", "unit", "now", "proposed"), tuple(rows), note, 2)


def _setting(name: str, shown: str, now: float | None, new: float, assumed: bool) -> tuple[Cell, ...]:
    was = f"{now:.4g}{' (default)' if assumed else ''}" if now is not None else "–"
    same = now is not None and f"{now:.4g}" == f"{new:.4g}"
    return Cell(name, "strong"), Cell(shown), Cell(was), Cell(f"{new:.4g}", "" if same else "strong")


def speed_margin_table(proposal: SpeedProposal) -> Table | None:
    """Margins and predicted step of the current and the proposed settings."""
    pairs = (("now", proposal.now), ("proposed", proposal.proposed))
    columns = {words: _judged(judged) for words, judged in pairs if judged is not None}
    if not columns or proposal.now is None:
        return None
    labels = list(next(iter(columns.values())))
    rows = tuple((Cell(label), *(Cell(column[label]) for column in columns.values())) for label in labels)
    step = proposal.now.step
    note = (
        "Worst: within the 90 % intervals, with a battery 10 % up or down; at least 6 dB and 45 deg are "
        f"kept. Step from {step.start:.2f} to {step.start + step.size:.2f} m/s; the tracking error "
        "is to the target that the firmware limits by its acceleration."
    )
    return Table("Margins and predicted step", ("", *columns), rows, note)


def _judged(judged: AssessedSpeed) -> dict[str, str]:
    step, margins = judged.step, judged.margins
    return {
        "gain margin, dB": number(margins.gain_db, 3),
        "phase margin, deg": number(margins.phase_deg, 3),
        "worst gain margin, dB": number(judged.worst_gain, 3),
        "worst phase margin, deg": number(judged.worst_phase, 3),
        "crossover frequency, rad/s": number(margins.crossover, 3),
        "rise time of the step, s": number(step.rise, 3),
        "overshoot, %": number(step.overshoot, 2),
        "tracking error, m/s rms": number(step.error, 2),
        "largest throttle, %": number(100 * step.throttle, 2),
    }


def throttle_run_table(result: SpeedResult) -> Table:
    """Each sweep with its duration, swept frequencies, firmware and file."""
    rows = []
    for run in result.runs:
        files = ", ".join(f"{name} ({sha[:12]})" for name, sha in run.sources)
        swept = f"{number(run.swept[0], 2)}–{number(run.swept[1], 3)}"
        seconds = number(run.span[1] - run.span[0], 3)
        stopped = run.stopped or "complete"
        rows.append(
            (Cell(run.name), Cell(files), Cell(run.firmware), Cell(stopped), Cell(seconds), Cell(swept))
        )
    headings = ("run", "file (SHA-256)", "firmware", "", "s", "rad/s")
    return Table("Throttle sweeps", headings, tuple(rows), text_columns=4)
