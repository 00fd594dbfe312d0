"""An exported model as MATLAB code, Python code or a .mat file, from its JSON form."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rover_sweep.report.wording.strict_json import strict_json

Model = Mapping[str, Any]
STATE_SPACE = ("A", "B", "C", "D")
DESCRIPTOR = ("M", "F", "G", "H0", "H1")


def json_text(model: Model) -> str:
    """The model as JSON text."""
    return strict_json(dict(model))


def matlab_text(model: Model) -> str:
    """A script that creates `sys` (ss with input delay), `sensors` (tf per output) and all matrices.

    `sys` gives the rover's motion; `sensors * sys` the recorded signals. Needs the Control System Toolbox.
    """
    lines = [*_remarks(model, "%"), ""]
    lines += [f"{name} = {_matlab(model[name])};" for name in (*STATE_SPACE, *DESCRIPTOR)]
    lines += [
        f"tau = {model['tau_s']!r};  % s, delay of the input",
        f"V = {model['speed_m_s']!r};  % m/s",
        "",
        f"sys = ss(A, B, C, D, {_matlab_delays(model)}, ...",
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
    return "\n".join(
        [
            f'"""{model["model"]} model of a rover, exported by rover-sweep.\n',
            *(line.removeprefix("# ") for line in _remarks(model, "#")),
            '"""\n',
            "import numpy as np\n",
            *(f"{name} = np.array({model[name]!r})" for name in (*STATE_SPACE, *DESCRIPTOR)),
            f"tau = {model['tau_s']!r}  # s, delay of the steering",
            f"input_delays = {list(model['input_delays_s'])!r}  # s",
            f"output_delays = {list(model['output_delays_s'])!r}  # s",
            f"V = {model['speed_m_s']!r}  # m/s",
            f"states = {list(model['states'])!r}  # {', '.join(model['state_units'])}",
            f"inputs = {list(model['inputs'])!r}  # {', '.join(model['input_units'])}",
            f"outputs = {list(model['outputs'])!r}  # {', '.join(model['output_units'])}",
            "# output: (numerator, denominator) in falling powers of s",
            f"sensor_filters = {_filters(model)!r}",
            _PYTHON_FUNCTIONS,
        ]
    )


def mat_file(model: Model) -> bytes:
    """A .mat file (version 5): matrices as arrays, names as cells, sensor_filters as a struct."""
    from scipy.io import savemat

    cells = ("states", "state_units", "inputs", "input_units", "outputs", "output_units")
    content: dict[str, Any] = {
        name: np.array(model[name], dtype=float) for name in (*STATE_SPACE, *DESCRIPTOR)
    }
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


def _matlab_delays(model: Model) -> str:
    if len(model["inputs"]) == 1 and not any(model["output_delays_s"]):
        return "'InputDelay', tau"
    late = _row(model["input_delays_s"]), _row(model["output_delays_s"])
    return f"'InputDelay', {late[0]}, 'OutputDelay', {late[1]}"


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


def _matlab(matrix: Sequence[Sequence[float]]) -> str:
    return "[" + "; ".join(" ".join(repr(float(x)) for x in row) for row in matrix) + "]"


def _row(values: Sequence[float]) -> str:
    return "[" + " ".join(repr(float(x)) for x in values) + "]"


def _cell(names: Sequence[str]) -> str:
    return "{" + ", ".join(f"'{name}'" for name in names) + "}"


def _filters(model: Model) -> dict[str, tuple[list[float], list[float]]]:
    return {output: (f["num"], f["den"]) for output, f in model["sensor_filters"].items()}


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
