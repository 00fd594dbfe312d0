"""The result as tables like Tables 2 to 6 of the paper, the same for the terminal and the page."""

from __future__ import annotations

from collections.abc import Mapping

from rover_sweep.data.results import ends_words, number
from rover_sweep.identification.acceptance import TITLES, inertia_of, judged_runs, ordered, rejection, usable
from rover_sweep.identification.fit import Estimate, FitResult
from rover_sweep.identification.pipeline import Identification, ModelResult
from rover_sweep.identification.state_space import OUTPUTS
from rover_sweep.identification.verdicts import (
    CR_GUIDE,
    I_GUIDE,
    J_ACCEPTABLE,
    J_GOOD,
    J_RMS_GUIDE,
    TIC_GUIDE,
    ReductionStep,
)
from rover_sweep.identification.verify import Overlay
from rover_sweep.report.document import Cell, Table, Tone
from rover_sweep.report.wording import (
    FOOT,
    OUTPUT_NAMES,
    SHORT_NAMES,
    SI,
    Provenance,
    ShownUnits,
    band,
    change,
    percent,
    symbol,
    unit,
)

SINGLE_J = 150.0  # a single response up to 150-200 is tolerable (Tischler & Remple 2012)
IGNORED = "filters ignored"
INTERVALS = (
    "Intervals: bootstrap with noise like the residuals, through the whole method, corrected for its bias. "
    "Those of the bicycle and roll-yaw model also include a refit with a lag of the steering, 3 % for "
    "steering scale, lengths and speed (τ: 2.5 ms), and the stiffness that tyres lose at this amplitude. "
    "Fixed values of the vehicle file count as exact."
)

NUMBERS = (
    "The intervals allow for the vehicle file's uncertainties, a lag of the steering, the bend of the tyres, "
    "and normal differences of both axles. CIFER fit: of the responses alone, with the vehicle file as exact."
)
CIFER = "Trust the interval; CR and I are for comparison with CIFER."


def numbers_table(result: Identification) -> Table | None:
    """The rover's numbers with intervals, those of the recommended model's fit beside; None without any."""
    name = result.recommended or ""
    if not result.numbers or name not in result.models:
        return None
    fitted = {e.name: e.value for e in result.models[name].fit.estimates if e.free}
    if "C" in fitted:
        fitted |= {"Cf": fitted["C"], "Cr": fitted["C"]}
    rows = tuple(
        (
            Cell(symbol(e.name), "strong"),
            Cell(e.meaning),
            Cell(number(e.value, 3), "strong"),
            Cell(unit(e.unit)),
            Cell(ends_words(e.low, e.high)),
            Cell(number(fitted.get(e.name), 3), "muted"),
        )
        for e in result.numbers
    )
    headings = ("", "description", "value", "unit", "90 % interval", "CIFER fit")
    return Table("Numbers of the rover", headings, rows, NUMBERS, 2)


def main_table(result: Identification) -> Table | None:
    """The rover's numbers, or else the free parameters of the recommended model; None without either."""
    name = result.recommended
    if not name or name not in result.models or rejection(result, name):
        return None
    return numbers_table(result) or parameter_table(result, name, brief=True)


def parameter_table(result: Identification, name: str, brief: bool = False) -> Table:
    """Description, value, unit, interval, CR and insensitivity of one model, as Tables 2, 3 and 4.

    Without intervals, their column shows which parameters are free. brief: the free parameters only, without
    CR and I where there are intervals.
    """
    model, reason = result.models[name], rejection(result, name)
    free = [e for e in model.fit.estimates if e.free]
    speed = Estimate("V", "m/s", model.fit.speed, False, None, None, meaning="forward speed")
    fixed = [] if brief else [speed, *(e for e in model.fit.estimates if not e.free)]
    rows = [_free_row(e, reason) for e in free] + [_fixed_row(e) for e in fixed]
    known = not reason and any(e.interval for e in free)
    headings = ("", "description", "value", "unit", "90 % interval" if known else "", "CR %", "I %")
    note = f"The numbers were rejected: {reason}." if reason else ""
    if known and not brief:
        note = f"{INTERVALS} {CIFER}"
    kept = 5 if known and brief else 7
    title = f"{TITLES.get(name, name)} model"
    return Table(title, headings[:kept], tuple(row[:kept] for row in rows), note, 2)


def _free_row(e: Estimate, reason: str | None) -> tuple[Cell, ...]:
    if reason:
        value: tuple[Cell, ...] = (Cell("not identifiable", "bad"), Cell(unit(e.unit)))
        return (Cell(symbol(e.name)), Cell(e.meaning), *value, Cell("free"), Cell("–"), Cell("–"))
    bound = " (at its bound)" if e.at_bound else ""
    return (
        Cell(symbol(e.name), "strong"),
        Cell(e.meaning),
        Cell(number(e.value) + bound, "strong"),
        Cell(unit(e.unit)),
        Cell(_interval(e)),
        Cell(percent(e.cr_percent), _guideline_tone(e.cr_percent, CR_GUIDE)),
        Cell(percent(e.insensitivity_percent), _guideline_tone(e.insensitivity_percent, I_GUIDE)),
    )


def _interval(e: Estimate) -> str:
    return "free" if e.interval is None else ends_words(e.interval.low, e.interval.high, 4)


def _fixed_row(e: Estimate) -> tuple[Cell, ...]:
    texts = (symbol(e.name), e.meaning, number(e.value), unit(e.unit), "fixed", "–", "–")
    return tuple(Cell(text, "muted") for text in texts)


def _guideline_tone(value: float | None, guide: float) -> Tone:
    return "warn" if value is not None and not value <= guide else ""


def cost_table(result: Identification) -> Table:
    """J of each response and model, as Table 5, with the averages over the fitted and over all responses."""
    models = ordered(result)
    rows = [
        (Cell(_response_name(o)), *(_cost_cell(m, o) for m in models.values()))
        for o in (*OUTPUTS, *_to_other_inputs(models))
        if any(o in m.costs for m in models.values())
    ]
    fitted = [Cell(f"{m.fit.average:.1f}", _cost_tone(m.fit.average)) for m in models.values()]
    everything = [Cell(f"{m.average_all:.1f}", _cost_tone(m.average_all)) for m in models.values()]
    rows += [(Cell("J_ave, fitted", "strong"), *fitted), (Cell("J_ave, all responses"), *everything)]
    note = (
        "J of equation (11): ≤ 50 nearly indistinguishable from the data, ≤ 100 acceptable. "
        "In brackets: not in the fit."
    )
    headings = ("response", *(TITLES.get(n, n) for n in models))
    return Table("Cost J of the frequency responses", headings, tuple(rows), note)


def _to_other_inputs(models: Mapping[str, ModelResult]) -> list[str]:
    """Labels output/input of the responses to inputs other than the steering."""
    return list(dict.fromkeys(label for m in models.values() for label in m.costs if "/" in label))


def _response_name(label: str) -> str:
    output, _, input = label.partition("/")
    return f"{OUTPUT_NAMES[output]} / {input or 'δ'}"


def _cost_cell(model: ModelResult, output: str) -> Cell:
    if output not in model.costs:
        return Cell("n/a", "muted")
    j = model.costs[output]
    tone: Tone = "warn" if j > SINGLE_J else ""
    return Cell(f"{j:.1f}", tone) if output in model.fit.costs else Cell(f"({j:.1f})", tone)


def _cost_tone(average: float) -> Tone:
    return "good" if average <= J_GOOD else "strong" if average <= J_ACCEPTABLE else "warn"


def verification_tables(result: Identification, units: ShownUnits = SI) -> tuple[Table, ...]:
    """J_rms and TIC of each model on each run of the verification, as Table 6."""
    models = ordered(result)
    count = max((len(m.verification) for m in models.values()), default=0)
    return tuple(_verification_table(models, k, units) for k in range(count))


def _verification_table(models: Mapping[str, ModelResult], k: int, units: ShownUnits) -> Table:
    verdicts = {n: m.verification[k] for n, m in models.items() if k < len(m.verification)}
    first = next(iter(verdicts.values()))
    rows: list[tuple[Cell, ...]] = [
        (Cell("J_rms", "strong"), *(_guided(v.j_rms, J_RMS_GUIDE) for v in verdicts.values())),
        (Cell("TIC", "strong"), *(_guided(v.tic, TIC_GUIDE) for v in verdicts.values())),
    ]
    for channel in ("r", "ay", "p"):
        found = [next((o for o in v.overlays if o.channel == channel), None) for v in verdicts.values()]
        if any(found):
            shown = units.acceleration if channel == "ay" else "deg/s"
            rows.append(
                (Cell(f"J_rms of {SHORT_NAMES[channel]}, {shown}"), *(_channel_j(o, units) for o in found))
            )
            rows.append((Cell(f"TIC of {SHORT_NAMES[channel]}"), *(_channel_tic(o) for o in found)))
    note = (
        "Equations (15) and (16) over those of r, a_y and p that the model has; together in deg/s and "
        "ft/s², as in the paper. Guidelines: J_rms ≤ 1 to 2, TIC ≤ 0.25 to 0.35."
    )
    headings = ("", *(TITLES.get(n, n) for n in verdicts))
    return Table(f"Verification on {first.run} at {first.speed:.2f} m/s", headings, tuple(rows), note)


def _guided(value: float, guide: float) -> Cell:
    return Cell(number(value, 3), _guideline_tone(value, guide))


def _channel_j(overlay: Overlay | None, units: ShownUnits) -> Cell:
    """J_rms of a channel; the overlay is in the units of the paper."""
    if overlay is None:
        return Cell("n/a", "muted")
    return Cell(number(overlay.j_rms * (FOOT * units.per_si if overlay.unit.startswith("ft") else 1.0), 3))


def _channel_tic(overlay: Overlay | None) -> Cell:
    return Cell(number(overlay.tic, 2)) if overlay else Cell("n/a", "muted")


def inertia_table(result: Identification, provenance: Provenance) -> Table | None:
    """The yaw inertia of the vehicle file compared with each model's, None without either."""
    stated = provenance.vehicle.yaw_inertia if provenance.vehicle else None
    value = stated.value if stated else result.geometry.yaw_inertia
    found = {n: e for n, m in usable(result).items() if (e := inertia_of(m))}
    if value is None or not found:
        return None
    sd = f"± {number(stated.sd, 2)}" if stated and stated.sd is not None else "no uncertainty stated"
    rows: list[tuple[Cell, ...]] = [(Cell("vehicle file"), Cell(number(value)), Cell(sd), Cell("–"))]
    for name, e in found.items():
        bound = f"± {number(e.value * (e.cr_percent or 0) / 100, 2)}"
        difference = Cell(change(100 * (e.value / value - 1)), "strong")
        title = Cell(f"{TITLES.get(name, name)} model")
        rows.append((title, Cell(number(e.value)), Cell(bound), difference))
    note = (
        "±: standard deviation (vehicle file), Cramer-Rao bound (models). In the paper the models are within "
        "25 % (bicycle) and 12 % (roll-yaw) of the swing test."
    )
    return Table("Yaw inertia I_zz, kg m²", ("", "I_zz", "±", "difference %"), tuple(rows), note)


def filters_table(result: Identification) -> Table | None:
    """Every model fitted without the sensors' low-pass filters, for comparison; None without filters."""
    rows: list[tuple[Cell, ...]] = []
    for name, model in usable(result).items():
        if other := model.variants.get(IGNORED):
            rows += _side_by_side(TITLES.get(name, name), model.fit, other)
    if not rows:
        return None
    headings = ("model", "", "with the filters", "ignored", "change %")
    return Table("If the sensors' filters are ignored", headings, tuple(rows), "", 2)


def _side_by_side(title: str, fit: FitResult, other: FitResult) -> list[tuple[Cell, ...]]:
    rows: list[tuple[Cell, ...]] = []
    for e in (e for e in fit.estimates if e.free):
        moved = 100 * (other[e.name].value / e.value - 1) if e.value else None
        tone: Tone = "warn" if moved is not None and abs(moved) > 10 else ""
        label = f"{symbol(e.name)}, {unit(e.unit)}"
        cells = Cell(number(e.value)), Cell(number(other[e.name].value)), Cell(change(moved), tone)
        rows.append((Cell("" if rows else title, "strong"), Cell(label), *cells))
    averages = Cell(f"{fit.average:.1f}", "strong"), Cell(f"{other.average:.1f}", "strong"), Cell("")
    return [*rows, (Cell(""), Cell("J_ave", "strong"), *averages)]


def variants_table(result: Identification, name: str) -> Table | None:
    """Parameters and costs of a model in its other fits, None where all are the fit itself."""
    model = result.models[name]
    others = {n: f for n, f in model.variants.items() if f.structure.values != model.fit.structure.values}
    fits = {"the fit": model.fit, **others}
    if len(fits) < 2 or rejection(result, name):
        return None
    names = list(dict.fromkeys(e.name for f in fits.values() for e in f.estimates if e.free))
    units = {e.name: e.unit for f in fits.values() for e in f.estimates}
    rows = [(Cell(f"{symbol(n)}, {unit(units[n])}"), *(_value(f, n) for f in fits.values())) for n in names]
    outputs = [o for o in OUTPUTS if any(o in f.costs for f in fits.values())]
    rows += [(Cell(f"J of {SHORT_NAMES[o]}"), *(_j(f, o) for f in fits.values())) for o in outputs]
    rows.append((Cell("J_ave", "strong"), *(Cell(f"{f.average:.1f}", "strong") for f in fits.values())))
    return Table(f"Other fits of the {name} model", ("", *fits), tuple(rows))


def _j(fit: FitResult, output: str) -> Cell:
    return Cell(f"{fit.costs[output]:.1f}") if output in fit.costs else Cell("–", "muted")


def _value(fit: FitResult, name: str) -> Cell:
    found = next((e for e in fit.estimates if e.name == name), None)
    if found is None:
        return Cell("–", "muted")
    return Cell(number(found.value), "" if found.free else "muted")


def reduction_table(model: ModelResult) -> Table | None:
    """The steps of the model structure reduction, None without any."""
    if not model.reduction:
        return None
    rows = tuple(
        (
            Cell(symbol(s.parameter)),
            Cell(s.reason),
            Cell(_outcome(s, model)),
            Cell(f"{s.before:.2f}"),
            Cell(f"{s.after:.2f}"),
        )
        for s in model.reduction
    )
    headings = ("parameter", "reason to test", "", "J_ave before", "J_ave without")
    note = (
        "A parameter is dropped, or fixed at the vehicle file's value, if J_ave hardly rises without it "
        "(5 % and 1)."
    )
    return Table("Model structure reduction", headings, rows, note, 3)


def _outcome(step: ReductionStep, model: ModelResult) -> str:
    if not step.dropped:
        return "kept: unstable without it" if step.unstable else "kept"
    if model.fit.structure.name == "lumped":
        return "dropped"
    return f"fixed at {number(step.value)}, fitted {number(step.found)}"


def poles_table(model: ModelResult) -> Table:
    """Poles [rad/s] with natural frequency and damping ratio; one row per complex pair."""
    poles = sorted(model.fit.structure.poles(model.fit.speed), key=lambda s: (abs(s), s.imag))
    rows = tuple(_pole(complex(s)) for s in poles if s.imag >= 0)
    return Table(f"Poles at {model.fit.speed:.2f} m/s", ("pole, rad/s", "frequency, rad/s", "damping"), rows)


def _pole(s: complex) -> tuple[Cell, ...]:
    text = number(s.real, 3) + (f" ± {number(s.imag, 3)} j" if s.imag else "")
    damping = number(-s.real / abs(s), 2) if s.imag else "–"
    return Cell(text, "warn" if s.real > 0 else ""), Cell(number(abs(s), 3)), Cell(damping)


def amplitude_table(result: Identification) -> Table | None:
    """Cornering stiffness of each run alone, small amplitudes first; None where all have one amplitude."""
    if not result.by_amplitude:
        return None
    names = list(result.by_amplitude[0].stiffness)
    rows = tuple(
        (
            Cell(one.run),
            Cell(number(one.speed, 3)),
            Cell(f"{number(one.amplitude, 3)} {unit(one.unit)}"),
            *(Cell(number(one.stiffness[name], 3)) for name in names),
        )
        for one in result.by_amplitude
    )
    headings = ("run", "m/s", "amplitude", *(f"{symbol(name)}, N/rad" for name in names))
    note = (
        "Each run alone, the other parameters as fitted to all runs. Tyres bend: the larger the slip angle, "
        "the smaller the stiffness."
    )
    return Table("Cornering stiffness at each amplitude", headings, rows, note, 1)


def coherence_table(result: Identification) -> Table:
    """Speed, amplitude, usable bands and verdict of each run."""
    outputs = [o for o in OUTPUTS if any(o == c.output for v in result.coherence for c in v.outputs)]
    speeds = {v.run: run.mean_speed for run, v in judged_runs(result) if v and "speed" in run}
    rows = []
    for verdict in result.coherence:
        found = {c.output: c for c in verdict.outputs}
        bands = [Cell(band(found[o].band) if o in found else "n/a") for o in outputs]
        keep = Cell("keep", "good") if verdict.keep else Cell("repeat", "warn")
        amplitude = f"{number(verdict.amplitude, 3)} {verdict.amplitude_unit}"
        speed = number(speeds.get(verdict.run), 3)
        rows.append((Cell(verdict.run), keep, Cell(speed), Cell(amplitude), *bands))
    headings = ("run", "verdict", "m/s", "amplitude", *(f"{SHORT_NAMES[o]}" for o in outputs))
    without = ", ".join(n for n in result.settings.condition_on if any(n in g.others for g in result.groups))
    kind = (
        f"partial coherence with the steering ({without} removed)"
        if without
        else "coherence with the steering"
    )
    note = f"Bands in rad/s in which the {kind} is at least 0.6."
    return Table("Runs", headings, tuple(rows), note, 2)
