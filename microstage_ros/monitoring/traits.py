"""What one window of motion says of the machine: a few sizes per residual channel, each from its own least squares.

A trait is the size of one form of the catalogue, fitted alone to one channel's whitened residual, or the channel's
scatter, ln(χ² per row). It is a number to watch, no cause: what the cause is, `diagnose` tells.
"""

import dataclasses
import math
import sys
from collections.abc import Iterable

from microstage_ros.diagnosis.catalogue import FORMS
from microstage_ros.diagnosis.prerequisites.drive import drive_of
from microstage_ros.diagnosis.preprocessing.common_sensors import OPTIONAL, in_common
from microstage_ros.diagnosis.preprocessing.preparation import prepare
from microstage_ros.diagnosis.residuals.collection import Collection
from microstage_ros.quantities.errors import InputError

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
    """The numbers of one axis that the residuals need, the forms that are watched, and the sensors that are used.

    The sensors are those that all windows have that `meet` was shown, else those of the first window that is judged:
    what another sensor reads has another noise, and is not comparable.

    Parameters
    ----------
    axis : `Axis` of a voltage-driven screw. Raises InputError for another.
    """

    def __init__(self, axis):
        self.drive = drive_of(axis)
        wanted = {(channel, key) for channel, keys in WATCHED.items() for key in keys}
        self._forms = [form for form in FORMS if (form.channel, form.key) in wanted]
        self._sensors, self._said, self._met, self._begun = None, set(), [], "the first window"

    @property
    def sensors(self):
        """Names of the columns beside encoder and command that are used, sorted; None before the first window."""
        return None if self._sensors is None else sorted(self._sensors)

    def hold_to(self, sensors: Iterable[str], history: str) -> None:
        """Use the sensors with which a history was begun, and no other; one that is left out is said.

        Parameters
        ----------
        sensors : names of columns. history : its file, for messages.

        Raises
        ------
        InputError : the windows that `meet` was shown lack one of them.
        """
        seen = set(sensors) if self._sensors is None else self._sensors
        if set(sensors) - seen:
            raise InputError(f"{history}: sensors", ", ".join(sorted(seen)) or "none in all windows",
                             f"{', '.join(sorted(sensors))}, with which the history was begun, or another history file")
        self._begun = f"the history {history}"
        self._say([f"{name} is not used: {self._begun} lacks it." for name in sorted(seen - set(sensors))])
        self._sensors = set(sensors)

    def meet(self, record):
        """Leave the sensors that this window lacks out of all windows that are judged; said once on standard error.

        Parameters
        ----------
        record : `Record` of a window, of which two columns are kept until the next one.
        """
        (_, (record,)), notes = in_common(self._met, [record])
        kept = [name for name in OPTIONAL if name in record]
        self._met = [dataclasses.replace(record, columns={name: record.columns[name] for name in ("t_s", *kept)})]
        self._sensors = set(kept)
        self._say(notes)

    def traits(self, record):
        """Sizes of one window, {(channel, trait): size [1]}, in units of the form's own columns.

        Parameters
        ----------
        record : `Record` of a window of motion, at least some seconds.

        Raises
        ------
        InputError : for a record that the residuals cannot use, or one that lacks a sensor of the first window or of
            the history.
        """
        found, record = {}, self._comparable(record)
        fast = Collection({"learn": [prepare(record, self.drive)], "held": [], "base": []}, self.drive, fast_only=True)
        slow = Collection(fast.prepared, self.drive)
        for collection, names in ((fast, {"command"}), (slow, set(WATCHED) - {"command"})):
            present = {name for channels in collection.channels["learn"] for name in channels}
            for name in sorted(names & present):
                found |= self._channel(collection, name)
        return found

    def _comparable(self, record):
        """The window with the sensors that are used; one that is left out is said once on standard error."""
        ((record,),), notes = in_common([record])
        present = {name for name in OPTIONAL if name in record}
        if self._sensors is None:
            self._sensors = present
        for name in sorted(self._sensors - present):
            raise InputError(f"{record.source}: column {name}", "missing in more than half of the rows of a window",
                             f"{name}, as in {self._begun}; or records that all lack it")
        for name in sorted(present - self._sensors):
            notes.append(f"{name} is not used: {self._begun} lacks it.")
        self._say(notes)
        columns = {name: record.columns[name] for name in record.columns if name not in present - self._sensors}
        return dataclasses.replace(record, columns=columns)

    def _say(self, notes):
        """Each sensor that is not used, once on standard error."""
        for note in notes:
            if (name := note.split(" ", 1)[0]) not in self._said:
                self._said.add(name)
                print(f"warning: {note}", file=sys.stderr)

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
