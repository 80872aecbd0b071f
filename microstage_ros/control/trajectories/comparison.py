"""Encoder against interferometer: two instruments at one stage must not part."""

import numpy as np

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
        self._encoder, self._light = {}, {}
        self._newest = [-1, -1]  # period of either
        self._forget()

    def _forget(self):
        self._encoder.clear()
        self._light.clear()
        self._first, self._beyond, self._last = None, 0, 0.0
        self.reported = False

    def add_encoder(self, sequences, positions):
        """What the encoder read: ``positions`` [m] in the control periods ``sequences`` [1], both (n,), in order."""
        self._add(0, self._encoder, sequences, positions)

    def add_interferometer(self, sequences, positions):
        """The same of the interferometer, corrected: ``positions`` [m], ``sequences`` [1], both (n,)."""
        self._add(1, self._light, sequences, positions)

    def _add(self, which, kept, sequences, positions):
        if not self._bound or not len(sequences):
            return
        if sequences[0] < self._newest[which]:  # the driver began anew
            self._forget()
        self._newest[which] = int(sequences[-1])
        kept.update(zip(sequences.tolist(), positions.tolist()))
        for sequence in list(kept)[:-KEPT]:
            del kept[sequence]

    def breach(self):
        """What is wrong, in words, once; empty while nothing is."""
        both = sorted(self._light.keys() & self._encoder.keys())
        if both:
            difference = np.array([self._encoder.pop(n) - self._light.pop(n) for n in both])
            self._first = difference[0] if self._first is None else self._first
            difference -= self._first
            within = np.flatnonzero(np.abs(difference) <= self._bound)
            self._beyond = len(both) - 1 - within[-1] if len(within) else self._beyond + len(both)
            self._last = difference[-1]
        if self._beyond < IN_A_ROW or self.reported:
            return ""
        self.reported = True
        return f"encoder and interferometer have moved {self._last:.3g} m apart, the bound is {self._bound:.3g} m"
