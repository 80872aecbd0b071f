"""Each law with a differential equation against scipy or a plain, separate implementation of it."""

import numpy
import pytest
from law_contact import pack
from scipy.integrate import solve_ivp

from microstage_ros.model.friction.registry import run_law

STIFFNESS, WEIGHT = numpy.array([40.0, 12.0, 4.0]), numpy.array([0.5, 0.3, 0.2])


def curve(w):
    """|s(w)| of the tests' contact, direction by direction."""
    static, coulomb = (1.0, 0.6) if w >= 0.0 else (0.9, 0.7)
    return coulomb + (static - coulomb) * numpy.exp(-(abs(w / 0.5) ** 1.3))


def viscous(w):
    return numpy.where(w >= 0.0, 0.05, 0.08) * w


def speed(t):
    """A velocity that reverses five times in half a second, in and out of pre-sliding."""
    return 0.8 * numpy.sin(2 * numpy.pi * 3.0 * t) + 0.4 * numpy.sin(2 * numpy.pi * 7.0 * t + 1.0)


def motion(period):
    """(time, velocity) sampled every ``period``."""
    time = numpy.arange(0, round(0.5 / period) + 1) * period
    return time, speed(time)


def integrate(rhs, start, time, w=speed):
    """States (n, m) at ``time`` of dy/dt = rhs(w(t), y)."""
    return solve_ivp(
        lambda t, y: rhs(w(t), y), (time[0], time[-1]), start,
        t_eval=time, method="DOP853", rtol=1e-10, atol=1e-12, max_step=2e-3,
    ).y.T  # fmt: skip


def dahl(w, y):
    limit = 0.6 if w >= 0.0 else 0.7
    u = 1.0 - numpy.sign(w) * y[0] / limit
    return [50.0 * w * numpy.sign(u) * abs(u) ** 1.4]


def lugre(w, y):
    return [w - 50.0 * abs(w) * y[0] / curve(w)]


def blend(w, z):
    """a(z, w) of the elasto-plastic law."""
    breakaway, limit = 0.6 * (0.6 if w >= 0.0 else 0.7), curve(w)
    force = 50.0 * z * numpy.sign(w)
    if force <= breakaway:
        return 0.0
    if force >= limit:
        return 1.0
    return 0.5 + 0.5 * numpy.sin(numpy.pi * (force - 0.5 * (limit + breakaway)) / (limit - breakaway))


def elasto_plastic(w, y):
    return [w - blend(w, y[0]) * 50.0 * abs(w) * y[0] / curve(w)]


def bristle_force(rhs):
    """F of a bristle law from its z, σ₁ capped at 4 |s| / |w|."""

    def force(velocity, states):
        damping = numpy.array([min(0.3, 4.0 * curve(w) / max(abs(w), 1e-12)) for w in velocity])
        rate = numpy.array([rhs(w, y)[0] for w, y in zip(velocity, states, strict=True)])
        return 50.0 * states[:, 0] + damping * rate + viscous(velocity)

    return force


@pytest.mark.parametrize(
    ("name", "rhs", "to_force"),
    [
        ("dahl", dahl, lambda velocity, states: states[:, 0] + viscous(velocity)),
        ("lugre", lugre, bristle_force(lugre)),
        ("elasto_plastic", elasto_plastic, bristle_force(elasto_plastic)),
    ],
)
def test_single_state_laws_agree_with_scipy_to_second_order(name, rhs, to_force):
    law, packed = pack(name)
    errors = []
    for period in (1e-3, 2.5e-4):
        time, velocity = motion(period)
        reference = to_force(velocity, integrate(rhs, [0.0], time))
        errors.append(numpy.abs(run_law(law, packed, velocity, period) - reference).max())
    assert errors[0] < 5e-4
    assert errors[1] < errors[0] / 10.0  # a quarter of the step: a sixteenth of the error


def gms_reference(time, velocity, attraction):
    """Event-driven generalised Maxwell-slip: every block alone, scipy between its events. Force (n,)."""
    total = numpy.zeros(time.size)

    def w(t):
        return numpy.interp(t, time, velocity)

    crossings = [
        time[i] + (time[i + 1] - time[i]) * velocity[i] / (velocity[i] - velocity[i + 1])
        for i in numpy.flatnonzero(velocity[:-1] * velocity[1:] < 0.0)
    ]
    for stiffness, weight in zip(STIFFNESS, WEIGHT, strict=True):
        force, held = 0.0, numpy.zeros(time.size)
        for begin, end in zip([time[0], *crossings], [*crossings, time[-1]], strict=True):
            sign = numpy.sign(w(0.5 * (begin + end)))

            def stick(t, y, stiffness=stiffness):
                return [stiffness * w(t)]

            def reached(t, y, sign=sign, weight=weight):
                return sign * y[0] - weight * curve(sign * abs(w(t)))

            def slip(t, y, sign=sign, weight=weight):
                return [attraction * (sign * weight - y[0] / curve(sign * abs(w(t))))]

            reached.terminal, reached.direction = True, 1.0
            options = {"rtol": 1e-9, "atol": 1e-12, "max_step": 2e-3, "dense_output": True}
            one = solve_ivp(stick, (begin, end), [force], events=reached, **options)
            parts = [one]
            if one.status == 1:
                parts.append(solve_ivp(slip, (one.t[-1], end), one.y[:, -1], **options))
            for part in parts:
                inside = (time >= part.t[0]) & (time <= part.t[-1])
                held[inside] = part.sol(time[inside])[0]
            force = parts[-1].y[0, -1]
        total += held
    return total


def test_generalised_maxwell_slip_agrees_with_event_driven_scipy_to_second_order():
    law, packed = pack("generalised_maxwell_slip")
    errors = []
    coarse, shape = motion(1e-2)  # the broken line; none of its corners lies on a reversal
    reference = gms_reference(coarse, shape, 20.0) + viscous(shape)
    for cut in (5, 20):
        fine = numpy.arange((coarse.size - 1) * cut + 1) * (1e-2 / cut)
        force = run_law(law, packed, numpy.interp(fine, coarse, shape), 1e-2 / cut)[::cut]
        errors.append(numpy.abs(force - reference)[1:].max())
    assert errors[0] < 5e-4
    assert errors[1] < errors[0] / 8.0


def test_hsieh_pan_agrees_with_scipy():
    law, packed = pack("hsieh_pan")

    def rhs(w, y):
        forces, p = y[:3], y[3]
        static = 1.0 if forces.sum() - 5.0 * p >= 0.0 else 0.9
        flow = 0.01 * numpy.sinh(6.0 * (forces.sum() - 5.0 * p) / static)
        stretch = w - flow
        limit = WEIGHT * (1.0 if stretch >= 0.0 else 0.9)
        slips = numpy.sign(stretch) * forces >= limit
        return [*numpy.where(slips, 0.0, STIFFNESS * stretch), flow]

    time, velocity = motion(1e-3)
    velocity = 0.1 * velocity
    states = integrate(rhs, numpy.zeros(4), time, lambda t: 0.1 * speed(t))
    force = run_law(law, packed, 0.1 * motion(2.5e-5)[1], 2.5e-5)[::40]
    assert force == pytest.approx(states[:, :3].sum(axis=1) + viscous(velocity), abs=2e-3)


def test_leuven_with_unequal_directions_agrees_with_scipy():
    law, packed = pack("leuven")

    def rate(w, force):
        ratio = numpy.sign(w) * force / curve(w)
        return 1.0 - numpy.sign(ratio) * abs(ratio) ** 2.5

    def rhs(w, y):
        stretch = w * rate(w, y.sum())
        slips = numpy.sign(stretch) * y >= WEIGHT * (1.0 if stretch >= 0.0 else 0.9)
        return numpy.where(slips, 0.0, STIFFNESS * stretch)

    time, velocity = motion(1e-3)
    velocity, errors = 0.3 * velocity, []
    states = integrate(rhs, numpy.zeros(3), time, lambda t: 0.3 * speed(t))
    damping = numpy.array([min(0.3, curve(w) / abs(w)) for w in velocity])
    force = states.sum(axis=1)
    reference = force + damping * velocity * rate_of(rate, velocity, force) + viscous(velocity)
    for cut in (1, 4):
        fine = 0.3 * motion(1e-3 / cut)[1]
        errors.append(numpy.abs(run_law(law, packed, fine, 1e-3 / cut)[::cut] - reference)[1:].max())
    assert errors[0] < 5e-3
    assert errors[1] < errors[0] / 4.0


def test_one_substep_of_leuven_in_settled_sliding_leaves_no_larger_error():
    """Beside 64 times finer steps on the same broken line: 0.0088, as with sixteen substeps everywhere; 0.013 where half of the
    limit counts as settled."""
    law, packed = pack("leuven", damping=0.0)
    rows = numpy.arange(201)
    coarse = 10.0 * numpy.sin(2 * numpy.pi * 5e-3 * rows)
    fine = numpy.interp(numpy.arange(64 * (rows.size - 1) + 1) / 64, rows, coarse)
    assert run_law(law, packed, coarse, 5e-3) == pytest.approx(run_law(law, packed, fine, 5e-3 / 64)[::64], abs=1e-2)


def rate_of(rate, velocity, force):
    """``rate`` along a record."""
    return numpy.array([rate(w, f) for w, f in zip(velocity, force, strict=True)])


class Stack:
    """Masing hysteresis with the two rules of memory, kept as a stack of open reversals (Leuven 2000)."""

    def __init__(self, limits):
        self.limits = limits  # Σ min(k z, limit) is the virgin curve
        self.z, self.reversals, self.heading = 0.0, [], 0.0

    def virgin(self, z):
        return numpy.sign(z) * numpy.minimum(STIFFNESS * abs(z), self.limits).sum()

    def force(self):
        if not self.reversals:
            return self.virgin(self.z)
        z, force = self.reversals[-1]
        return force + 2.0 * self.virgin(0.5 * (self.z - z))

    def move(self, dz):
        heading = numpy.sign(dz)
        if heading == 0.0:
            return
        if self.heading not in (0.0, heading):
            self.reversals.append((self.z, self.force()))
        self.heading = heading
        self.z += dz
        while len(self.reversals) >= 2 and heading * (self.z - self.reversals[-2][0]) >= 0.0:
            del self.reversals[-2:]  # the loop has closed: both its ends are forgotten
        if len(self.reversals) == 1 and heading * self.z >= abs(self.reversals[0][0]):
            self.reversals.clear()


def test_elements_remember_what_a_stack_of_reversals_remembers():
    law, packed = pack("maxwell_slip", static_negative=1.0, coulomb_negative=0.6, viscous=0.0, viscous_negative=0.0)
    stack, random = Stack(WEIGHT), numpy.random.default_rng(3)
    state = law.initial_state(packed)
    for step in random.normal(scale=0.02, size=400):
        stack.move(step)
        assert run_law(law, packed, numpy.full(2, step), 1.0, state=state)[1] == pytest.approx(stack.force(), abs=1e-12)


def test_leuven_agrees_with_a_stack_driven_by_its_rate_equation():
    law, packed = pack("leuven", static_negative=1.0, coulomb_negative=0.6, viscous=0.0, viscous_negative=0.0)
    time, velocity = motion(1e-3)
    velocity = 0.3 * velocity
    stack, reference, cut = Stack(WEIGHT), numpy.zeros(time.size), 50
    for i in range(1, time.size):
        for j in range(cut):
            w = velocity[i - 1] + (velocity[i] - velocity[i - 1]) * (j + 0.5) / cut
            stack.move(1e-3 / cut * w * leuven_rate(stack.force(), w))
        w = velocity[i]
        damping = min(0.3, curve(abs(w)) / abs(w))
        reference[i] = stack.force() + damping * w * leuven_rate(stack.force(), w)
    assert run_law(law, packed, velocity, 1e-3)[1:] == pytest.approx(reference[1:], abs=1e-3)


def leuven_rate(force, w):
    """dz / dx."""
    ratio = numpy.sign(w) * force / curve(abs(w))
    return 1.0 - numpy.sign(ratio) * abs(ratio) ** 2.5
