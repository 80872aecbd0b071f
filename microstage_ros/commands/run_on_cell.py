"""What a run file asks of a cell beside its motion: the law of the controller's node, and the simulated machine."""

import sys
from dataclasses import replace

import yaml

from microstage_ros.commands.axis import check_effects_fit
from microstage_ros.commands.backend import SIMULATED
from microstage_ros.control.runs.simulate import run_controller
from microstage_ros.quantities.errors import InputError


def with_run(backend, run, axis):
    """The backend with the effects, noise and start of a run, beside the options that it was given.

    Parameters
    ----------
    backend : `ChosenBackend`; None: a cell that runs already. run : `Run`. axis : `Axis`.

    Returns
    -------
    `ChosenBackend`. Noise and start are those of the machine, where it is no simulation of this command: that is said.

    Raises
    ------
    InputError : effects that nothing simulates, or that the machine cannot have.
    """
    given = {"noise": run.noise, "position": run.start_m, "friction": run.friction, "effects": run.effects}
    given = {name: value for name, value in given.items() if value not in (None, {})}
    if backend is None or backend.name != SIMULATED:
        if run.effects:
            says = (f"none, as backend {backend.name} has a machine of its own" if backend else "none, as the cell that"
                    " runs has its machine already: give them to ./microstage cell by --machine FILE")
            raise InputError(f"{run.place}: effects", ", ".join(run.effects), says)
        words = {"noise": "noise", "position": "start_m", "friction": "start"}
        unused = [word for name, word in words.items() if name in given]
        if backend is None and run.controller:
            unused.insert(0, "controller")
        if unused:
            whose = f"the machine of backend {backend.name}" if backend else "the cell that runs"
            print(f"warning: {run.place}: {', '.join(unused)} not used: {whose} has its own", file=sys.stderr)
        return backend
    if not given:
        return backend
    options = backend.options
    if run.effects:
        from microstage_ros.hardware.simulated import machine_for  # the compiled model: not for every experiment

        check_effects_fit(machine_for(axis, options.get("machine")), run)
    merged = {name: {**options.get(name, {}), **given[name]} for name in ("noise", "effects") if name in given}
    return replace(backend, options={**options, **given, **merged})


def law_of(run, axis):
    """Parameters ``controller`` and ``gains`` of the node for the law that a run asks for; none: that of the axis file.

    Raises InputError for a law that the axis cannot have, a gain out of its range, and an open loop.
    """
    if not run.controller:
        return {}
    if run.controller["type"] == "none":
        raise InputError(f"{run.place}: controller.type", "none", "a control law: the cell is in closed loop")
    run_controller(axis, run)
    gains = {name: value for name, value in run.controller.items() if name != "type"}
    return {"controller": run.controller["type"], "gains": yaml.safe_dump(gains, default_flow_style=True).strip()}
