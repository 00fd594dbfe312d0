"""The study: drive, identify in three ways, verify, and counterfactuals that explain the results."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from rover_sweep.data.geometry import Geometry
from rover_sweep.data.recording import OUTPUTS, Recording
from rover_sweep.data.results import Progress, number
from rover_sweep.data.vehicle_file import MODELS
from rover_sweep.identification.fit import Condition, FitResult, ResponseData, fit
from rover_sweep.identification.grouping import Group, Settings
from rover_sweep.identification.models import lumped, roll_yaw
from rover_sweep.identification.pipeline import TITLES, Identification, identify
from rover_sweep.identification.state_space import ModelStructure
from rover_sweep.identification.verify import Verification, verify
from rover_sweep.manoeuvre.sweep import Doublet, Manoeuvre, Sweep
from rover_sweep.report.document import Cell, Table
from rover_sweep.report.wording import OUTPUT_NAMES, percent, symbol, unit
from rover_sweep.spectra.response import Band, usable_band
from rover_sweep.study import published
from rover_sweep.study.published import BANDS, SPEED, SWEEP, Firmware, virtual_drive
from sitl.plant.variant import PlantParameters, load_variant

# The test plan of the study: manoeuvres, grounds, speeds and seeds.


SWEEPS = 3
FAST = 4.0  # m/s
# Figure 7 has its steps at 2.4 and 4.8 s. The amplitudes of the doublets are not published; at 4 m/s the
# sweep's 150 us would take the tyres past half of their grip.
DOUBLET = Doublet(amplitude=150.0, pulse=2.4, pause=2.4, count=2, straight=2.4)
FAST_DOUBLET = Doublet(amplitude=100.0, pulse=2.4, pause=2.4, count=2, straight=2.4)
CHECKS: Mapping[str, str] = {
    "asphalt": f"doublet on asphalt, {SPEED:g} m/s",
    "grass": f"doublet on artificial grass, {SPEED:g} m/s",
    "fast": f"doublet on asphalt, {FAST:g} m/s",
}


@dataclass(frozen=True, eq=False)
class StudyRuns:
    """All runs. checks: the doublets by the keys of CHECKS, which no fit uses."""

    asphalt: PlantParameters
    grass: PlantParameters
    firmware: Firmware
    sweeps: tuple[Recording, ...]
    checks: Mapping[str, Recording]


def drive_all(seed: int, progress: Progress) -> StudyRuns:
    """Drives the whole plan on the published rover. The seed gives every run its own noise and road."""
    asphalt, grass, firmware = load_variant("paper_asphalt"), load_variant("paper_grass"), Firmware()
    sweep = Sweep(SWEEP["amplitude"], SWEEP["w_min"], SWEEP["w_max"], SWEEP["t_rec"])
    plan: list[tuple[str, PlantParameters, Manoeuvre, float]] = [
        *((f"sweep {k + 1} on asphalt", asphalt, sweep, SPEED) for k in range(SWEEPS)),
        (CHECKS["asphalt"], asphalt, DOUBLET, SPEED),
        (CHECKS["grass"], grass, DOUBLET, SPEED),
        (CHECKS["fast"], asphalt, FAST_DOUBLET, FAST),
    ]
    recordings = []
    for k, (name, rover, manoeuvre, speed) in enumerate(plan):
        progress(f"driving {name}", k / len(plan))
        recordings.append(virtual_drive(name, rover, manoeuvre, speed, 1000 * seed + k, firmware))
    checks = dict(zip(CHECKS, recordings[SWEEPS:], strict=True))
    return StudyRuns(asphalt, grass, firmware, tuple(recordings[:SWEEPS]), checks)


def geometry(rover: PlantParameters) -> Geometry:
    """The numbers that the authors knew: fixed rows of Tables 2 and 3, and a swing test without error."""
    forward, _, down = rover.imu_position
    return Geometry(
        mass=rover.mass,
        a=rover.cg_to_front_axle,
        b=rover.cg_to_rear_axle,
        sprung_mass=rover.sprung_mass,
        h=rover.cg_height_above_roll_centre,
        roll_inertia=rover.roll_inertia,
        yaw_inertia=rover.yaw_inertia,
        imu_x=forward,
        imu_z=rover.cg_height_above_roll_centre - down,
    )


@dataclass(frozen=True, eq=False)
class Practice:
    """One way of fitting the same runs. title: for tables. words: its description."""

    key: str
    title: str
    words: str
    result: Identification

    @property
    def group(self) -> Group:
        """The sweeps and their responses."""
        return self.result.groups[0]

    def fit(self, model: str) -> FitResult:
        """The fit of a model."""
        return self.result.models[model].fit

    def check(self, model: str, check: str) -> Verification:
        """The verification of a model on one of CHECKS."""
        return self.result.models[model].verification[list(CHECKS).index(check)]


@dataclass(frozen=True, eq=False)
class Counterfactuals:
    """Fits and verifications with one thing changed, to explain a result.

    frozen: the roll-yaw model written as a lumped one at the identified speed, verified at 4 m/s with V
    only in its kinematic term; untied: the roll-yaw model with Cf and Cr free, on each of CHECKS;
    gyro_ignored: the roll-yaw fit with the accelerometer's low-pass known and the gyro's ignored;
    prompt: the roll-yaw fit with the estimator's velocity lag taken out of V_y'/delta; as_table_4: the
    lumped model with only Table 4's parameters free, filters ignored.
    """

    frozen: Verification
    untied: Mapping[str, Verification]
    gyro_ignored: FitResult
    prompt: FitResult
    as_table_4: FitResult


@dataclass(frozen=True, eq=False)
class Study:
    """All results. truth: the roll-yaw model with the numbers of the virtual rover (tyres at zero slip)."""

    seed: int
    runs: StudyRuns
    geometry: Geometry
    practices: Mapping[str, Practice]
    truth: ModelStructure
    truth_lumped: ModelStructure
    coherent: Mapping[str, Band | None]
    counterfactuals: Counterfactuals

    @property
    def paper(self) -> Practice:
        """The fits made as in the paper."""
        return self.practices["paper"]

    @property
    def known(self) -> Practice:
        """The same fits with the sensors' filters in the models' outputs."""
        return self.practices["known"]


def study(seed: int = 1, progress: Progress | None = None) -> Study:
    """Drives and identifies; the same seed gives the same numbers. progress: step, and share done 0..1."""
    report: Progress = progress or (lambda step, share: None)
    runs = drive_all(seed, lambda step, share: report(step, 0.35 * share))
    known_geometry = geometry(runs.asphalt)
    practices: dict[str, Practice] = {}
    for k, (key, title, words, filtered, fitted) in enumerate(_PRACTICES):
        report(f"identifying: {title}", 0.35 + 0.2 * k)
        practices[key] = Practice(key, title, words, _identified(runs, known_geometry, filtered, fitted))
    report("explaining", 0.95)
    known = practices["known"]
    truth = roll_yaw(known_geometry, tied=False).with_values(true_parameters(runs.asphalt))
    coherent = {o: usable_band(f.w, f.coherence) for o, f in known.group.responses.items()}
    return Study(
        seed,
        runs,
        known_geometry,
        practices,
        truth,
        lumped(known_geometry, truth, known.group.speed),
        coherent,
        _counterfactuals(runs, known_geometry, practices),
    )


_KNOWN = "the sensors' known filters in the models' outputs"
_PRACTICES = (
    ("paper", "as in the paper", "four responses, the sensors' filters ignored", False, OUTPUTS),
    ("known", "filters known", f"four responses, {_KNOWN}", True, OUTPUTS),
    ("default", "without vydot", f"r, a_y and p, {_KNOWN}: this tool's default", True, ("r", "ay", "p")),
)


def _identified(runs: StudyRuns, known: Geometry, filtered: bool, fitted: Sequence[str]) -> Identification:
    lowest, highest = SWEEP["w_min"], SWEEP["w_max"]
    bands = {o: (max(low, lowest), high) for o, (low, high) in BANDS.items()}
    settings = Settings(fitted=tuple(fitted), band=(lowest, highest), bands=bands, as_paper=True)
    sweeps, checks = runs.sweeps, tuple(runs.checks.values())
    if not filtered:
        sweeps, checks = (tuple(replace(run, filters={}) for run in part) for part in (sweeps, checks))
    return identify(sweeps, known, checks, settings)


def true_parameters(rover: PlantParameters) -> dict[str, float]:
    """{parameter of a roll-yaw model: SI value} of a simulated rover, its tyres at zero slip.

    tau: the steering's low-frequency lag, the servo's delay and lag. (The PWM's steps are in the input.)
    """
    return {
        "Cf": rover.front_cornering_stiffness,
        "Cr": rover.rear_cornering_stiffness,
        "Izz": rover.yaw_inertia,
        "k_phi": rover.roll_stiffness,
        "b_phi": rover.roll_damping,
        "tau": rover.servo_delay + rover.servo_lag,
    }


def _counterfactuals(runs: StudyRuns, known: Geometry, practices: Mapping[str, Practice]) -> Counterfactuals:
    best = practices["known"].result.models["roll-yaw"]
    group = practices["known"].group
    frozen = lumped(known, best.fit.structure, group.speed)
    untied = best.variants["Cf and Cr free"].structure
    accelerometer = {c: f for c, f in runs.firmware.filters.items() if c == "ay"}
    condition = replace(group.condition(OUTPUTS), filters=accelerometer)
    return Counterfactuals(
        frozen=verify(frozen, runs.checks["fast"]),
        untied={name: verify(untied, run) for name, run in runs.checks.items()},
        gyro_ignored=fit(best.fit.structure, [condition]),
        prompt=fit(best.fit.structure, [_prompt(group, runs.asphalt.velocity_lag)]),
        as_table_4=_as_table_4(known, practices["paper"]),
    )


def _prompt(group: Group, lag: float) -> Condition:
    """The responses with the estimator's lag [s] removed from V_y'.

    The lag acts on the velocity in earth axes. In body axes it delays V_y and, in a turn, takes lag V r from
    it as well. So V_y' = measured (1 + jw lag) + jw lag V r.
    """
    condition = group.condition(OUTPUTS)
    r = group.responses["r"]

    def mended(d: ResponseData) -> ResponseData:
        turning = r.at(d.w)[0] / condition.filters["r"].response(d.w)
        return replace(d, h=d.h + 1j * d.w * lag * (d.h + group.speed * turning))

    data = tuple(mended(d) if d.output == "vydot" else d for d in condition.data)
    return replace(condition, data=data)


def _as_table_4(known: Geometry, paper: Practice) -> FitResult:
    """The lumped model with the derivatives at zero that Table 4 lists as zero."""
    start = lumped(known, paper.fit("roll-yaw").structure, paper.group.speed)
    for name in ("Y_v", "Y_r", "Y_phi", "L_v", "L_phi"):
        start = start.fixed(name, 0.0)
    return fit(start, [paper.group.condition(OUTPUTS)], stable=True)


# Tables 2 to 7 of the paper, with the numbers of the study next to the published ones.


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
    true = study.truth.values
    true = {**true, "C": (true["Cf"] + true["Cr"]) / 2} if model != "lumped" else study.truth_lumped.values
    others = [p for key, p in study.practices.items() if key != "paper"]
    rows = tuple(
        (
            Cell(symbol(name), "strong"),
            Cell(unit(units[name])),
            *_printed(p),
            *_found(study.paper, model, name, bounds=True),
            *(c for p in others for c in _found(p, model, name, bounds=False)),
            Cell(number(true[name], 3), "muted"),
        )
        for name, p in printed.items()
    )
    headings = (
        "",
        "unit",
        "published",
        "CR %",
        "I %",
        study.paper.title,
        "CR %",
        "I %",
        *(p.title for p in others),
        "this rover",
    )
    title = f"{NUMBERS[model]}: {TITLES[model].lower()} model"
    return Table(title, headings, rows, _parameter_note(study, model), 2)


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
    for check, title in titles.items():
        yield _verification(study, check, title)


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
