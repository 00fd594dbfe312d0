"""The result as tables like Tables 2 to 6 of the paper, the same for the terminal and the page."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from rover_sweep.data.recording import OUTPUTS
from rover_sweep.data.results import ends_words, number
from rover_sweep.identification.fit import Estimate, FitResult
from rover_sweep.identification.model_results import ModelResult
from rover_sweep.identification.pipeline import (
    TITLES,
    Identification,
    inertia_of,
    judged_runs,
    ordered,
    rejection,
    usable,
)
from rover_sweep.identification.verdicts import (
    CR_GUIDE,
    I_GUIDE,
    J_ACCEPTABLE,
    J_GOOD,
    J_RMS_GUIDE,
    TIC_GUIDE,
)
from rover_sweep.identification.verify import Overlay
from rover_sweep.report.document import Cell, Cells, Table, Tone, table_of
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
CIFER = "CR and I are for comparison with CIFER; the interval says more."


def numbers_table(result: Identification) -> Table | None:
    """The rover's numbers with intervals, those of the recommended model's fit beside; None without any."""
    name = result.recommended or ""
    if not result.numbers or name not in result.models:
        return None
    fitted = {e.name: e.value for e in result.models[name].fit.estimates if e.free}
    if "C" in fitted:
        fitted |= {"Cf": fitted["C"], "Cr": fitted["C"]}
    rows = (
        (
            Cell(symbol(e.name), "strong"),
            e.meaning,
            Cell(number(e.value, 3), "strong"),
            unit(e.unit),
            ends_words(e.low, e.high),
            Cell(number(fitted.get(e.name), 3), "muted"),
        )
        for e in result.numbers
    )
    headings = ("", "description", "value", "unit", "90 % interval", "CIFER fit")
    return table_of("Numbers of the rover", headings, rows, NUMBERS, 2)


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
    speed = Estimate("V", "m/s", model.fit.speed, meaning="forward speed", free=False)
    fixed = [] if brief else [speed, *(e for e in model.fit.estimates if not e.free)]
    rows = [_free_row(e, reason) for e in free]
    rows += [
        tuple(
            Cell(text, "muted")
            for text in (symbol(e.name), e.meaning, number(e.value), unit(e.unit), "fixed", "–", "–")
        )
        for e in fixed
    ]
    known = not reason and any(e.interval_90 for e in free)
    headings = ("", "description", "value", "unit", "90 % interval" if known else "", "CR %", "I %")
    note = f"The numbers were rejected: {reason}." if reason else ""
    if known and not brief:
        note = f"{INTERVALS} {CIFER}"
    kept = 5 if known and brief else 7
    return table_of(f"{TITLES.get(name, name)} model", headings[:kept], (row[:kept] for row in rows), note, 2)


def _free_row(e: Estimate, reason: str | None) -> Cells:
    if reason:
        value = (Cell("not identifiable", "bad"), unit(e.unit), "free", "–", "–")
        return (symbol(e.name), e.meaning, *value)
    return (
        Cell(symbol(e.name), "strong"),
        e.meaning,
        Cell(number(e.value) + (" (at its bound)" if e.at_bound else ""), "strong"),
        unit(e.unit),
        ends_words(e.low, e.high, 4) if e.interval_90 else "free",
        Cell(percent(e.cr_percent), _guideline_tone(e.cr_percent, CR_GUIDE)),
        Cell(percent(e.insensitivity_percent), _guideline_tone(e.insensitivity_percent, I_GUIDE)),
    )


def _guideline_tone(value: float | None, guide: float) -> Tone:
    return "warn" if value is not None and not value <= guide else ""


def cost_table(result: Identification) -> Table:
    """J of each response and model, as Table 5, with the averages over the fitted and over all responses."""
    models = ordered(result)

    def cost(model: ModelResult, output: str) -> Cell:
        if output not in model.costs:
            return Cell("n/a", "muted")
        j = model.costs[output]
        text = f"{j:.1f}" if output in model.fit.costs else f"({j:.1f})"
        return Cell(text, "warn" if j > SINGLE_J else "")

    def average(j: float) -> Cell:
        return Cell(f"{j:.1f}", "good" if j <= J_GOOD else "strong" if j <= J_ACCEPTABLE else "warn")

    to_other_inputs = dict.fromkeys(label for m in models.values() for label in m.costs if "/" in label)
    rows: list[Cells] = []
    for label in (*OUTPUTS, *to_other_inputs):
        if any(label in m.costs for m in models.values()):
            output, _, input = label.partition("/")
            name = f"{OUTPUT_NAMES[output]} / {input or 'δ'}"
            rows.append((name, *(cost(m, label) for m in models.values())))
    rows.append((Cell("J_ave, fitted", "strong"), *(average(m.fit.average) for m in models.values())))
    rows.append(("J_ave, all responses", *(average(m.average_all) for m in models.values())))
    note = (
        "J of equation (11): ≤ 50 nearly indistinguishable from the data, ≤ 100 acceptable. "
        "In brackets: not in the fit."
    )
    headings = ("response", *(TITLES.get(n, n) for n in models))
    return table_of("Cost J of the frequency responses", headings, rows, note)


def verification_tables(result: Identification, units: ShownUnits = SI) -> tuple[Table, ...]:
    """J_rms and TIC of each model on each run of the verification, as Table 6."""
    models = ordered(result)
    count = max((len(m.verification) for m in models.values()), default=0)
    return tuple(_verification_table(models, k, units) for k in range(count))


def _verification_table(models: Mapping[str, ModelResult], k: int, units: ShownUnits) -> Table:
    verdicts = {n: m.verification[k] for n, m in models.items() if k < len(m.verification)}
    first = next(iter(verdicts.values()))

    def guided(value: float, guide: float) -> Cell:
        return Cell(number(value, 3), _guideline_tone(value, guide))

    def of(words: Callable[[Overlay], str], found: list[Overlay | None]) -> list[Cell | str]:
        return [words(o) if o else Cell("n/a", "muted") for o in found]

    def j_rms(o: Overlay) -> str:
        """Of a channel; the overlay is in the units of the paper."""
        return number(o.j_rms * (FOOT * units.per_si if o.unit.startswith("ft") else 1.0), 3)

    rows: list[Cells] = [
        (Cell("J_rms", "strong"), *(guided(v.j_rms, J_RMS_GUIDE) for v in verdicts.values())),
        (Cell("TIC", "strong"), *(guided(v.tic, TIC_GUIDE) for v in verdicts.values())),
    ]
    for channel in ("r", "ay", "p"):
        found = [next((o for o in v.overlays if o.channel == channel), None) for v in verdicts.values()]
        if any(found):
            shown = units.acceleration if channel == "ay" else "deg/s"
            rows.append((f"J_rms of {SHORT_NAMES[channel]}, {shown}", *of(j_rms, found)))
            rows.append((f"TIC of {SHORT_NAMES[channel]}", *of(lambda o: number(o.tic, 2), found)))
    note = (
        "Equations (15) and (16) over those of r, a_y and p that the model has; together in deg/s and "
        "ft/s², as in the paper. Guidelines: J_rms ≤ 1 to 2, TIC ≤ 0.25 to 0.35."
    )
    headings = ("", *(TITLES.get(n, n) for n in verdicts))
    return table_of(f"Verification on {first.run} at {first.speed:.2f} m/s", headings, rows, note)


def inertia_table(result: Identification, provenance: Provenance) -> Table | None:
    """The yaw inertia of the vehicle file compared with each model's, None without either."""
    stated = provenance.vehicle.yaw_inertia if provenance.vehicle else None
    value = stated.value if stated else result.geometry.yaw_inertia
    found = {n: e for n, m in usable(result).items() if (e := inertia_of(m))}
    if value is None or not found:
        return None
    sd = f"± {number(stated.sd, 2)}" if stated and stated.sd is not None else "no uncertainty stated"
    rows: list[Cells] = [("vehicle file", number(value), sd, "–")]
    for name, e in found.items():
        difference = Cell(change(100 * (e.value / value - 1)), "strong")
        rows.append(
            (f"{TITLES.get(name, name)} model", number(e.value), ends_words(e.low, e.high), difference)
        )
    note = (
        "±: standard deviation of the vehicle file. In the paper the models are within 25 % (bicycle) and "
        "12 % (roll-yaw) of the swing test."
    )
    headings = ("", "I_zz", "± or 90 % interval", "difference %")
    return table_of("Yaw inertia I_zz, kg m²", headings, rows, note)


def filters_table(result: Identification) -> Table:
    """Every model fitted without the sensors' low-pass filters, for comparison."""
    rows: list[Cells] = []
    for name, model in usable(result).items():
        if other := model.variants.get(IGNORED):
            title = Cell(TITLES.get(name, name), "strong")
            for k, e in enumerate(e for e in model.fit.estimates if e.free):
                moved = 100 * (other[e.name].value / e.value - 1) if e.value else None
                tone: Tone = "warn" if moved is not None and abs(moved) > 10 else ""
                label = f"{symbol(e.name)}, {unit(e.unit)}"
                values = number(e.value), number(other[e.name].value), Cell(change(moved), tone)
                rows.append(("" if k else title, label, *values))
            averages = Cell(f"{model.fit.average:.1f}", "strong"), Cell(f"{other.average:.1f}", "strong")
            rows.append(("", Cell("J_ave", "strong"), *averages, ""))
    headings = ("model", "", "with the filters", "ignored", "change %")
    return table_of("If the sensors' filters are ignored", headings, rows, "", 2)


def variants_table(result: Identification, name: str) -> Table | None:
    """Parameters and costs of a model in its other fits, None where all are the fit itself."""
    model = result.models[name]
    others = {n: f for n, f in model.variants.items() if f.structure.values != model.fit.structure.values}
    fits = {"the fit": model.fit, **others}
    if len(fits) < 2 or rejection(result, name):
        return None
    every = {(e.name, e.unit): None for f in fits.values() for e in f.estimates if e.free}

    def value(fit: FitResult, name: str) -> Cell:
        found = next((e for e in fit.estimates if e.name == name), None)
        return Cell(number(found.value if found else None), "" if found and found.free else "muted")

    def cost(fit: FitResult, output: str) -> Cell | str:
        return f"{fit.costs[output]:.1f}" if output in fit.costs else Cell("–", "muted")

    rows: list[Cells] = [(f"{symbol(n)}, {unit(u)}", *(value(f, n) for f in fits.values())) for n, u in every]
    outputs = [o for o in OUTPUTS if any(o in f.costs for f in fits.values())]
    rows += [(f"J of {SHORT_NAMES[o]}", *(cost(f, o) for f in fits.values())) for o in outputs]
    rows.append((Cell("J_ave", "strong"), *(Cell(f"{f.average:.1f}", "strong") for f in fits.values())))
    return table_of(f"Other fits of the {name} model", ("", *fits), rows)


def reduction_table(model: ModelResult) -> Table:
    """The steps of the model structure reduction."""
    rows = []
    for s in model.reduction:
        if not s.dropped:
            outcome = "kept: unstable without it" if s.unstable else "kept"
        elif model.fit.structure.name == "lumped":
            outcome = "dropped"
        else:
            outcome = f"fixed at {number(s.value)}, fitted {number(s.found)}"
        rows.append((symbol(s.parameter), s.reason, outcome, f"{s.before:.2f}", f"{s.after:.2f}"))
    headings = ("parameter", "reason to test", "", "J_ave before", "J_ave without")
    note = (
        "A parameter is dropped, or fixed at the vehicle file's value, if J_ave hardly rises without it "
        "(5 % and 1)."
    )
    return table_of("Model structure reduction", headings, rows, note, 3)


def poles_table(model: ModelResult) -> Table:
    """Poles [rad/s] with natural frequency and damping ratio; one row per complex pair."""
    poles = sorted(model.fit.structure.poles(model.fit.speed), key=lambda s: (abs(s), s.imag))
    rows = []
    for s in (complex(s) for s in poles if s.imag >= 0):
        text = number(s.real, 3) + (f" ± {number(s.imag, 3)} j" if s.imag else "")
        damping = number(-s.real / abs(s), 2) if s.imag else "–"
        rows.append((Cell(text, "warn" if s.real > 0 else ""), number(abs(s), 3), damping))
    headings = ("pole, rad/s", "frequency, rad/s", "damping")
    return table_of(f"Poles at {model.fit.speed:.2f} m/s", headings, rows)


def both_ways_table(result: Identification) -> Table | None:
    """Tyres and steering forward and in reverse; None where one way was driven."""
    if not result.both_ways:
        return None
    rows: list[tuple[Cell | str, ...]] = []
    for pair in result.both_ways:
        cells: list[Cell | str] = []
        for q in (pair.forward, pair.reverse):
            factor, shown = (np.degrees(1.0), "°") if q.unit == "rad" else (1.0, unit(q.unit))
            low, high = (None if end is None else factor * end for end in (q.low, q.high))
            cells += [Cell(number(factor * q.value, 3), "strong"), ends_words(low, high)]
        word = {True: "yes", False: "no", None: "–"}[pair.differs]
        differs = Cell(word, "warn" if pair.differs and not pair.expected else "")
        name = pair.forward.name
        shown_name = name.replace("_", " ") if pair.expected else symbol(name)
        rows.append((shown_name, pair.forward.meaning, *cells, shown, differs))
    headings = ("", "description", "forward", "90 % interval", "reverse", "90 % interval", "unit", "differs")
    note = (
        "Each way alone, with Cf and Cr free; gain: with the tyres of all runs. The yaw mode differs on a "
        "sound rover too, as the other axle leads."
    )
    return table_of("Forward and reverse", headings, rows, note, 2)


def amplitude_table(result: Identification) -> Table | None:
    """Cornering stiffness of each run alone, small amplitudes first; None where all have one amplitude."""
    if not result.by_amplitude:
        return None
    names = list(result.by_amplitude[0].stiffness)
    rows = (
        (
            one.run,
            number(one.speed, 3),
            f"{number(one.amplitude, 3)} {unit(one.unit)}",
            *(number(one.stiffness[name], 3) for name in names),
        )
        for one in result.by_amplitude
    )
    headings = ("run", "m/s", "amplitude", *(f"{symbol(name)}, N/rad" for name in names))
    note = (
        "Each run alone, the other parameters as fitted to all runs. Where tyres bend, the stiffness is "
        "smaller at a larger amplitude; one that rises comes from noise, or from play or friction."
    )
    return table_of("Cornering stiffness at each amplitude", headings, rows, note)


def coherence_table(result: Identification) -> Table:
    """Speed, amplitude, usable bands and verdict of each run."""
    outputs = [o for o in OUTPUTS if any(o == c.output for v in result.coherence for c in v.outputs)]
    speeds = {v.run: run.mean_speed for run, v in judged_runs(result) if v and "speed" in run}
    rows: list[Cells] = []
    for verdict in result.coherence:
        found = {c.output: c for c in verdict.outputs}
        bands = (band(found[o].band) if o in found else "n/a" for o in outputs)
        keep = Cell("keep", "good") if verdict.keep else Cell("repeat", "warn")
        amplitude = f"{number(verdict.amplitude, 3)} {verdict.amplitude_unit}"
        rows.append((verdict.run, keep, number(speeds.get(verdict.run), 3), amplitude, *bands))
    headings = ("run", "verdict", "m/s", "amplitude", *(SHORT_NAMES[o] for o in outputs))
    without = ", ".join(n for n in result.settings.condition_on if any(n in g.others for g in result.groups))
    kind = (
        f"partial coherence with the steering ({without} removed)"
        if without
        else "coherence with the steering"
    )
    return table_of("Runs", headings, rows, f"Bands in rad/s in which the {kind} is at least 0.6.", 2)
