"""What is known of a case beside its coordinates, and the answer in the common words with what is particular to
logs."""

import dataclasses
import math

import numpy as np

from microstage_ros.diagnosis.logs.preprocessing.channels import FLUCTUATION, base_names
from microstage_ros.diagnosis.logs.selection.effects import BEHIND, BEHIND_NEED, NEVER, SIGNATURES
from microstage_ros.diagnosis.result import Diagnosis

SPLIT = 0.05               # of the Coulomb level, by which presliding misleads a fit of level and viscosity
SAID = 2.0                 # of the level: a detectable size beyond it says no more than "not visible"


@dataclasses.dataclass
class Context:
    """What the sizes need to become parameters."""

    channels: dict
    facts: dict
    stroke: float
    top_speed: float
    top_acceleration: float
    place_unit: str
    codes: list
    spectra: dict
    position_at: str = ""

    def scale(self, channel):
        """Mean scale of a channel over the conditions, in the unit of the channel."""
        own = self.channels[channel]
        return float(np.mean([own.scale[c] for c in self.codes if c in own.scale]))

    def viscous(self, channel):
        """(coefficient, stderr) of the baseline's viscous part if it is well determined and matters, else None."""
        own = self.channels[channel]
        values = [own.models[c][2] for c in self.codes]
        errors = [own.stderr[c][2] for c in self.codes]
        value, error = float(np.mean(values)), float(np.mean(errors))
        share = abs(value) * self.top_speed / self.scale(channel)
        return (value, error) if value > 0.0 and share > 0.1 and error < 0.1 * value else None

    def coulomb(self, channel):
        """(level, stderr) of the baseline's friction that does not grow with speed, in the channel's unit; None if
        unknown."""
        own = self.channels[channel]
        value, error = (float(np.mean([table[c][1] for c in self.codes])) for table in (own.models, own.stderr))
        return (value, max(error, SPLIT * value)) if value > 0.1 * self.scale(channel) and error < 0.2 * value else None

    def inertia(self, channel):
        """Coefficient of the acceleration, or None where the baseline does not determine it."""
        own = self.channels[channel]
        value = float(np.mean([own.models[c][3] for c in self.codes]))
        error = float(np.mean([own.stderr[c][3] for c in self.codes]))
        return (
            value
            if abs(value) > 5.0 * error and abs(value) * self.top_acceleration > 0.05 * self.scale(channel)
            else None
        )

    def dominant_order(self):
        """Cycles per turn of the ripple that changed most, or None."""
        best: tuple[float, int | None] = (0.0, None)
        for (is_now, code, direction), (orders, size) in self.spectra.items():
            before = self.spectra.get((False, code, direction))
            if is_now and before is not None and len(before[1]) == len(size):
                k = int(np.argmax(np.abs(size - before[1])))
                best = max(best, (float(abs(size[k] - before[1][k])), int(orders[k])), key=lambda e: e[0])
        return best[1]


@dataclasses.dataclass
class LogDiagnosis:
    """`Diagnosis` in the common words, and what is particular to logs.

    ``visibility``: {id: (visible, detectable size, column, largest)}; ``hidden``: {id: what would show it};
    ``healthy``: rows of the table of the baseline's model; ``evidence``: what the pictures need. ``rival_sizes``: per
    group of rivals {id: parameters}, each as if it were the one.
    """

    diagnosis: Diagnosis
    visibility: dict
    hidden: dict
    healthy: list
    evidence: dict
    context: Context
    rival_sizes: tuple = ()


def hidden_effects(seen, context):
    """{id: what would be needed} of the effects that these signals do not show."""
    out = dict(NEVER)
    for name, signature in SIGNATURES.items():
        if name in seen and seen[name][0]:
            continue
        if name in BEHIND and context.position_at == "motor":
            out[name] = BEHIND_NEED
            continue
        if name in seen:
            _, size, part, largest = seen[name]
            from_size = (
                f"not below {size:.0%} of the {'friction' if signature.effort else 'error'} level in these logs; "
                if size < SAID
                else ""
            )
            out[name] = from_size + _need(name, context)
        else:
            out[name] = _need(name, context)
    return out


def _need(name, context):
    """The signal or move that would show an effect."""
    signature = SIGNATURES[name]
    if signature.kinds and "voltage" not in context.channels:
        return "the drive's voltage"
    if name == "torque_ripple":
        return "the lead, a sampling of ten rows per turn or more, and a steady stretch of several turns"
    if name in ("floor_vibration",):
        return "position or following error during some seconds of rest"
    if signature.effort and "effort" not in context.channels:
        return "the drive's current or torque"
    if name in ("viscous_change", "nonlinear_viscous"):
        return "the same stroke at several speeds, with the drive's effort as recorded"
    if name == "rising_static_friction":
        return "the same move after dwells of 0.1 s, 1 s and 10 s"
    if name == "payload_change":
        return "moves of higher acceleration"
    if "error" not in context.channels or context.channels["error"].kind == FLUCTUATION:
        return "set point and position, or the following error"
    return "more baseline runs, or the effort as recorded, unshifted and with its sign"


def healthy_table(context, spreads):
    """Rows (channel, coefficient, value, stderr, unit) of the baseline's model, and the spread of its level."""
    rows = []
    for name, channel in context.channels.items():
        if channel.kind == FLUCTUATION:
            continue
        units = {
            "constant": channel.unit,
            "level": channel.unit,
            "viscous": f"{channel.unit} s/{context.place_unit}",
            "inertia": f"{channel.unit} s²/{context.place_unit}",
            "spring": f"{channel.unit}/{context.place_unit}",
            "rest": channel.unit,
            "rest after motion": channel.unit,
            "level transient": channel.unit,
            "viscous transient": f"{channel.unit} s/{context.place_unit}",
            "inertia transient": f"{channel.unit} s²/{context.place_unit}",
            "resistance": "ohm",
            "per speed": f"V s/{context.place_unit}",
        }
        for code in context.codes:
            for k, label in enumerate(base_names(channel)):
                value, error = float(channel.models[code][k]), float(channel.stderr[code][k])
                if value or error:
                    rows.append((name, code, label, value, error, units[label]))
        learned = spreads[name]
        for mode in ("level", "gain"):
            if mode in learned.names:
                k = learned.names.index(mode)
                rows.append((name, -1, f"{mode}: spread from run to run", math.sqrt(learned.repetition[k]), 0.0, "1"))
                rows.append(
                    (name, -1, f"{mode}: spread from assembly to assembly", math.sqrt(learned.assembly[k]), 0.0, "1")
                )
    return rows
