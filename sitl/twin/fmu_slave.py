"""The rover inside an FMU (FMI 2.0, co-simulation). `fmu_file` copies this file, with the rover, into it."""

from __future__ import annotations

from typing import Any

from pythonfmu import Boolean, Fmi2Causality, Fmi2Slave, Fmi2Variability, Real
from pythonfmu.enums import Fmi2Status

from sitl.twin.rover import PARAMETERS, Motion, Rover

MODEL_NAME = "rover_twin"
INPUTS = {
    "steering_us": "us, PWM of the steering servo, held over a step",
    "throttle_us": "us, PWM of the throttle; used where by_speed is false",
    "speed": "m/s, speed to keep; used where by_speed is true",
}
OUTPUTS = {
    "r": "rad/s, yaw rate, left positive",
    "p": "rad/s, roll rate",
    "a_y": "m/s2, specific force to the left at the IMU, without sensor errors",
    "V_x": "m/s, speed ahead, of the point on the roll axis below the CG",
    "V_y": "m/s, speed to the left, of the same point",
    "phi": "rad, roll angle",
    "psi": "rad, heading, 0 is north, left positive, unwrapped",
    "x": "m, position north",
    "y": "m, position west",
    "delta": "rad, road-wheel angle, left positive",
}


class RoverTwin(Fmi2Slave):
    """Inputs and outputs as in INPUTS and OUTPUTS. The rover starts at rest, on an even road."""

    description = "Simulated rover: single track with roll, a steering servo, tyres with limited grip"

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.modelName = MODEL_NAME
        self.steering_us, self.throttle_us = PARAMETERS.steering_trim_us, PARAMETERS.throttle_trim_us
        self.speed, self.by_speed = 0.0, False
        self.rover = Rover()
        for name, meaning in INPUTS.items():
            self.register_variable(Real(name, causality=Fmi2Causality.input, description=meaning))
        for name, meaning in OUTPUTS.items():
            self._output(name, meaning)
        self.register_variable(
            Boolean(
                "by_speed",
                causality=Fmi2Causality.parameter,
                variability=Fmi2Variability.fixed,
                description="keep the input speed; else throttle_us drives",
            )
        )

    def setup_experiment(self, start_time: float, _stop_time: float | None, _tolerance: float | None) -> None:
        """Start at this time [s]."""
        self.rover.begin(start_time)

    def do_step(self, _current_time: float, step_size: float) -> bool:
        """Advance by step_size [s]; False where the rover overturns or an input is not finite."""
        try:
            if self.by_speed:
                self.rover.follow(self.steering_us, self.speed, step_size)
            else:
                self.rover.step(self.steering_us, self.throttle_us, step_size)
        except ValueError as error:
            self.log(str(error), Fmi2Status.error)
            return False
        return True

    def _output(self, name: str, meaning: str) -> None:
        at = Motion._fields.index(name)
        causality = Fmi2Causality.output
        self.register_variable(
            Real(name, causality=causality, description=meaning, getter=lambda: self.rover.motion[at])
        )
