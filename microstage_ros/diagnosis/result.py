"""What a diagnosis says: verdict, causes with sizes, rivals, gain, and what the pictures show.

Plain data, without any arithmetic of its own, so that the judge that fills it and the page that
shows it need not know each other.
"""

import dataclasses

VERDICTS = ("agrees", "explained", "partly_explained", "undetermined", "unexplained")


@dataclasses.dataclass(frozen=True)
class Parameter:
    """A fitted size: value and standard error in ``unit`` (SI, ``"1"`` for a ratio)."""

    value: float
    stderr: float
    unit: str


@dataclasses.dataclass(frozen=True)
class Improvement:
    """Root mean square residual on the held-out records, before and after, in ``unit``."""

    before: float
    after: float
    unit: str


@dataclasses.dataclass(frozen=True)
class Cause:
    """One cause that is sure.

    Attributes
    ----------
    id : the effect's id in `model.effects`, for instance ``"backlash"``.
    parameters : fitted sizes by parameter name.
    effect : the entry of an axis file's ``effects`` section that makes the model show this cause.
    probability : that the cause is real and rightly named, 0 … 1.
    share : fraction (0 … 1) of what stood out of the noise on the held-out records that it removes; a channel in which
    no cause shows and nothing stands above the noise floor is noise.
    gain : rms on the held-out records of the residual channel in which the cause shows.
    channel : that channel, for instance ``"voltage"``, ``"current"``, ``"position"``.
    sentence : what it means for a technician, in one sentence with size and unit.
    evidence : χ² that it takes from the held-out records, from which the probability is calibrated; 0 where there is
    none.
    clarity : fraction (0 … 1) of what the other causes leave in its channel above the noise that it removes.
    """

    id: str
    parameters: dict
    effect: dict
    probability: float
    share: float
    gain: Improvement
    channel: str
    sentence: str = ""
    evidence: float = 0.0
    clarity: float = 0.0


@dataclasses.dataclass(frozen=True)
class Rivals:
    """Causes that these records cannot tell apart, why, and the run file (a mapping; empty: a standard one) that
    would."""

    ids: tuple
    why: str
    experiment: dict


@dataclasses.dataclass(frozen=True)
class OverallImprovement:
    """Residual over all channels on held-out records: before, after, noise floor and the 95 % interval of after."""

    metric: str
    unit: str
    records: tuple
    before: float
    after: float
    floor: float
    ci95: tuple


@dataclasses.dataclass(frozen=True)
class Finding:
    """How strongly a residual depends on one coordinate.

    ``statistic`` and ``threshold`` are in the same units (a variance ratio); the finding is
    significant on an axis where nothing is wrong in at most one case of a thousand.
    ``left`` is the statistic after the causes have been taken out.
    """

    channel: str
    coordinate: str
    statistic: float
    threshold: float
    left: float

    @property
    def significant(self):
        """Whether the residual depends on this coordinate before the causes are taken out."""
        return self.statistic > self.threshold


@dataclasses.dataclass(frozen=True)
class Picture:
    """Curves of one residual against one coordinate.

    ``curves`` maps a label (``"measured"``, ``"model with the causes"`` …) to a pair of equal-length
    arrays ``(x, y)``, or a triple with the standard deviation of y. ``cause`` is the id of the cause
    that the picture shows, or an empty string.
    """

    key: str
    title: str
    x_label: str
    y_label: str
    curves: dict
    cause: str = ""


@dataclasses.dataclass(frozen=True)
class Diagnosis:
    """The answer for one axis: see the fields' own descriptions; ``verdict`` is one of `VERDICTS`.

    ``identified``: numbers of the axis file that were fitted along, {dotted key: `Parameter`}.
    ``provisional``: effects that stand in for a cause whose name is open (the first of each `Rivals`), so
    that the extended axis predicts as well as it can; {id: {parameter: value}}.
    ``doubtful``: further causes that were too unlikely to be named.
    ``of_one_homing``: effects whose phase holds until the machine homes again; a record after that has its own.
    ``floors``: {channel: (χ² that the causes leave of the held-out records above what their twin leaves, its standard
    error, χ² of each twin)}, where a simulation gave a twin; ``remains``: {channel: `leftover.Remains`}.
    """

    verdict: str
    causes: tuple = ()
    rivals: tuple = ()
    gain: OverallImprovement | None = None
    findings: tuple = ()
    pictures: tuple = ()
    notes: tuple = ()
    seed: int = 0
    identified: dict = dataclasses.field(default_factory=dict)
    provisional: dict = dataclasses.field(default_factory=dict)
    of_one_homing: tuple = ()
    doubtful: tuple = ()
    floors: dict = dataclasses.field(default_factory=dict)
    remains: dict = dataclasses.field(default_factory=dict)

    @property
    def effects(self):
        """The ``effects`` section that extends the axis file: ``{id: {parameter: value}}``."""
        return {cause.id: dict(cause.effect) for cause in self.causes}
