"""The paper's findings on single parameters: inertia, tyres, delays, roll, structure, bands, speed limits."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from math import pi, sqrt

from rover_sweep.identification.handling import handling
from rover_sweep.report.wording.number_format import SHORT_NAMES, number, symbol
from rover_sweep.study import published
from rover_sweep.study.findings import StudyFinding, agreement, ms, signed_percent
from rover_sweep.study.virtual_study import Practice, Study, true_delay

PHYSICAL = ("bicycle", "roll-yaw")


def inertia_finding(study: Study) -> StudyFinding:
    """Sections 6.1 and 6.2: Izz against the swing test."""
    true, swing = study.truth.values["Izz"], published.SWING_TEST["Izz"]
    printed = {m: signed_percent(published.PARAMETERS[m]["Izz"].value / swing - 1) for m in PHYSICAL}
    ours = {m: abs(study.paper.fit(m)["Izz"].value / true - 1) for m in PHYSICAL}
    found = "; ".join(f"{p.title}: {_inertias(p, true)}" for p in study.practices.values())
    text = (
        f"Compared with this rover's {number(true, 2)} kg m², the result of a perfect swing test: {found}. "
        f"{_why_inertia(study, true)} In the paper, {published.DOUBTS['Izz']}."
    )
    claim = (
        f"The roll-yaw model's I_zz is nearer to the swing test ({printed['roll-yaw']}) than the bicycle's "
        f"({printed['bicycle']})."
    )
    return StudyFinding("inertia", claim, agreement(ours["roll-yaw"] < ours["bicycle"]), text)


def _inertias(practice: Practice, true: float) -> str:
    return ", ".join(f"{m} {signed_percent(practice.fit(m)['Izz'].value / true - 1)}" for m in PHYSICAL)


def _why_inertia(study: Study, true: float) -> str:
    """The effect of V_y' on the roll-yaw model's Izz: without it, and with the estimator's lag removed."""
    known, default = (study.practices[k].fit("roll-yaw")["Izz"] for k in ("known", "default"))
    prompt = study.counterfactuals.prompt["Izz"].value / true - 1
    now = known.value / true - 1
    words = (
        f"V̇_y comes from the estimator, whose velocity over ground lags by "
        f"{ms(study.runs.asphalt.velocity_lag)}; in a turn V_y lacks this lag times V r. The roll-yaw fit "
        f"(filters known) is off by {signed_percent(now)}, and by {signed_percent(prompt)} with the lag "
        "removed from the measured response"
    )
    bounds = f"{number(known.cr_percent, 2)} % with V̇_y, {number(default.cr_percent, 2)} % without"
    if abs(prompt) < 0.5 * abs(now):
        return f"{words}, so this lag causes most of the error. The Cramer-Rao bound misses it ({bounds})."
    return f"{words}, so this lag is not the cause. The Cramer-Rao bound is {bounds}."


def stiffness(study: Study) -> StudyFinding:
    """Section 6.2: C of the roll-yaw model against the bicycle's."""
    true = (study.truth.values["Cf"] + study.truth.values["Cr"]) / 2
    ours, known = ({m: p.fit(m)["C"].value for m in PHYSICAL} for p in (study.paper, study.known))
    printed = {m: published.PARAMETERS[m]["C"].value for m in PHYSICAL}
    apart, in_print = (c["roll-yaw"] / c["bicycle"] - 1 for c in (ours, printed))
    text = (
        f"As in the paper: bicycle {number(ours['bicycle'], 3)}, roll-yaw {number(ours['roll-yaw'], 3)} "
        f"N/rad, {signed_percent(apart)} apart ({signed_percent(in_print)} in the paper); with the filters "
        f"known {number(known['bicycle'], 3)} and {number(known['roll-yaw'], 3)}. This rover's axles have "
        f"{number(true, 3)} on average at zero slip."
    )
    if apart <= 0.5 * in_print:
        text += (
            f" Leaving out roll changes C by only {abs(100 * apart):.0f} % here; the difference in the "
            "paper has another cause."
        )
    nearer = abs(ours["roll-yaw"] - true) < abs(ours["bicycle"] - true)
    claim = (
        "The roll-yaw model's cornering stiffness is much higher than the bicycle's and the more plausible "
        "one (Tables 2 and 3)."
    )
    return StudyFinding("stiffness", claim, agreement(apart > 0.5 * in_print, nearer), text)


def delays(study: Study) -> StudyFinding:
    """Tables 2 to 4: equivalent delays of 71 to 88 ms, and how much of them the sensor filters explain."""
    names = published.MODELS
    ours, known = ({m: p.fit(m)["tau"].value for m in names} for p in (study.paper, study.known))
    printed = {m: published.PARAMETERS[m]["tau"].value for m in names}
    share = {m: ours[m] - known[m] for m in names}
    left = printed["roll-yaw"] - share["roll-yaw"]
    text = (
        f"As in the paper: {_times(ours)} (published: {_times(printed)}). With the filters known: "
        f"{_times(known)}; the servo's own delay and lag are {ms(true_delay(study.runs))}. So the filters "
        f"cause {ms(min(share.values()))} to {ms(max(share.values()))} of τ, in the roll-yaw model "
        f"{100 * share['roll-yaw'] / ours['roll-yaw']:.0f} % of it. "
        f"{_gyro_words(study, known['roll-yaw'])} If the published rover had these filters, its "
        f"{ms(printed['roll-yaw'])} leave about {ms(left)} for the servo."
    )
    near = (abs(ours[m] / printed[m] - 1) <= 0.25 for m in names)
    claim = (
        "The models need an equivalent delay of 71 to 88 ms (Tables 2 to 4), which it attributes to "
        "higher-order dynamics that are not modelled."
    )
    return StudyFinding("delays", claim, agreement(*near), text)


def _gyro_words(study: Study, known: float) -> str:
    """The gyro filter's part alone."""
    firmware = study.runs.firmware
    gyro, accelerometer = (
        sqrt(2) / (2 * pi * hz) for hz in (firmware.gyro_filter_hz, firmware.accel_filter_hz)
    )
    alone = study.counterfactuals.gyro_ignored["tau"].value - known
    return (
        f"The gyro's {firmware.gyro_filter_hz:g} Hz low-pass, {ms(gyro)} of lag in r and p, causes "
        f"{ms(alone)} of that alone: the same τ also serves a_y ({firmware.accel_filter_hz:g} Hz, "
        f"{ms(accelerometer)}) and V̇_y (none)."
    )


def _times(values: Mapping[str, float]) -> str:
    return ", ".join(f"{m} {ms(v)}" for m, v in values.items())


def roll(study: Study) -> StudyFinding:
    """Sections 7 and 9: the bicycle has no roll, which shows in a_y as well."""
    p = study.runs.checks["fast"].manoeuvre("p").x
    known, ignored = (
        {m: q.result.models[m].costs["ay"] for m in PHYSICAL} for q in (study.known, study.paper)
    )
    printed = {m: published.COSTS[m]["ay"] for m in PHYSICAL}
    worse = known["bicycle"] > known["roll-yaw"]
    hidden = (ignored["bicycle"] > ignored["roll-yaw"]) != worse
    text = (
        f"It has no output p (rms {number(float(p.std()) * 180 / pi, 2)} deg/s in the doublet at 4 "
        f"m/s), so its J_ave leaves p out. In a_y its J is {number(known['bicycle'], 3)} against the "
        f"roll-yaw model's {number(known['roll-yaw'], 3)} with the filters known (published "
        f"{printed['bicycle']:g} against {printed['roll-yaw']:g}), {number(ignored['bicycle'], 3)} against "
        f"{number(ignored['roll-yaw'], 3)} with them ignored{', whose lag hides it' if hidden else ''}."
    )
    claim = "The bicycle cannot predict roll, and fits a_y less well than the roll-yaw model does (Table 5)."
    return StudyFinding("roll", claim, agreement(True, worse, not hidden), text)


def structure(study: Study) -> StudyFinding:
    """Table 4: which derivatives were dropped, and how certain the rest is."""
    rows = published.PARAMETERS["lumped"]
    printed = {n for n, p in rows.items() if not p.free}
    lumped, table_4 = study.paper.fit("lumped"), study.counterfactuals.as_table_4
    ours = {e.name for e in lumped.estimates if not e.free and e.name in rows}
    worst, worst_4 = (
        max((e for e in f.estimates if e.free), key=lambda e: e.cr_percent or 0.0) for f in (lumped, table_4)
    )
    text = (
        f"Dropped here: {_symbols(ours)}; in the paper: {_symbols(printed)}; in both: "
        f"{_symbols(ours & printed)}. The largest bound left is {number(worst.cr_percent, 2)} % "
        f"({symbol(worst.name)}), 33 % in the paper (N_v). Table 4's choice of free derivatives, fitted to "
        f"these runs, costs J_ave {number(table_4.average, 3)} against {number(lumped.average, 3)}, and "
        f"its largest bound is {_bound(worst_4.cr_percent)} % ({symbol(worst_4.name)})"
    )
    text += (
        ": some of its free derivatives are nearly interchangeable here."
        if (worst_4.cr_percent or 0.0) > 60
        else "."
    )
    claim = "Reduction leaves ten derivatives and a delay, some with Cramer-Rao bounds near 30 % (Table 4)."
    near = len(ours ^ printed) <= 2
    return StudyFinding("structure", claim, agreement(near, 20 < (worst.cr_percent or 0.0) < 60), text)


def _bound(percentage: float | None) -> str:
    return "above 1000" if (percentage or 0.0) > 1000 else number(percentage, 2)


def _symbols(names: Collection[str]) -> str:
    order = [n for n in published.PARAMETERS["lumped"] if n in names]
    return ", ".join(symbol(n) for n in order) or "none"


def coherence_finding(study: Study) -> StudyFinding:
    """Section 5: the bands of coherence above 0.6."""
    found = study.coherent
    words = ", ".join(f"{SHORT_NAMES[o]} {_band(found.get(o))}" for o in published.BANDS)
    as_wide = {o: _covers(found.get(o), band) for o, band in published.BANDS.items()}
    text = f"Coherence of at least 0.6 here: {words} rad/s."
    if not as_wide["vydot"]:
        text += (
            " V̇_y falls short: with the published numbers V_y is only "
            f"{number(_steady_sideslip(study), 2)} m times r in a steady turn at "
            f"{study.known.group.speed:.1f} m/s (b - m a V²/(C L)), so at low frequency the road and "
            "the errors of the estimator exceed the response to the steering. The fits still use the paper's "
            "band, with the low weight of its coherence."
        )
    claim = "Usable from 0.2 (r, a_y), 0.6 (p) and 3 rad/s (V̇_y) up to 20 or 25 rad/s (section 5)."
    return StudyFinding("bands", claim, agreement(*as_wide.values()), text)


def _covers(band: tuple[float, float] | None, wanted: tuple[float, float]) -> bool:
    """Whether a band covers another one within the frequencies of the sweep."""
    low = max(wanted[0], published.SWEEP["w_min"])
    return band is not None and band[0] <= 1.1 * low and band[1] >= 0.95 * wanted[1]


def _steady_sideslip(study: Study) -> float:
    """V_y/r [m] in a steady turn of the linear model."""
    p = study.truth.values
    return p["b"] - p["m"] * p["a"] * study.known.group.speed**2 / (p["Cr"] * (p["a"] + p["b"]))


def _band(band: tuple[float, float] | None) -> str:
    return f"{band[0]:.2g} to {band[1]:.3g}" if band else "nowhere"


def yaw_rate(study: Study) -> StudyFinding:
    """Section 4: the yaw rate during the sweep."""
    run = study.runs.sweeps[0]
    start, end = run.span
    slow = run["r"].between(start, (start + end) / 2).x
    peak = float(abs(slow - slow.mean()).max()) * 180 / pi
    low, high = published.PEAK_YAW_RATE
    text = (
        f"Its peak in the slow half of the first sweep is {peak:.0f} deg/s. (The scale from PWM to angle, "
        f"{1000 * study.runs.asphalt.rad_per_us:.2g} mrad/µs, is not in the paper and was chosen to match.)"
    )
    claim = "±150 µs give about ±40 to 45 deg/s of yaw rate, until it rolls off (Figure 2)."
    return StudyFinding("yaw-rate", claim, agreement(0.9 * low <= peak <= 1.1 * high), text)


def speed_limit(study: Study) -> StudyFinding:
    """Not in the paper: its rover oversteers, and its models are unstable above a speed."""
    ours = {m: handling(study.known.fit(m)).get("critical_speed") for m in PHYSICAL}
    words = ", ".join(f"{m} {number(v, 2) + ' m/s' if v else 'never'}" for m, v in ours.items())
    inside = [
        bool(v and abs(v / printed - 1) < 0.1) for v, printed in zip(ours.values(), CRITICAL, strict=True)
    ]
    text = f"Unstable above: {words} (filters known). The lumped model has no such speed."
    claim = (
        "Not stated in the paper, but a result of its numbers (a > b): the bicycle model is unstable above "
        "5.6 m/s, the roll-yaw model above 7.0 m/s."
    )
    return StudyFinding("speed-limit", claim, agreement(*inside), text)


CRITICAL = (5.6, 7.0)  # m/s, from the published parameters
FOUND: tuple[Callable[[Study], StudyFinding], ...] = (
    inertia_finding,
    stiffness,
    delays,
    roll,
    structure,
    coherence_finding,
    yaw_rate,
    speed_limit,
)
