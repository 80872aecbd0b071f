"""Machines for the tests of commissioning, as backends from outside: another axis than the sketch, and one fault.

    --backend machines:Machine --backend-options options.yaml       # truth: FILE, fault: NAME, noise: {...}
"""

import math
from collections import deque
from pathlib import Path

import numpy as np

from microstage_ros.hardware.protocol import Reading, Setup
from microstage_ros.hardware.simulated import SimulatedAxis
from microstage_ros.model.actuators import actuator_of
from microstage_ros.model.axis_file import load_axis

FAULTS = ("motor_polarity", "encoder_polarity", "current_polarity", "encoder_dead", "encoder_frozen", "counts_quarter", "counts_fourfold",
          "stuck", "end_stop", "no_current", "zero_current", "delay", "encoder_delay", "resonance")


class Machine:
    """A simulated axis that nobody was told of. Options: ``truth`` (axis file), ``fault``, ``noise``, ``position``.

    ``wrong`` [m] and ``wrong_time`` [s]: way from where a fault of polarity or a dead encoder began, and time beyond 10 µm/s since; ``wrong_run`` [s]: in one go.
    """

    simulated = True
    made = []  # for the tests: what was made last

    def __init__(self, setup):
        options = dict(setup.options or {})
        self.fault = options.pop("fault", "")
        self.frozen_after = options.pop("frozen_after", 20000)
        self.stop_at = options.pop("stop_at", 4e-3)
        axis = load_axis(options.pop("truth")) if "truth" in options else setup.axis
        if self.fault == "resonance":
            axis = axis.with_values({"transmission.stiffness": axis.value("transmission.stiffness") / 9.0})
        self.axis = axis
        self._inner = SimulatedAxis(Setup(axis, setup.seed, options))
        self._queue = deque([0.0] * 5)
        self._readings = deque()
        self.highest = self.lowest = 0.0
        self.most_voltage, self.reads = 0.0, 0
        self.wrong, self.wrong_time, self.wrong_run, self._run, self._wrong_from = 0.0, 0.0, 0.0, 0.0, None
        Machine.made.append(self)

    def open(self):
        """Take hold."""
        self._inner.open()

    def read(self):
        """Sensors, with the fault."""
        state = self._inner._state
        if self.fault == "stuck":
            x0, v0 = float(state["x"]), 0.0
            reading = self._inner.read()
            for name, value in (("x", x0), ("v", v0), ("omega", 0.0)):
                state[name] = value
            reading = Reading(round((x0 + 8e-9 * np.random.default_rng(self.reads).standard_normal()) / 25e-9) * 25e-9,
                              self._voltage * actuator_of(self.axis).amperes_per_command(self.axis) if self.reads else 0.0)
        else:
            reading = self._inner.read()
        if self.fault == "end_stop" and state["x"] > self.stop_at:
            state["x"], state["v"] = self.stop_at, min(float(state["v"]), 0.0)
            reading = reading._replace(encoder=round(self.stop_at / 25e-9) * 25e-9)
        x = float(state["x"])
        self.highest, self.lowest = max(self.highest, x), min(self.lowest, x)
        self.reads += 1
        if self.fault in ("motor_polarity", "encoder_polarity", "encoder_dead") or (self.fault == "encoder_frozen" and self.reads > self.frozen_after):
            self._wrong_from = x if self._wrong_from is None else self._wrong_from
            self.wrong = max(self.wrong, abs(x - self._wrong_from))
            self._run = self._run + self.axis.value("period") if abs(float(state["v"])) > 1e-5 else 0.0
            self.wrong_run, self.wrong_time = max(self.wrong_run, self._run), self.wrong_time + (self.axis.value("period") if self._run else 0.0)
        return self._faulty(reading)

    def _faulty(self, reading):
        x, i, angle = reading
        fault = self.fault
        if fault == "encoder_polarity":
            x = -x
        elif fault == "encoder_dead" or (fault == "encoder_frozen" and self.reads > self.frozen_after):
            x = getattr(self, "_last", 0.0)
        elif fault == "counts_quarter":
            x = round(x / 4 / 25e-9) * 25e-9
        elif fault == "counts_fourfold":
            x = 4 * x
        elif fault == "current_polarity":
            i = -i
        elif fault == "no_current":
            i = math.nan
        elif fault == "zero_current":
            i = 0.0
        elif fault == "encoder_delay":
            self._readings.append(x)
            x = self._readings.popleft() if len(self._readings) > 5 else self._readings[0]
        self._last = x
        return Reading(x, i)

    def write(self, voltage):
        """Hold a voltage, with the fault."""
        self.most_voltage = max(self.most_voltage, abs(voltage))
        if self.fault == "delay":
            self._queue.append(voltage)
            voltage = self._queue.popleft()
        self._voltage = voltage
        self._inner.write(-voltage if self.fault == "motor_polarity" else voltage)

    def close(self):
        """No voltage."""
        self._inner.close()


def random_axis(nominal, seed, factor=2.0):
    """A machine whose every number is within ``factor`` of the nominal one; travel, gear, pitch and counts stay."""
    rng = np.random.default_rng(seed)

    def drawn():
        return float(np.exp(rng.uniform(-np.log(factor), np.log(factor))))

    values = {}
    for key in ("drive.resistance", "drive.inductance", "drive.back_emf", "drive.rotor_inertia", "transmission.stiffness",
                "transmission.damping", "stage.mass", "contacts.actuator.coulomb", "contacts.actuator.static",
                "contacts.actuator.stribeck_velocity", "contacts.actuator.attraction", "contacts.actuator.viscous",
                "contacts.guideway.static", "contacts.guideway.viscous"):
        if nominal.has(key):
            values[key] = nominal.value(key) * drawn()
    if "contacts.actuator.static" in values:
        values["contacts.actuator.static"] = max(values["contacts.actuator.static"], 1.05 * values["contacts.actuator.coulomb"])
    for key in ("contacts.actuator.stiffness", "contacts.guideway.stiffness"):
        if nominal.has(key):
            scale = drawn()
            values[key] = [scale * v for v in nominal.value(key)]
    if nominal.choices["drive.type"] == "voltage_motor":
        values["drive.torque_constant"] = values["drive.back_emf"]
        return nominal.with_values(values, source="estimate")
    for key in ("drive.torque_constant", "drive.force_constant", "drive.gain", "drive.bandwidth", "contacts.guideway.coulomb"):
        if nominal.has(key):
            values[key] = nominal.value(key) * drawn()
    if nominal.has("drive.back_emf"):
        values["drive.back_emf"] = values["drive.torque_constant"]
    return nominal.with_values(values, source="estimate")


def cut_voltage(path):
    """Note that the voltage was taken away from outside."""
    Path(path).touch()
