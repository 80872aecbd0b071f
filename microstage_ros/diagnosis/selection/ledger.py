"""What stands in the held-out records before and after the causes, and what a healthy axis leaves there."""

import dataclasses

from microstage_ros.diagnosis.residuals.evidence_set import Evidences


@dataclasses.dataclass
class Ledger:
    """χ² of the held-out records: before, after the causes, at the floor, rows; each cause's own part, and what is left
    above the floor by channel; ``above_noise``: above the floor and the model's own noise both."""

    before: float = 0.0
    after: float = 0.0
    floor: float = 0.0
    rows: int = 0
    parts: dict = dataclasses.field(default_factory=dict)
    left: dict = dataclasses.field(default_factory=dict)
    above_noise: dict = dataclasses.field(default_factory=dict)

    @property
    def excess(self):
        """What stood out of the noise."""
        return max(self.before - self.floor, 1e-9)  # derived: a divisor, never nothing

    def where_it_stands(self, channels):
        """The same `Ledger` with the floor by which verdict and shares are judged.

        In ``channels``, those of the causes, of a dependence that is left and of what stands above the noise, it is the
        healthy level or the model's noise, whichever is louder (`above_noise`). Elsewhere nothing stands out, and what
        is there is noise: how loud a quiet channel is differs from record to record by more than a small cause holds,
        and taken for something that stood out it would make a cause that explains all of it look like a part.
        """
        return dataclasses.replace(self, floor=self.after - self._left_in(channels))

    def _left_in(self, channels):
        return sum(self.above_noise.get(channel, 0.0) for channel in set(channels))

    def remaining(self, channels):
        """Share [1] of what stood out that is left in these ``channels``: those of the causes, and of what depends on
        something still. How loud another one is differs from record to record by more than a small cause holds, and is
        asked by `stands_out`.
        """
        left = self._left_in(channels)
        return left / max(self.before - self.after + left, 1e-9)  # derived: a divisor, never nothing


def usual_size(evidences, channel):
    """χ² per row of a channel on an axis where nothing is wrong: the baseline's; without one 1, what the noise of the
    model predicts."""
    base = evidences.base.get(channel)
    return 1.0 if base is None else base.energy() / base.rows


def ledger_of(evidences, choices):
    """`Ledger` over the evidences' channels.

    The floor is what a healthy axis leaves on as many rows (`usual_size`); nothing that was fitted to the records under
    test, named or not, enters it. It is no higher than what was reached.
    """
    book = Ledger()
    for channel, held in evidences.held.items():
        scale = evidences.scatter[channel]
        keys = Evidences._keys(channel, choices)
        beta, _, _ = evidences.learn[channel].fit(keys)
        after, floor = (held.energy() - held.reduction(keys, beta)) / scale, held.rows * usual_size(evidences, channel)
        book.before += held.energy() / scale
        book.after += after
        book.floor += floor / scale
        book.rows += held.rows
        book.left[channel] = after - floor / scale
        book.above_noise[channel] = max(after - max(floor, held.rows) / scale, 0.0)
    book.floor = min(book.floor, book.after)
    for choice in choices:
        others = [c for c in choices if c is not choice]
        book.parts[choice.effect] = max(evidences.held_gain(choices) - evidences.held_gain(others), 0.0)
    return book
