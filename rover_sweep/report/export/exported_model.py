"""Identified models for python-control, MATLAB and JSON: continuous-time matrices, names and units."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rover_sweep.data.recording import LowPass
from rover_sweep.diagnosis.linear import FirstOrderLowPass, hidden_filters, left_out, linear
from rover_sweep.diagnosis.simulation.augmented import AugmentedModel
from rover_sweep.identification import models
from rover_sweep.identification.pipeline import Identification, known_filters
from rover_sweep.identification.state_space import Matrices, ModelStructure
from rover_sweep.identification.toml_form import MATRICES, structure_from_text
from rover_sweep.report.export.augmented_model_json import augmented_document
from rover_sweep.report.wording import plain, strict_json

# An exported model as MATLAB code, Python code or a .mat file, from its JSON form.


Model = Mapping[str, Any]
STATE_SPACE = ("A", "B", "C", "D")


def json_text(model: Model) -> str:
    """The model as JSON text."""
    return strict_json(dict(model))


def matlab_text(model: Model) -> str:
    """A script that creates `sys` (ss with input delay), `sensors` (tf per output) and all matrices.

    `sys` gives the rover's motion; `sensors * sys` the recorded signals. Needs the Control System Toolbox.
    """
    late = "'InputDelay', tau"
    if len(model["inputs"]) > 1 or any(model["output_delays_s"]):
        delays = _row(model["input_delays_s"]), _row(model["output_delays_s"])
        late = f"'InputDelay', {delays[0]}, 'OutputDelay', {delays[1]}"
    lines = [*_remarks(model, "%"), ""]
    lines += [
        f"{name} = [{'; '.join(_row(row)[1:-1] for row in model[name])}];"
        for name in (*STATE_SPACE, *MATRICES)
    ]
    lines += [
        f"tau = {model['tau_s']!r};  % s, delay of the input",
        f"V = {model['speed_m_s']!r};  % m/s",
        "",
        f"sys = ss(A, B, C, D, {late}, ...",
        f"    'StateName', {_cell(model['states'])}, 'StateUnit', {_cell(model['state_units'])}, ...",
        f"    'InputName', {_cell(model['inputs'])}, 'InputUnit', {_cell(model['input_units'])}, ...",
        f"    'OutputName', {_cell(model['outputs'])}, 'OutputUnit', {_cell(model['output_units'])});",
        "",
        f"sensors = tf(eye({len(model['outputs'])}));  % low-pass filters of the sensors, one per output",
    ]
    for k, output in enumerate(model["outputs"], 1):
        if f := model["sensor_filters"].get(output):
            hz = f["cutoff_hz"]
            lines.append(
                f"sensors({k}, {k}) = tf({_row(f['num'])}, {_row(f['den'])});  % {output}, {hz:g} Hz"
            )
    return "\n".join(lines) + "\n"


def python_text(model: Model) -> str:
    """A module with the matrices, `frequency_response(w)` (numpy), and `system()` (python-control)."""
    filters = {output: (f["num"], f["den"]) for output, f in model["sensor_filters"].items()}
    return "\n".join(
        [
            f'"""{model["model"]} model of a rover, exported by rover-sweep.\n',
            *(line.removeprefix("# ") for line in _remarks(model, "#")),
            '"""\n',
            "import numpy as np\n",
            *(f"{name} = np.array({model[name]!r})" for name in (*STATE_SPACE, *MATRICES)),
            f"tau = {model['tau_s']!r}  # s, delay of the steering",
            f"input_delays = {list(model['input_delays_s'])!r}  # s",
            f"output_delays = {list(model['output_delays_s'])!r}  # s",
            f"V = {model['speed_m_s']!r}  # m/s",
            f"states = {list(model['states'])!r}  # {', '.join(model['state_units'])}",
            f"inputs = {list(model['inputs'])!r}  # {', '.join(model['input_units'])}",
            f"outputs = {list(model['outputs'])!r}  # {', '.join(model['output_units'])}",
            "# output: (numerator, denominator) in falling powers of s",
            f"sensor_filters = {filters!r}",
            _PYTHON_FUNCTIONS,
        ]
    )


def mat_file(model: Model) -> bytes:
    """A .mat file (version 5): matrices as arrays, names as cells, sensor_filters as a struct."""
    from scipy.io import savemat

    cells = ("states", "state_units", "inputs", "input_units", "outputs", "output_units")
    content: dict[str, Any] = {name: np.array(model[name], dtype=float) for name in (*STATE_SPACE, *MATRICES)}
    content |= {name: np.array(model[name], dtype=object) for name in cells}
    content |= {
        "tau": model["tau_s"],
        "input_delays": np.array(model["input_delays_s"]),
        "output_delays": np.array(model["output_delays_s"]),
        "V": model["speed_m_s"],
        "model": model["model"],
        "note": model["note"],
    }
    content["parameters"] = dict(model["parameters"])
    content["sensor_filters"] = {
        output: {"num": np.array(f["num"]), "den": np.array(f["den"]), "cutoff_hz": f["cutoff_hz"]}
        for output, f in model["sensor_filters"].items()
    }
    out = io.BytesIO()
    savemat(out, content)
    return out.getvalue()


def _remarks(model: Model, mark: str) -> list[str]:
    steering = model.get("steering")
    judged = "verdict of the diagnosis" if model.get("augmented") else "verdict of the fit"
    known = ", ".join(
        f"{name} {value:.6g} {model['parameter_units'][name]}" for name, value in model["parameters"].items()
    )
    lines = [
        f"{model['model']} model at {model['speed_m_s']:.3g} m/s; {judged}: {model['verdict']}.",
        *model["note"].replace(". ", ".\n").splitlines(),
        f"Parameters: {known}.",
    ]
    if steering:
        lines.append(f"delta = -(PWM - {steering['trim_us']:g}) * {steering['rad_per_us']:g} rad, PWM in us.")
    return [f"{mark} {line}" for line in lines]


def _row(values: Sequence[float]) -> str:
    return "[" + " ".join(repr(float(x)) for x in values) + "]"


def _cell(names: Sequence[str]) -> str:
    return "{" + ", ".join(f"'{name}'" for name in names) + "}"


_PYTHON_FUNCTIONS = '''

def frequency_response(w, sensors=True, input=0):
    """Response (n_w, n_outputs) to an input at w [rad/s], with delays; sensors: include their low-passes."""
    s = 1j * np.atleast_1d(np.asarray(w, dtype=float))
    x = np.linalg.solve(s[:, None, None] * np.eye(len(A)) - A, np.broadcast_to(B, (s.size, *B.shape)))
    h = (C @ x + D)[:, :, input] * np.exp(-np.outer(s, input_delays[input] + np.array(output_delays)))
    for k, output in enumerate(outputs):
        if sensors and output in sensor_filters:
            numerator, denominator = sensor_filters[output]
            h[:, k] *= np.polyval(numerator, s) / np.polyval(denominator, s)
    return h


def system(pade_order=3):
    """A python-control system, with Pade approximations of the delays, without the sensors' low-passes."""
    import control

    rational = control.ss(A, B, C, D, inputs=inputs, outputs=outputs, states=states)
    if not any(input_delays) and not any(output_delays):
        return rational

    def late(delays):
        each = [control.pade(d, pade_order) if d else ([1.0], [1.0]) for d in delays]
        return control.append(*(control.tf2ss(*p) for p in each))

    return control.ss(late(output_delays) * rational * late(input_delays), inputs=inputs, outputs=outputs)
'''


# Continuous-time matrices of a linear system with names, units and delays, as plain data.


UNITS = {
    "delta": "rad",
    "throttle": "us",
    "beta": "rad",
    "r": "rad/s",
    "V_y": "m/s",
    "p": "rad/s",
    "phi": "rad",
    "ay": "m/s^2",
    "vydot": "m/s^2",
}
NOTE = (
    "M x' = F x + G delta(t - tau), y = H0 x + H1 x'; equivalent to x' = A x + B delta(t - tau), y = C x + D "
    "delta(t - tau). delta [rad] is the road-wheel angle, left positive; ISO axes (x forward, y left, z up). "
    "The outputs are the rover's motion at the IMU; the recorded signals also passed the sensor_filters."
)


def system_document(structure: ModelStructure, mat: Matrices, speed: float) -> dict[str, Any]:
    """Matrices, delays, names and units at a speed [m/s]."""
    return {
        "speed_m_s": speed,
        "tau_s": _delay(structure, structure.input_delays.get(structure.inputs[0])),
        "input_delays_s": [_delay(structure, structure.input_delays.get(i)) for i in structure.inputs],
        "output_delays_s": [_delay(structure, structure.output_delays.get(o)) for o in structure.outputs],
        "inputs": structure.inputs,
        "input_units": [_unit(structure, i) for i in structure.inputs],
        "states": structure.states,
        "state_units": [_unit(structure, s) for s in structure.states],
        "outputs": structure.outputs,
        "output_units": [_unit(structure, o) for o in structure.outputs],
        **matrices_of(mat),
    }


def _delay(structure: ModelStructure, name: str | None) -> float:
    return structure.values[name] if name else 0.0


def _unit(structure: ModelStructure, name: str) -> str:
    """The unit given in the user's structure, else the usual one, else ""."""
    return structure.units.get(name) or UNITS.get(name, "")


def matrices_of(mat: Matrices) -> dict[str, Any]:
    """A, B, C, D and the matrices M, F, G, H0, H1 that they are computed from."""
    return {
        **dict(zip(STATE_SPACE, mat.state_space(), strict=True)),
        "M": mat.m.astype(float),
        "F": mat.f.astype(float),
        "G": mat.input_matrix.astype(float),
        "H0": mat.h0.astype(float),
        "H1": mat.h1.astype(float),
    }


BUILDERS = {
    "kinematic": models.kinematic_matrices,
    "bicycle": models.bicycle_matrices,
    "roll-yaw": models.roll_yaw_matrices,
    "lumped": models.lumped_matrices,
}


def exported_model(
    result: Identification, name: str, steering: tuple[float, float] | None = None
) -> dict[str, Any]:
    """One model of a result as plain data. steering: (trim_us, rad_per_us) of the vehicle file.

    A, B, C, D and M, F, G, H0, H1 are nested lists (B, G and D have a column per input). tau_s: delay of
    the steering; input_delays_s, output_delays_s: delays of all inputs and outputs. structure: text of a
    user's own structure, needed by `at_speed`. sensor_filters: {output: {cutoff_hz, num, den}}, not included
    in the matrices.
    """
    model = result.models[name]
    structure = model.fit.structure
    filters = [known_filters(result)]
    document = _document(structure, model.fit.speed, model.verdict.level, filters, steering)
    return plain(document | {"model": name, "structure": structure.source or None})


def _document(
    structure: ModelStructure,
    speed: float,
    verdict: str,
    filters: Sequence[Mapping[str, LowPass]],
    steering: tuple[float, float] | None,
) -> dict[str, Any]:
    """What all exported models have. filters: of each output, in series."""
    return {
        "format": "rover-sweep model",
        "model": structure.name,
        "verdict": verdict,
        "note": NOTE,
        "reference": structure.reference,
        **system_document(structure, structure.matrices(speed), speed),
        "parameters": structure.values,
        "parameter_units": {p.name: p.unit for p in structure.parameters},
        "sensor_filters": _filters(filters, structure.outputs),
        "structure": None,
        "steering": {"trim_us": steering[0], "rad_per_us": steering[1]} if steering else None,
    }


def at_speed(exported: Mapping[str, Any], speed: float) -> dict[str, Any]:
    """An exported model of physical parameters at another speed [m/s].

    ValueError for the lumped model, whose derivatives are valid only at the speed of the identification.
    """
    if whole := exported.get("augmented"):
        from rover_sweep.report.export.augmented_model_json import augmented_from

        return exported_augmented(augmented_from(whole), exported["verdict"], speed)
    if exported["model"] == "lumped":
        raise ValueError("the lumped model is valid only at the speed of the identification")
    own = exported.get("structure")
    build = structure_from_text(own).build if own else BUILDERS[exported["model"]]
    mat = build({**exported["parameters"], "V": speed})
    return plain({**exported, **matrices_of(mat), "speed_m_s": speed})


# The linear part of a diagnosed model for python-control, MATLAB and JSON; the rest as sentences.


def exported_augmented(model: AugmentedModel, verdict: str, speed: float | None = None) -> dict[str, Any]:
    """The linear part at a speed [m/s] (default: true speed of the runs), in the form of `exported_model`.

    verdict: of the diagnosis. "left_out": sentences on the nonlinear parts; "augmented": the whole model,
    from which `at_speed` computes another speed. sensor_filters: known and hidden low-passes in series.
    """
    structure, at = linear(model), speed or model.speed * (1.0 + model.value("vscale"))
    lost = left_out(model)
    remark = f"Not included: {'; '.join(lost)}." if lost else "The whole model is included."
    filters = [model.filters, hidden_filters(model)]
    document = _document(structure, at, verdict, filters, model.steering)
    own = {"note": f"{NOTE} {remark}", "left_out": lost, "augmented": augmented_document(model)}
    return plain(document | {"model": model.name} | own)


def _filters(filters: Sequence[Mapping[str, LowPass]], outputs: tuple[str, ...]) -> dict[str, Any]:
    """Each output's low-passes in series as one fraction, coefficients in falling powers of s."""
    out: dict[str, Any] = {}
    for output in outputs:
        if found := [f[output] for f in filters if output in f]:
            num: Any = 1.0
            den: Any = 1.0
            for low_pass in found:
                w0 = 2 * np.pi * low_pass.cutoff_hz
                first = isinstance(low_pass, FirstOrderLowPass)
                num = np.polymul(num, [w0] if first else [w0**2])
                den = np.polymul(den, [1.0, w0] if first else [1.0, np.sqrt(2) * w0, w0**2])
            out[output] = {
                "cutoff_hz": min(f.cutoff_hz for f in found),
                "num": num,
                "den": den,
                "source": ", ".join(f.source for f in found if f.source),
            }
    return out
