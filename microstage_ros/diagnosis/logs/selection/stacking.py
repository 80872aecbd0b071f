"""Columns of the effects over the coordinates of all channels, one below the other, and their wider forms."""

import dataclasses

import numpy as np

from microstage_ros.diagnosis.logs.selection.effects import SIGNATURES

#: Wider or other forms of an effect: friction that differs in one place; friction that a loop without integrator shows
#: at rest too.
LOCAL = {"position_dependent_friction": ("bumps",), "friction_level_change": ("friction in error", "lost motion")}
#: The same where an effort is logged: friction whose part in proportion to the speed has stayed as it was.
OF_EFFORT = {"friction_level_change": ("dead zone",)}


def effects_of(channels, only=None, without=()):
    """{id: (K, k)} and {id: column names} for stacked coordinates; ``channels``: {name: Coordinates}; ``only``: ids, or
    None for all; ``without``: ids that are left out.

    A trace in fluctuations with and without motion comes in a wider form too (``id+``).
    """
    stack = _Stack(channels)
    effects, parts = {}, {}
    for effect, signature in SIGNATURES.items():
        if (only is not None and effect not in only) or effect in without:
            continue
        own, wider = _forms_of(stack, effect, signature)
        own, wider = (own, wider) if own.names else (wider, own)
        for name, form in ((effect + "+", wider), (effect, own)):
            if form.names:
                effects[name], parts[name] = np.hstack(form.blocks), form.names
    return effects, parts


@dataclasses.dataclass
class _Form:
    """Blocks (K, k) of the stacked coordinates, and the names of the columns that they are made of."""

    blocks: list = dataclasses.field(default_factory=list)
    names: list = dataclasses.field(default_factory=list)

    def add(self, block, names):
        """Puts a block beside the others, unless it is None."""
        if block is not None:
            self.blocks.append(block)
            self.names += names


class _Stack:
    """Coordinates of all channels, one below the other: K rows. ``channels``: {name: Coordinates}."""

    def __init__(self, channels):
        self.channels, self.offsets, self.total = channels, {}, 0
        for name, coordinates in channels.items():
            self.offsets[name] = self.total
            self.total += len(coordinates.kind)

    def columns(self, channel, names):
        """(K, k) of a channel's columns of these names that are not zero, or None."""
        coordinates = self.channels[channel]
        found = [coordinates.columns[n] for n in names if n in coordinates.columns]
        block = np.hstack(found)[:, np.abs(np.hstack(found)).max(axis=0) > 1e-9] if found else np.zeros((0, 0))
        if not block.shape[1]:
            return None
        out = np.zeros((self.total, block.shape[1]))
        out[self.offsets[channel]: self.offsets[channel] + len(coordinates.kind)] = block
        return out

    def amplitude(self, channel, wanted):
        """(K, 1): one in the amplitudes of a kind, ``"rough 0"`` at rest and ``"rough moving"`` in motion; or None."""
        if channel not in self.channels:
            return None
        coordinates = self.channels[channel]
        base, _, which = wanted.partition(" ")
        own = coordinates.kind == (wanted if base == "ripple" else base)
        if base != "ripple":
            own = own & ((coordinates.direction == 0) if which == "0" else (coordinates.direction != 0))
        if not own.any():
            return None
        out = np.zeros((self.total, 1))
        out[self.offsets[channel] + np.flatnonzero(own), 0] = 1.0
        return out


def _forms_of(stack, effect, signature):
    """(form, wider form) of one effect, each a `_Form`, empty where these signals have none."""
    own, wider = _Form(), _Form()
    force = "effort" if "effort" in stack.channels else "error"
    own.add(*_block(stack, signature))
    if effect in LOCAL and own.blocks:
        other = OF_EFFORT.get(effect, LOCAL[effect]) if force == "effort" else LOCAL[effect]
        wider.add(stack.columns(force, other), list(other))
    amplitudes = [(stack.amplitude(force if effect == "torque_ripple" else channel, wanted), wanted)
                  for channel, wanted in signature.amplitudes]
    amplitudes = [(block, "rough" if wanted.startswith("rough") else wanted) for block, wanted in amplitudes
                  if block is not None]
    if effect == "floor_vibration" and len(amplitudes) == 2:    # at rest and in motion alike, or at rest
        wider.add(np.hstack([block for block, _ in amplitudes]), ["rough", "rough"])
        amplitudes = amplitudes[:1]
    elif effect == "floor_vibration":
        amplitudes = []
    if effect == "torque_ripple" and force == "effort":
        wider.add(stack.amplitude("effort", "rough moving"), ["rough"])
    for block, name in amplitudes:
        own.add(block, [name])
    return own, wider


def _block(stack, signature):
    """Columns of one effect in the channel where it is to be looked for, and their names."""
    channels = stack.channels
    kind = channels["effort"].channel.kind if "effort" in channels else ""
    if "voltage" in channels and signature.voltage:
        return stack.columns("voltage", signature.voltage), list(signature.voltage)
    if "effort" in channels and signature.effort:
        if signature.kinds and kind not in signature.kinds:
            return None, []
        return stack.columns("effort", signature.effort), list(signature.effort)
    if "error" in channels and signature.error and "effort" not in channels:
        return stack.columns("error", signature.error), list(signature.error)
    return None, []
