"""A record made ready for the residuals: gaps closed, the converter's rounding applied, motion smoothed.

All arrays have shape (n,), one entry per control period, SI.
"""

import dataclasses
import functools

import numpy as np
from scipy.signal import cont2discrete, lfilter
from scipy.stats import norm

from microstage_ros.diagnosis.preprocessing.friction_replay import replay, replayed_force
from microstage_ros.diagnosis.preprocessing.motion import smooth_motion
from microstage_ros.diagnosis.preprocessing.smoothing import reading_noise, triangle
from microstage_ros.diagnosis.preprocessing.transmitted_force import offset_where_closed
from microstage_ros.quantities.errors import InputError
from microstage_ros.signals.current import between_readings, settled_current
from microstage_ros.signals.rows import bridged, of_row_before
from microstage_ros.signals.travel import motor_travel

LEAST_ROWS = 5000    # derived: one piece of `lost_motion.SLOW`, without which no spread can be taken there
# periods, at least, over which the position reading corrects the motor's travel, for the motor's motion; calibrated by:
# validation.windows (from 61 to 91 its speed is known best in both worlds, at 31 and at 245 by 5 to 35 % worse)
FUSION = 61
# the same for the stage's motion, which swings on a soft drive; calibrated by: the same (at 7 and 23 periods its speed
# is by 0 to 150 % worse on healthy axes, and at 23 three times as far off on a soft drive)
STAGE_FUSION = 15
# periods over which the position reading is smoothed where no current tells the travel; calibrated by: the same (at 15
# and at 61 it is by 15 to 95 % worse)
NO_CURRENT = 31
# as `FUSION`, where the stage may rattle in a gap; calibrated by: the same (half as long is by 8 and 17 % worse, twice
# as long by 4 and 7 % better, but over so long a gap may open and close; --seed 5)
GAP_FUSION = 1001
HIT = 3               # periods of the stage's mean there; derived: the least that is one, as a hit lasts some ten
# m: the back-EMF's travel is trusted below some 200 Hz, current and inertia above; calibrated by: validation.variation
# --group noise (half and double: the same answers)
TRAVEL_NOISE = 2.0e-8
# periods to either side; derived: within 10 ms at 10 kHz a speed's share of a period's voltage has died away to
# 1.5·10⁻³, a thirtieth of its largest
SHARE_REACH = 100
SHARE_ROWS = 16 * SHARE_REACH     # derived: far enough from both ends of what is smoothed
# m; derived: a thousandth of the finest count of such encoders, and far above the last bits of a double
LEAST_COUNT = 1.0e-11
# share of the changes that must be whole multiples, and how near to one; derived: chance makes 0.04 of them
ALL_COUNTS, WHOLE = 0.99, 0.02
UNCUT = 8.0      # standard deviations of an amplifier's noise below its limit; derived: a chance of 6·10⁻¹⁶ beyond them
# samples lost one after the other; derived: four come once in 10⁵ rows where a twentieth is lost
LOST_IN_A_ROW = 3
# over unread currents; derived: the reading after one settles from it to a share a = 0.02 of its error, a² the second
PASSES = 2
# m, of the motor's position beside `TRAVEL_NOISE`; calibrated by: validation.variation --group noise (half and double:
# the same answers)
MOTOR_NOISE = 2.0e-9


@dataclasses.dataclass
class Prepared:
    """One record and what the nominal model says about its motion.

    ``answered`` is the voltage that current[n] answers (row n − 1, rounded as the converter rounds, through the
    amplifier if one was given); ``commanded`` the same without that amplifier;
    ``settled`` the current after the winding's time constant, ``(i[n] − a i[n−1]) / (1 − a)``;
    ``travel`` the motor's angle in metres of stage, from back-EMF, current and inertia, without any position
    reading; ``angle`` the same from the back-EMF alone; ``position`` and ``speed`` the
    motor's, in metres of stage, from all readings together; ``contact_speed`` the one by which the actuator's friction
    is replayed, ``speed`` but where `prerequisites.law` knows better; ``load`` the torque that friction and loads took;
    ``actuator`` and ``guideway`` the nominal frictions without viscosity [N m at the motor, N], ``stuck`` the
    share of the actuator's blocks that stick;
    ``lost`` marks samples that were missing, ``repeated`` those in which encoder and current
    stand as one row before (none without a current); ``unread`` those whose current is none of their own;
    ``stage``: the position reading nearest to the truth, the interferometer (less a slow course of its own) if there is
    one, else the encoder;
    ``speed_share``: how much of an error of ``answered`` is in K_E (N/r) ``speed``, `speed_share`;
    ``count``: the step of the encoder's reading [m], 0 where it shows none;
    ``behind``: how far the stage is ahead of the motor by a gap and the wind-up, and ``closed``, whether a flank of the
    gap carried the stage; None without a gap;
    ``shake``: the floor's lines [m] that were taken out of the readings.
    """

    name: str
    period: float
    time: np.ndarray
    encoder: np.ndarray
    interferometer: np.ndarray | None
    reference: np.ndarray
    commanded: np.ndarray
    answered: np.ndarray
    current: np.ndarray
    settled: np.ndarray
    travel: np.ndarray
    angle: np.ndarray
    stage_position: np.ndarray
    position: np.ndarray
    speed: np.ndarray
    stage_speed: np.ndarray
    load: np.ndarray
    actuator: np.ndarray
    stuck: np.ndarray
    contact_speed: np.ndarray
    guideway: np.ndarray
    lost: np.ndarray
    repeated: np.ndarray
    unread: np.ndarray
    off: np.ndarray
    has_current: bool
    air: dict
    stage: np.ndarray
    speed_share: np.ndarray
    behind: np.ndarray | None = None
    closed: np.ndarray | None = None
    count: float = 0.0
    shake: np.ndarray | float = 0.0

    @functools.cached_property
    def stage_noise(self):
        """Standard deviation of the white noise of ``stage`` [m]."""
        return reading_noise(self.stage)


def prepare(record, drive, amplifier=None, lines=(), gap=0.0, course=None, pull=0.0):
    """`Prepared` from a `Record`.

    ``amplifier(command, period)`` (n,) → (n,): what an amplifier that delays or lags makes of the command;
    ``lines``: (frequency [Hz], complex amplitude [m]) of vibrations to take out of the position readings;
    ``gap``: lost motion of the drive train, as travel of the stage [m];
    ``course`` (n,): slow drift of the interferometer [m], which is not the stage's;
    ``pull``: what pulls on a stage behind a gap towards smaller x [N].
    Raises InputError for a record that is too short or lacks what is needed."""
    n = len(record)
    if n < LEAST_ROWS:
        raise InputError(record.source, n, f"at least {LEAST_ROWS} rows")
    period = record.period_s
    columns, lost = {}, np.zeros(n, bool)
    for name in ("encoder_m", "voltage_V", "current_A", "interferometer_m", "reference_m"):
        if name in record:
            columns[name], gaps = _filled(record[name], f"{record.source}: {name}")
            lost |= gaps
    if "voltage_V" not in columns:
        raise InputError(f"{record.source}: voltage_V", "missing", "the commanded voltage")
    # as read: what is taken out below differs from row to row
    repeated = np.full(n, "current_A" in columns)
    for name in {"encoder_m", "current_A"} & set(columns):
        repeated &= columns[name] == of_row_before(columns[name])
    # the scale is read where the floor has shaken it to
    columns["encoder_m"] = columns["encoder_m"] - drive.interpolation_error(columns["encoder_m"])
    shake = np.zeros(n)
    for frequency, size in lines:
        line = (size * np.exp(2j * np.pi * frequency * (record["t_s"] - record["t_s"][0]))).real
        for name in {"encoder_m", "interferometer_m"} & set(columns):
            columns[name] = columns[name] - line
        shake = shake + line
    if "current_A" in columns:
        columns["current_A"] = columns["current_A"] - drive.current_offset
    rounded = np.round(columns["voltage_V"] / drive.converter_step) * drive.converter_step
    rounded = np.clip(rounded, -drive.voltage_limit, drive.voltage_limit)
    answered = commanded = of_row_before(_limited(rounded, drive))
    off = (rounded == 0.0) & (of_row_before(rounded) == 0.0)
    if amplifier is not None:
        answered = amplifier(answered, period)
    stage = columns.get("interferometer_m", columns["encoder_m"])
    if course is not None and "interferometer_m" in columns:
        stage = stage - course
    if "current_A" in columns:
        unread = ~np.isfinite(record["current_A"]) | _lost_rows(repeated)
        current = _as_driven(columns["current_A"], unread, answered, drive, period)
        settled = settled_current(current, drive.current_transient(period))
        angle = motor_travel(answered, settled, drive, period)
    else:
        unread = np.ones(n, bool)
        angle = triangle(stage, NO_CURRENT)
        speed = np.gradient(angle, period)
        current = settled = (answered - drive.back_emf / drive.lever * speed) / drive.resistance
    # fast motion is known better from current and inertia: the back-EMF's noise would ring at the resonance
    travel = smooth_motion(angle, settled, drive, period, TRAVEL_NOISE).position
    closed = offset = None
    if gap > 0.0:   # the stage may rattle: its own reading alone tells how it moves
        position = triangle(stage, HIT)
        offset, closed = offset_where_closed(stage, angle, gap, drive, period, pull)
        motor = angle + triangle(offset, GAP_FUSION)
    else:
        carried = _carried(stage, angle, drive, period)
        position = carried + triangle(stage - carried, STAGE_FUSION)
        motor = angle + triangle(stage - carried, _fusion(drive, period))
    stage_speed = np.gradient(position, period)
    guideway = replayed_force(drive.guideway, stage_speed, period)
    motion = smooth_motion(motor, settled, drive, period, MOTOR_NOISE)
    more = between_readings(settled, current, motion.speed, drive, period) / drive.torque_constant
    # all of the current smoothed alike: one that is driven from limit to limit has much of it between readings
    motion = smooth_motion(motor, settled + more, drive, period, MOTOR_NOISE)
    load = 0.5 * (motion.load + of_row_before(motion.load))  # of the periods on both sides of a reading
    screw_speed = motion.speed / drive.radius
    actuator, stuck = replay(drive.actuator, screw_speed, period)
    air = {name: bridged(record[name]) for name in
           ("air_temperature_K", "air_pressure_Pa", "air_humidity", "stage_temperature_K") if name in record}
    return Prepared(
        name=record.source,
        period=period,
        time=record["t_s"] - record["t_s"][0],
        encoder=columns["encoder_m"],
        interferometer=columns.get("interferometer_m"),
        reference=columns.get("reference_m", stage),
        commanded=commanded,
        answered=answered,
        current=current,
        settled=settled,
        travel=travel,
        angle=angle,
        stage_position=position,
        position=motion.position,
        speed=motion.speed,
        stage_speed=stage_speed,
        load=load,
        actuator=actuator,
        stuck=stuck,
        contact_speed=motion.speed,
        guideway=guideway,
        lost=lost,
        repeated=repeated,
        unread=unread,
        off=off,
        has_current="current_A" in columns,
        air=air,
        stage=stage,
        speed_share=speed_share(drive, period, gap > 0.0),
        behind=stage - angle - offset if gap > 0.0 else None,
        closed=closed,
        count=count_of(record["encoder_m"]),
        shake=shake,
    )


def _limited(voltage, drive):
    """Mean of what an amplifier of noise σ that gives no more than ±U makes of a ``voltage`` (n,) [V] within ±U:
    u − sgn(u) σ (φ(z) − z Φ(−z)), z = (U − |u|)/σ: at its limit half of the noise is cut off, which is 0.4 σ."""
    sigma = drive.amplifier_noise
    near = np.flatnonzero(drive.voltage_limit - np.abs(voltage) < UNCUT * sigma)
    z = (drive.voltage_limit - np.abs(voltage[near])) / (sigma or 1.0)
    limited = voltage.copy()
    limited[near] -= np.sign(voltage[near]) * sigma * (norm.pdf(z) - z * norm.sf(z))
    return limited


def _carried(stage, angle, drive, period):
    """Where the drive train carries the stage, H(s) (r/N) θ − G(s) F_g (`stage_filter`), shape (n,) [m].

    The guideways' force F_g acts through the drive train as the motor does: at the resonance of a soft one it moves the
    stage several times as far as at rest, and late. It is replayed on the stage's own speed, as far as that is known
    without it.

    Parameters
    ----------
    stage : reading (n,) [m]. angle : motor, as travel of the stage (n,) [m]. period : of the rows [s].
    """
    driven = lfilter(*stage_filter(drive, period), angle - angle[0]) + angle[0]
    speed = np.gradient(driven + triangle(stage - driven, STAGE_FUSION), period)
    force = replayed_force(drive.guideway, speed, period) + drive.guideway.viscous * speed
    yielding = lfilter(*stage_filter(drive, period, force=True), force - force[0]) + force[0] / drive.stiffness
    return driven - yielding


def _fusion(drive, period):
    """Odd number of periods [1] over which the stage's reading corrects the motor's travel: `FUSION`, and a whole cycle
    of the drive train's resonance √(K/m) at least.

    A swing at the resonance has no mean over that, so the stage, which swings several times as far as the motor and by
    a damping that nobody knows well, tells nothing of it.
    """
    cycle = 2.0 * np.pi * np.sqrt(drive.mass / drive.stiffness)
    return max(FUSION, 2 * int(0.5 * cycle / period) + 1)


@functools.cache
def speed_share(drive, period, loose=False):
    """What K_E (N/r) times the motor's smoothed speed takes of a voltage that was off by 1 V for one ``period`` [s].

    The back-EMF's travel is then off by a step. The stage's reading takes it back as far as the drive train carries the
    stage there; not within `GAP_FUSION` where the stage is ``loose`` in a gap.

    Returns
    -------
    (2 `SHARE_REACH` + 1,) [1]; entry `SHARE_REACH` + k is the share k periods later.
    """
    rows, at = SHARE_ROWS, SHARE_ROWS // 2
    voltage = np.zeros(rows)
    voltage[at] = 1.0
    travel = motor_travel(voltage, np.zeros(rows), drive, period)
    if not loose:
        carried = lfilter(*stage_filter(drive, period), travel)
        travel = travel - triangle(carried, _fusion(drive, period))
    speed = smooth_motion(travel, np.zeros(rows), drive, period, MOTOR_NOISE).speed
    share = drive.back_emf / drive.lever * speed
    return share[at - SHARE_REACH: at + SHARE_REACH + 1]


def count_of(reading):
    """Step [m] of which all changes of a reading (n,) [m] are multiples, as it is of a counting encoder; 0 if there is
    none."""
    steps = np.abs(np.diff(reading))
    steps = steps[steps > LEAST_COUNT]      # nothing where a reading is missing
    if not len(steps):
        return 0.0
    multiple = steps / steps.min()
    return float(steps.min()) if np.mean(np.abs(multiple - np.round(multiple)) < WHOLE) > ALL_COUNTS else 0.0


def _lost_rows(repeated):
    """Mask (n,) of the rows whose sample was lost, so that the one before is in its place.

    Of ``repeated`` (n,) the runs of `LOST_IN_A_ROW` at most: where more are alike nothing was lost, the axis rests.
    """
    starts, stops = np.flatnonzero(np.diff(np.concatenate([[False], repeated, [False]]).astype(int))).reshape(-1, 2).T
    lost = repeated.copy()
    for start, stop in zip(starts, stops):
        lost[start:stop] = stop - start <= LOST_IN_A_ROW
    return lost


def _as_driven(current, unread, answered, drive, period):
    """The current (n,) [A], its unread samples as the voltage drives them: u − R i_s on the line between neighbours.

    The back-EMF K_E ω = u − R i_s is smooth from one period to the next. The current is not: it answers each period's
    voltage. On a line between its own neighbours it is off by what the law commands from row to row, and where a
    twentieth is lost the motor's angle walks three to eight times as far as by the amplifier's noise.

    Parameters
    ----------
    unread : (n,) rows without a reading of their own. answered : voltage that each current answers (n,) [V].
    drive : `Drive`. period : of the rows [s].
    """
    rows, share = np.flatnonzero(unread[1:]) + 1, drive.current_transient(period)
    current = current.copy()
    for _ in range(PASSES):
        back_emf = answered - drive.resistance * settled_current(current, share)
        settled = (answered - bridged(np.where(unread, np.nan, back_emf))) / drive.resistance
        for n in rows:
            current[n] = share * current[n - 1] + (1.0 - share) * settled[n]
    return current


def _filled(values, place):
    """Values with missing samples bridged in a straight line, and where they were missing."""
    missing = ~np.isfinite(values)
    if missing.mean() > 0.5:
        # derived: per cent
        raise InputError(place, f"{100 * missing.mean():.0f} % missing", "at least half of the samples")
    return bridged(values), missing


# derived: memory alone, no result depends on it
@functools.lru_cache(maxsize=256)
def stage_filter(drive, period, stiffness=1.0, damping=1.0, mass=1.0, force=False):
    """Discrete (b, a) from the motor's travel to the stage, H = (D s + K)/(m s² + D s + K), linear between samples.

    With ``force``: from a force on the stage, G = 1/(m s² + D s + K). The factors ``stiffness``, ``damping`` and
    ``mass`` [1] multiply K, D and m; ``period`` [s].
    """
    k, d, m = drive.stiffness * stiffness, drive.damping * damping, drive.mass * mass
    b, a, _ = cont2discrete(([1.0] if force else [d, k], [m, d, k]), period, method="foh")
    return b.ravel(), a
