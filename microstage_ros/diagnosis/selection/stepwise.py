"""Forward selection, the one loop of every engine of diagnosis: what competes, what stands and how it is kept is the
residual model's.

The balance of the motor (`selection.selection`), the re-simulated closed loop (`resimulation.selection`) and the logs
without a model (`logs.selection.decide`) differ in their evidence and so in their thresholds;
docs/decisions/one-selection.md says in what.
"""

from typing import Protocol, TypeVar

ROUNDS = 2      # per cause; derived: each is taken once, and once more if another one that pushed it out is dropped

State = TypeVar("State")
Trial = TypeVar("Trial")


class ResidualModel(Protocol[State, Trial]):
    """What the loop asks of a residual model. ``state``: the causes chosen so far, with whatever is fitted with
    them."""

    def count(self, state: State) -> int:
        """How many causes are chosen."""

    def trials(self, state: State) -> list[Trial]:
        """One more cause each, fitted beside those chosen, the strongest first."""

    def first_standing(self, trials: list[Trial], state: State) -> Trial | None:
        """The strongest trial that is significant, holds on data left out and is no misfit of the causes chosen; or
        None."""

    def extended(self, state: State, winner: Trial, trials: list[Trial]) -> State:
        """The state with the winner, everything fitted or pruned anew; rivals are looked for among the trials."""


def forward(model: ResidualModel, state: State, most: int) -> tuple[State, list]:
    """Add causes as long as one stands, ``most`` at most: the last state, and the trials of the last round that was
    won.

    A cause that is added may push another one out, and that one the first again; so there are `ROUNDS` for each of
    ``most``.
    """
    last: list = []
    for _ in range(ROUNDS * most):
        if model.count(state) >= most:
            break
        trials = model.trials(state)
        winner = model.first_standing(trials, state)
        if winner is None:
            break
        state, last = model.extended(state, winner, trials), trials
    return state, last
