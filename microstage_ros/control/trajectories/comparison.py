"""Encoder against interferometer: two instruments at one stage must not part."""

from collections import OrderedDict

KEPT = 2000
"""Readings of each that wait for their partner."""

IN_A_ROW = 5


class EncoderComparison:
    """Compares readings of the same control period.

    Parameters
    ----------
    bound : largest distance that the two may part from where they were to each other at first [m]; 0: not watched.
    """

    def __init__(self, bound):
        self._bound = bound
        self._encoder, self._light = OrderedDict(), OrderedDict()
        self._first, self._beyond, self._last = None, 0, 0.0
        self.reported = False

    def add_encoder(self, sequence, position):
        """The encoder read ``position`` [m] in the control period number ``sequence`` [1]."""
        self._add(self._encoder, sequence, position)

    def add_interferometer(self, readings):
        """Corrected readings of the interferometer, (period, position [m])."""
        for sequence, position in readings:
            self._add(self._light, sequence, position)

    def _add(self, kept, sequence, position):
        if not self._bound:
            return
        if kept and sequence < next(reversed(kept)):  # the driver began anew
            self._encoder.clear()
            self._light.clear()
            self._first, self._beyond, self.reported = None, 0, False
        kept[sequence] = position
        while len(kept) > KEPT:
            kept.popitem(last=False)

    def breach(self):
        """What is wrong, in words, once; empty while nothing is."""
        if not self._bound:
            return ""
        for sequence in [number for number in self._light if number in self._encoder]:
            difference = self._encoder.pop(sequence) - self._light.pop(sequence)
            self._first = difference if self._first is None else self._first
            self._last = difference - self._first
            self._beyond = self._beyond + 1 if not abs(self._last) <= self._bound else 0
        if self._beyond < IN_A_ROW or self.reported:
            return ""
        self.reported = True
        return f"encoder and interferometer have moved {self._last:.3g} m apart, the bound is {self._bound:.3g} m"
