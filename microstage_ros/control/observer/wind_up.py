"""The planned wind-up of the drive train (compiled parts of `observer_law`).

The motor runs ahead of the stage by

    w = (F_g + m dv/dt) / K_c,      so that      motor speed = v + dw/dt,

with guideway friction F_g, mass m and stiffness K_c of the axis file along the reference (`feedforward`).

Where the reference or its acceleration steps, so does the plan: one count of the encoder in one period makes
millimetres per second of it. No drive train follows that, and a resistance would be learned from it. So a plan whose
back-EMF jumps by more than the voltage's doubt is not believed until the step has passed.
"""

from microstage_ros.numerics.compiled import compiled

JUMP = 4.0  # doubts in the voltage, as of a drive that has changed (`drive_learning.CHANGE_LIMIT`)
JUMP_PERIODS = 3  # for which a step of the reference lasts in its second difference, of which the acceleration is
FIELDS = [
    ("wind_up_speed", "f8"),  # m/s, of the motor beyond the stage's as the drive train is wound up
    ("wind_up_before", "f8"),  # m/s, in the period before
    ("wind_up_plan", "f8"),  # m/s, as the feed-forward plans it, jumps and all
    ("wind_up_wait", "i8"),  # periods for which a jump of the plan is not believed yet
]


@compiled
def wind_up_reset(s):
    """Nothing is planned."""
    s.wind_up_speed = 0.0
    s.wind_up_before = 0.0
    s.wind_up_plan = 0.0
    s.wind_up_wait = 0


@compiled
def plan_wind_up(model, s, speed):
    """Take over the planned ``speed`` dw/dt [m/s] of this period."""
    jump = model.volts_per_velocity * abs(speed - s.wind_up_plan)
    s.wind_up_plan = speed
    s.wind_up_wait = JUMP_PERIODS if jump > JUMP * s.voltage_noise else max(s.wind_up_wait - 1, 0)
    s.wind_up_speed = 0.0 if s.wind_up_wait > 0 else speed


@compiled
def wind_up_step(model, s):
    """Back-EMF [V] of what the speed taken over has changed by since the period before."""
    change = model.volts_per_velocity * abs(s.wind_up_speed - s.wind_up_before)
    s.wind_up_before = s.wind_up_speed
    return change
