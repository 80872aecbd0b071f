"""A name that leaves more of repetitions held back than there was without it is none."""

import types

from microstage_ros.diagnosis.logs.selection import gain


class FakeStage:
    def __init__(self, names, rivals=()):
        self.chosen = [types.SimpleNamespace(name=name, rivals=rivals) for name in names]

    def drop(self, name):
        self.chosen = [choice for choice in self.chosen if choice.name != name]


def test_what_makes_held_back_repetitions_worse_is_left_out_worst_first(monkeypatch):
    """A ripple with a share of 0 was named while it raised what was left of the held-back half from 101 to 121."""
    takes = {"torque_ripple": -5.0, "gravity_tilt": 3.0, "cable_spring": -1.0}

    def measured(stages, groups, open_sign):
        names = [choice.name for stage in stages for choice in stage.chosen]
        # beside the ripple the cable takes nothing; without it, it does
        beside = {**takes, "cable_spring": -1.0 if "torque_ripple" in names else 2.0}
        return "gain", {name: (0.0, 1.0, 1.0, beside[name]) for name in names}, ["said"]

    monkeypatch.setattr(gain, "gain_of", measured)
    stages = [FakeStage(["torque_ripple", "gravity_tilt"]), FakeStage(["cable_spring"])]
    found, parts, said = gain.gain_of_confirmed(stages, {}, False)
    assert found == "gain" and set(parts) == {"gravity_tilt", "cable_spring"}
    assert said[0] == "said" and "torque_ripple" in said[1] and len(said) == 2
    assert set(gain.gain_of_confirmed([FakeStage(["torque_ripple"], ["screw_pitch_error"])], {}, False)[1]) == {"torque_ripple"}
