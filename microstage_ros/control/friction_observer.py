"""Python face of the friction observer: friction of both contacts, live, and what distinguishes the effects.

The law is in `observer_law`; this file turns its record into figures with units, for node and scripts.
"""

import math
from typing import NamedTuple

import numpy as np

from microstage_ros.control.feedforward import axis as feedforward
from microstage_ros.control.gains import fill
from microstage_ros.control.observer import law
from microstage_ros.control.design.rules import observer_gains
from microstage_ros.numerics.compiled import compiled
from microstage_ros.quantities.errors import InputError
from microstage_ros.solver.period import as_array


class FrictionEstimate(NamedTuple):
    """What the observer knows after a period (SI)."""

    position: float  # m
    velocity: float  # m/s
    actuator_torque: float  # N m at the motor shaft
    actuator_torque_stderr: float
    guideway_force: float  # N
    guideway_force_stderr: float
    total_force: float  # N at the stage, both contacts
    equivalent_voltage: float  # V, what the friction costs the drive
    level: float  # limits of the actuator over nominal
    level_stderr: float
    asymmetry: float  # (forward - backward) / (forward + backward)
    actuator_share: float  # share of the actuator in the total
    guideway_share: float
    sliding: bool  # the actuator slides as a whole
    block_torque: np.ndarray  # N m, actuator blocks
    block_slips: np.ndarray  # bool
    guideway_block_force: np.ndarray  # N
    guideway_block_slips: np.ndarray  # bool


@compiled
def _step(parameters, models, memories, period, encoder, voltage, current):
    """`observer_step` of the only record of each array (see `solver.period`)."""
    law.observer_step(parameters[0], models[0], memories[0], period, encoder, voltage, current)


@compiled
def _steps(parameters, models, memories, period, encoders, voltages, currents, seen, found):
    """`_step` for every period of three columns; one without an encoder value is passed over. ``found`` gets the memory
    after each period at the places ``seen``, rising."""
    written = 0
    for k in range(encoders.size):
        if math.isfinite(encoders[k]):
            law.observer_step(parameters[0], models[0], memories[0], period, encoders[k], voltages[k], currents[k])
        if written < seen.size and seen[written] == k:
            found[written] = memories[0]
            written += 1


class FrictionObserver:
    """Python face of the observer; ``step`` once per control period.

    ``gains``: of `observer_law.GAINS`, instead of what `design` gives for the period; `InputError` for another name or
    a value out of range.

    Example
    -------
    >>> observer = FrictionObserver(load_axis("config/axis.yaml"))
    >>> estimate = observer.step(encoder=0.0, voltage=0.0, current=0.0)
    """

    def __init__(self, axis, period=None, **gains):
        self.period = float(axis.value("period") if period is None else period)
        self.model = np.zeros(1, feedforward.PARAMETERS)[0]
        feedforward.fill_model(self.model, axis)
        known = {gain.name for gain in law.GAINS}
        for name in set(gains) - known:
            raise InputError(f"observer.{name}", gains[name], "one of " + ", ".join(sorted(known)))
        designed = observer_gains(self.model, self.period)
        self.parameters = np.zeros(1, law.PARAMETERS)[0]
        fill(
            self.parameters,
            law.GAINS,
            {**{name: designed[name] for name in known & set(designed)}, **gains},
            "observer",
        )
        law.design_motion(self.parameters, self.model, self.period)
        self.memory = np.zeros(1, np.dtype(law.STATE_FIELDS))[0]
        self._arrays = [as_array(record) for record in (self.parameters, self.model, self.memory)]
        self.started = False
        law.observer_reset(self.parameters, self.memory)

    def step(self, encoder, voltage, current=math.nan):
        """Estimate after a period: ``encoder`` [m], ``current`` [A] read now, ``voltage`` [V] held until now."""
        self.advance(encoder, voltage, current)
        return self.estimate

    def advance(self, encoder, voltage, current=math.nan):
        """`step` without looking at the estimate: ``encoder`` [m], ``voltage`` [V], ``current`` [A] as there."""
        if math.isfinite(encoder):
            if not self.started:
                law.observer_start(self.memory, float(encoder))
                self.started = True
            _step(*self._arrays, self.period, float(encoder), float(voltage), float(current))

    def advance_all(self, encoders, voltages, currents, seen=()):
        """`advance` for every period of ``encoders`` [m], ``voltages`` [V], ``currents`` [A], each of shape (n,).

        Returns
        -------
        the observer's memory after each period at the places ``seen``, shape (k,), rising: for `estimates`.
        """
        # a single message is a view that cannot be written to, for which all would be compiled once more, seconds long
        encoders, voltages, currents = (np.array(column, float) for column in (encoders, voltages, currents))
        finite = encoders[np.isfinite(encoders)]
        if not self.started and len(finite):
            law.observer_start(self.memory, float(finite[0]))
            self.started = True
        seen = np.asarray(seen, np.int64)
        found = np.zeros(len(seen), self.memory.dtype)
        _steps(*self._arrays, self.period, encoders, voltages, currents, seen, found)
        return found

    @property
    def estimate(self):
        """`FrictionEstimate` of the last period."""
        return FrictionEstimate(*(values[0].item() if values.ndim == 1 else values[0]
                                  for values in self.estimates(as_array(self.memory))))

    def estimates(self, s):
        """`FrictionEstimate` of arrays, one entry for each memory in ``s``, shape (k,) (`advance_all`)."""
        model = self.model
        to_force = float(model["force_per_torque"])
        unexplained = float(model["moving_mass"]) * s["inertia"] * s["d"]
        # all but the guideways' share of what is unexplained is put down to the actuator
        torque = s["actuator_friction"] + (unexplained / to_force if model["has_actuator"] else 0.0)
        guide = s["guideway_friction"] + (0.0 if model["has_actuator"] else unexplained)
        size = abs(to_force * torque) + abs(guide)
        size = np.where(size == 0.0, 1.0, size)
        stderr = np.sqrt(s["variance"])
        forward, backward = s["level_forward"], s["level_backward"]
        forces, slips = _blocks(model["actuator"], s["actuator"])
        guide_forces, guide_slips = _blocks(model["guideway"], s["guideway"])
        total = to_force * torque * bool(model["has_actuator"]) + guide
        return FrictionEstimate(
            s["x"], s["v"], torque, abs(s["actuator_friction"]) * stderr, guide,
            abs(guide) * float(self.parameters["level_variability"]), total, total * float(model["volts_per_force"]),
            s["level"], stderr, (forward - backward) / (forward + backward),
            abs(to_force * torque) / size, abs(guide) / size, s["slipping"] > 0.9,
            forces, slips, guide_forces, guide_slips,
        )


def _blocks(packed, state):
    """Forces and slip flags of a packed contact's blocks, (n, blocks)."""
    count = int(packed[10])
    return state[:, :count].copy(), state[:, count : 2 * count] != 0.0
