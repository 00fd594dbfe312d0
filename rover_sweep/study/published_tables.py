"""Tables 2 to 7 of the paper, with the numbers of the study next to the published ones."""

from __future__ import annotations

from collections.abc import Iterator

from rover_sweep.identification.acceptance import TITLES
from rover_sweep.identification.structure.state_space import OUTPUTS
from rover_sweep.report.identification.comparison import Cell, Table
from rover_sweep.report.wording.number_format import OUTPUT_NAMES, number, percent, symbol, unit
from rover_sweep.study import published
from rover_sweep.study.conditions import CHECKS
from rover_sweep.study.published import MODELS
from rover_sweep.study.virtual_study import Practice, Study

NUMBERS = {"bicycle": "Table 2", "roll-yaw": "Table 3", "lumped": "Table 4"}


def tables(study: Study) -> tuple[Table, ...]:
    """Tables 2 to 7 in order."""
    return (*(parameter_comparison(study, m) for m in MODELS), cost_comparison(study), *verifications(study))


def practices_table(study: Study) -> Table:
    """The three ways of fitting."""
    rows = tuple((Cell(p.title, "strong"), Cell(p.words)) for p in study.practices.values())
    return Table("Three ways to fit the same runs", ("", ""), rows, "", 2)


def parameter_comparison(study: Study, model: str) -> Table:
    """Tables 2, 3 and 4: the free parameters, published and identified."""
    printed = published.PARAMETERS[model]
    units = {e.name: e.unit for e in study.paper.fit(model).estimates}
    rows = tuple(
        (
            Cell(symbol(name), "strong"),
            Cell(unit(units[name])),
            *_printed(p),
            *_found(study.paper, model, name, bounds=True),
            *(c for p in _others(study) for c in _found(p, model, name, bounds=False)),
            Cell(number(_true(study, model, name), 3), "muted"),
        )
        for name, p in printed.items()
    )
    others = [p.title for p in _others(study)]
    headings = (
        "",
        "unit",
        "published",
        "CR %",
        "I %",
        study.paper.title,
        "CR %",
        "I %",
        *others,
        "this rover",
    )
    title = f"{NUMBERS[model]}: {TITLES[model].lower()} model"
    return Table(title, headings, rows, _parameter_note(study, model), 2)


def _others(study: Study) -> list[Practice]:
    return [p for key, p in study.practices.items() if key != "paper"]


def _printed(p: published.Printed) -> tuple[Cell, ...]:
    if not p.free:
        return Cell("0, fixed", "muted"), Cell("–", "muted"), Cell("–", "muted")
    return Cell(f"{p.value:g}"), Cell(percent(p.cr)), Cell(percent(p.insensitivity))


def _found(practice: Practice, model: str, name: str, bounds: bool) -> tuple[Cell, ...]:
    e = practice.fit(model)[name]
    if not e.free:
        value = Cell("0, fixed", "muted")
        return (value, Cell("–", "muted"), Cell("–", "muted")) if bounds else (value,)
    value = Cell(number(e.value), "strong" if bounds else "")
    return (
        (value, Cell(percent(e.cr_percent)), Cell(percent(e.insensitivity_percent))) if bounds else (value,)
    )


def _true(study: Study, model: str, name: str) -> float:
    """The value of the linearised virtual rover; C is the mean of its axles."""
    if model == "lumped":
        return study.truth_lumped.values[name]
    values = study.truth.values
    return (values["Cf"] + values["Cr"]) / 2 if name == "C" else values[name]


def _parameter_note(study: Study, model: str) -> str:
    g = study.geometry
    fixed = f"Fixed, as in the paper: m {g.mass:g} kg, a {g.a:g} m, b {g.b:g} m"
    if model != "bicycle":
        fixed += f", m_s {g.sprung_mass:g} kg, h {g.h:g} m, I_xx {g.roll_inertia:g} kg m², I_xz 0"
    speed = f"; V_x {study.paper.group.speed:.2f} m/s, measured ({published.SPEED:g} in the paper)."
    doubt = {"roll-yaw": published.DOUBTS["tau"], "lumped": "N_φ " + published.DOUBTS["N_phi"]}.get(model)
    return fixed + speed + (f" In the paper, {doubt}." if doubt else "")


def cost_comparison(study: Study) -> Table:
    """Table 5: J of each response and the average."""
    rows: list[tuple[Cell, ...]] = []
    for output in OUTPUTS:
        cells = [Cell(number(published.COSTS[m].get(output), 3)) for m in MODELS]
        rows.append((Cell(f"{OUTPUT_NAMES[output]} / δ", "strong"), Cell("published"), *cells))
        rows += [
            (Cell(""), Cell(p.title), *(_cost(p, m, output) for m in MODELS))
            for p in study.practices.values()
        ]
    averages = [Cell(number(published.COSTS[m]["average"], 3), "strong") for m in MODELS]
    rows.append((Cell("J_ave", "strong"), Cell("published"), *averages))
    for p in study.practices.values():
        rows.append((Cell(""), Cell(p.title), *(Cell(number(p.fit(m).average, 3), "strong") for m in MODELS)))
    note = (
        "J of equation (11). In brackets: not used in the fit. Guideline: J_ave ≤ 100, and ≤ 50 is excellent."
    )
    headings = ("response", "", *(TITLES[m] for m in MODELS))
    return Table("Table 5: cost of the frequency responses", headings, tuple(rows), note, 2)


def _cost(practice: Practice, model: str, output: str) -> Cell:
    found = practice.result.models[model]
    if output not in found.costs:
        return Cell("n/a", "muted")
    text = number(found.costs[output], 3)
    return Cell(text) if output in found.fit.costs else Cell(f"({text})", "muted")


def verifications(study: Study) -> Iterator[Table]:
    """Table 6, and the two halves of Table 7."""
    titles = {
        "asphalt": "Table 6: doublet on asphalt at the fitted speed",
        "grass": "Table 7: doublet on artificial grass",
        "fast": "Table 7: doublet at high velocity",
    }
    for check in CHECKS:
        yield _verification(study, check, titles[check])


def _verification(study: Study, check: str, title: str) -> Table:
    printed = published.VERIFICATION[check]
    practices = study.practices.values()
    rows: list[tuple[Cell, ...]] = [
        (Cell("TIC", "strong"), Cell("published"), *(Cell(f"{printed[m].tic:.2f}") for m in MODELS)),
        *((Cell(""), Cell(p.title), *(_tic(p.check(m, check).tic) for m in MODELS)) for p in practices),
        (Cell("J_rms", "strong"), Cell("published"), *(Cell(number(printed[m].j_rms, 3)) for m in MODELS)),
        *(
            (Cell(""), Cell(p.title), *(Cell(number(p.check(m, check).j_rms, 3)) for m in MODELS))
            for p in practices
        ),
    ]
    run = study.runs.checks[check]
    amplitude = float(run.manoeuvre("pwm").x.max() - run.manoeuvre("pwm").x.min()) / 2
    note = (
        f"Driven at {run.mean_speed:.2f} m/s with ±{amplitude:.0f} µs. J_rms here in deg/s, ft/s², deg/s "
        "over the channels of a model; the paper states no units, so only TIC and order are comparable."
    )
    headings = ("", "", *(TITLES[m] for m in MODELS))
    return Table(title, headings, tuple(rows), note, 2)


def _tic(value: float) -> Cell:
    return Cell(number(value, 2), "warn" if value > 0.25 else "")
