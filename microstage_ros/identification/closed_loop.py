"""The identified axis in its own closed loop: does its force follow the record's, and the last refinement.

The model is run with the record's reference and the axis file's controller; the force it asks for is held
against the recorded one. `refine_closed_loop` fits the parameters of the inverse model to that force (closed
loop output error): fewer assumptions on derivatives, and the figure that a simulation is judged by.
"""

import numpy as np
from scipy.optimize import least_squares

from microstage_ros.control.runs.run_file import Run
from microstage_ros.control.runs.simulate import simulate
from microstage_ros.identification.estimators.estimate import Identification, from_interval
from microstage_ros.identification.estimators.intervals import block_covariance, correlation
from microstage_ros.identification.estimators.inverse_dynamics import EXPERIMENTS, KEYS, UNITS, applied_force
from microstage_ros.quantities.errors import InputError
from microstage_ros.solver.plant import NoiseSpec

LEAD_IN = 0.2  # start of a record that is not judged [s]: the axis may have been in motion before


def closed_loop_force(axis, record):
    """Force [N], shape (n,), that the axis asks for along the record's reference, without noise or counts.

    Raises InputError: the axis file has no controller.
    """
    if axis.controller.get("type", "none") == "none":
        raise InputError(
            f"{axis.place}: controller.type", "none", "the controller of the record, to simulate its closed loop"
        )
    # the loop amplifies every flipped count to half a newton: without counts the force is smooth in the parameters
    axis = axis.with_values({"sensors.encoder.resolution": 0.0}, source="derived")
    run = Run(
        period_s=record.period_s,
        controller=dict(axis.controller),
        noise=NoiseSpec.none().as_dict(),
        program=[{"reference": record["reference_m"]}],
        start_m=float(record["encoder_m"][0]),
    )
    return applied_force(simulate(axis, run), axis)


def force_error(axis, record):
    """(relative error, rms [N]) of the closed-loop force against the recorded one, after the lead-in."""
    judged = slice(int(LEAD_IN / record.period_s), None)
    force = applied_force(record, axis)[judged]
    error = force - closed_loop_force(axis, record)[judged]
    return float(np.linalg.norm(error) / np.linalg.norm(force)), float(np.sqrt(np.mean(error**2)))


def refine_closed_loop(records, axis, values):
    """Mass [kg], friction [N s/m, N] and offset [N] for the least error of the closed-loop force.

    Parameters
    ----------
    records : list of `Record`. axis : force-driven `Axis` with its controller.
    values : starting values {key of `inverse_dynamics.KEYS`: number, SI}.

    Returns
    -------
    `Identification` with the four parameters, and the error before and after in its remarks.
    """
    start = np.array([values[key] for key in KEYS])
    scale = np.where(start == 0.0, abs(values[KEYS[2]]), start)

    def residual(relative):
        trial = axis.with_values(dict(zip(KEYS, start + (relative - 1.0) * scale)))
        return np.concatenate([
            (applied_force(r, axis) - closed_loop_force(trial, r))[int(LEAD_IN / r.period_s):] for r in records])

    fit = least_squares(residual, np.ones(len(KEYS)), diff_step=0.01, max_nfev=15)
    found = start + (fit.x - 1.0) * scale
    covariance = block_covariance(fit.jac, fit.fun, max(int(0.5 / records[0].period_s), 20))
    spread = np.sqrt(np.diag(covariance)) * np.abs(scale)
    result = Identification()
    for i, key in enumerate(KEYS):
        result.add(from_interval(key, found[i], spread[i], UNITS[i], method="closed-loop output error, block sandwich",
                                 experiment=EXPERIMENTS[i], floor=abs(found[2]) if i == 3 else 0.0))
    result.correlations.append((KEYS, correlation(covariance)))
    for name, trial in (
        ("axis file", axis),
        ("inverse model", axis.with_values(values)),
        ("closed-loop output error", axis.with_values(dict(zip(KEYS, found)))),
    ):
        errors = [force_error(trial, record) for record in records]
        result.remarks.append(
            f"Closed-loop force, {name}: error {np.mean([e[0] for e in errors]):.3%}, rms "
            f"{np.mean([e[1] for e in errors]):.4g} N."
        )
    return result
