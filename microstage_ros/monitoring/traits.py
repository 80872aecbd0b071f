"""What one window of motion says of the machine: a few sizes per residual channel, each from its own least squares.

A trait is the size of one form of the catalogue, fitted alone to one channel's whitened residual, or the channel's
scatter, ln(χ² per row). It is a number to watch, no cause: what the cause is, `diagnose` tells.
"""

import math

from microstage_ros.diagnosis.catalogue import FORMS
from microstage_ros.diagnosis.prerequisites.drive import drive_of
from microstage_ros.diagnosis.preprocessing.preparation import prepare
from microstage_ros.diagnosis.residuals.collection import Collection

SCATTER = "scatter"
WATCHED = {
    "torque": (
        ("friction_level_change", ""),
        ("viscous_change", ""),
        ("gravity_tilt", ""),
        ("direction_asymmetry", ""),
    ),
    "windup": (("amplifier_offset", ""), ("amplifier_gain", ""), ("drive_compliance", "")),
    "resonance": (("payload_change", "1.25"), ("drive_compliance", "0.8")),
    "position": (("scale_error", ""), ("thermal_drift", "linear")),
    "command": (("transport_delay", "0.5"), ("actuator_lag", "4e-05")),
}
"""Channel to the forms whose sizes are watched: those with one size, that differ in what they say of the channel."""


class Machine:
    """The numbers of one axis that the residuals need, and the forms that are watched.

    Parameters
    ----------
    axis : `Axis` of a voltage-driven screw. Raises InputError for another.
    """

    def __init__(self, axis):
        self.drive = drive_of(axis)
        wanted = {(channel, key) for channel, keys in WATCHED.items() for key in keys}
        self._forms = [form for form in FORMS if (form.channel, form.key) in wanted]

    def traits(self, record):
        """Sizes of one window, {(channel, trait): size [1]}, in units of the form's own columns.

        Parameters
        ----------
        record : `Record` of a window of motion, at least some seconds.

        Raises
        ------
        InputError : for a record that the residuals cannot use.
        """
        found = {}
        fast = Collection({"learn": [prepare(record, self.drive)], "held": [], "base": []}, self.drive, fast_only=True)
        slow = Collection(fast.prepared, self.drive)
        for collection, names in ((fast, {"command"}), (slow, set(WATCHED) - {"command"})):
            present = {name for channels in collection.channels["learn"] for name in channels}
            for name in sorted(names & present):
                found |= self._channel(collection, name)
        return found

    def _channel(self, collection, name):
        """Traits of one channel."""
        forms = [form for form in self._forms if form.channel == name]
        evidence = collection.gather(name, forms, "learn")
        found = {(name, SCATTER): math.log(max(evidence.energy(), 1e-12) / max(evidence.rows, 1))}
        for form in forms:
            sizes, _, _ = evidence.fit([form.key])
            if len(sizes) == 1:
                found[name, form.effect] = float(sizes[0])
        return found
