"""The memory layout that the compiled step works on: one plain record per machine and per state.

Numpy structured scalars, so that a thousand axes are one array and nothing is boxed.
"""

import numpy as np

BLOCKS = 8        # most Maxwell-slip blocks of a contact
PROFILE = 1024    # cells of a friction profile over position
OCTAVES = 30      # Stribeck table: octaves of |w/V|, from 2^-18 on
CELLS = 16        # and cells per octave
RIPPLES = 6       # most periodic terms of one kind
LINES = 6         # most vibration lines
SENSOR = 16       # most numbers of a position sensor's own, and of its state
DRIVE = 40        # most numbers of an actuator's own, and of its state
LAW = 40          # most entries of a packed law of the library, and of its state
DELAY = 64        # most whole periods of delay
EXTRAS, EXTRA = 4, 8    # most effects with a force of their own, and most parameters of each

LEVELS = 11      # chunks of a period: level 0 is the whole period, level 10 is T/1024
SLOTS = 64        # modes (combinations of sticking blocks) whose matrices are kept
INPUTS, OUTPUTS = 9, 8     # columns and rows of a mode's matrix, see `linear_core`

f8, i8, u8 = np.float64, np.int64, np.uint64

#: One friction contact. Forces are normalised: f_j = F_j / α_j, so every block slips at f = s(w).
CONTACT = np.dtype([
    ("blocks", i8),                # number of blocks, 0: no block friction
    ("law", i8), ("law_parameters", f8, LAW),  # another law of the library: its number + 1, packed; 0: none
    ("kappa", f8, BLOCKS),         # k_j / α_j, normalised stiffness per unit of contact coordinate
    ("weight", f8, BLOCKS),        # α_j
    ("static", f8), ("coulomb", f8), ("velocity", f8), ("exponent", f8),
    ("drops", i8),                 # 1: the limit falls with velocity (Stribeck)
    ("attraction", f8),            # C; inf: a slipping block is at its limit at once
    ("smooth_slip", i8),           # 1: C is finite and s does not lag, see `slip.near`
    ("viscous", f8),
    ("stick_damping", f8),         # damping of the bristle while all blocks stick (regularised Coulomb)
    ("level", f8),                 # factor on the limits
    ("asymmetry", f8),             # limits × (1 + asymmetry sgn w)
    ("viscous_asymmetry", f8),     # viscous × (1 + viscous_asymmetry sgn w)
    ("quadratic", f8), ("power", f8),          # extra force quadratic · |w|^power · sgn w
    ("saturation", f8),            # the |w| of that force ends at this speed; 0: it does not end
    ("follows", i8),               # 1: something of it follows the velocity after each chunk, see `step._follow`
    ("lag", f8),                   # s follows |w| with this time constant
    ("aging_rate", f8), ("aging_time", f8), ("aging_release", f8),
    ("creep_amplitude", f8), ("creep_time", f8), ("creep_release", f8),
    ("random", f8),                # standard deviation of q
    ("profile", f8, PROFILE + 1), ("profiled", i8),          # limits × profile(x), linear between cells
    ("profile_low", f8), ("profile_high", f8),              # its range of stage positions
    ("ripple_amplitude", f8, RIPPLES), ("ripple_number", f8, RIPPLES), ("ripple_phase", f8, RIPPLES),
    ("ripples", i8),               # limits × (1 + Σ A sin(number x + phase))
    # cubic pieces of s(w) and 1/s(w), see `contact.sliding_table`
    ("first_cell", i8), ("sliding", f8, (OCTAVES * CELLS, 8)),
])

#: One machine.
PLANT = np.dtype([
    ("period", f8), ("rate", f8), ("ratio", f8),             # ratio r/N: metres per motor radian
    ("screw_ratio", f8), ("gear", f8), ("per_gear", f8),        # r, N, 1/N
    ("rigid", i8), ("winding", i8),            # winding: 1: a winding whose resistance and current are given
    ("gain", f8),                              # command to the amplifier's output
    ("limit", f8), ("quantum", f8), ("per_quantum", f8), ("dac_range", f8),
    ("resistance", f8), ("inductance", f8), ("back_emf", f8), ("torque_constant", f8), ("inertia", f8),
    ("electrical_input", f8), ("direct", f8), ("motor_damping", f8),       # b, g, D of `model.actuators.actuator`
    ("stiffness", f8), ("damping", f8), ("mass", f8),
    ("actuator", CONTACT), ("guideway", CONTACT),
    # effects
    ("base_level", i8),                        # coarsest chunk 2^-level of a period
    ("amplifier_offset", f8), ("dead_half", f8), ("amplifier_noise", f8),
    ("delay", f8), ("actuator_lag", f8),
    ("rise_per_joule", f8), ("rise_time", f8), ("rise_initial", f8),
    ("gap", f8),                               # lost motion at the stage, r · width [m]
    ("lead_amplitude", f8, RIPPLES), ("lead_number", f8, RIPPLES), ("lead_phase", f8, RIPPLES), ("leads", i8),
    ("lead_slope", f8),                        # cumulative error, relative
    ("cog_amplitude", f8, RIPPLES), ("cog_number", f8, RIPPLES), ("cog_phase", f8, RIPPLES), ("cogs", i8),
    ("push", f8), ("cable", f8), ("anchor", f8),
    # forces of effects of their own, see `effects.WITH_FORCE`
    ("extra", f8, (EXTRAS, EXTRA)), ("extra_on", i8, EXTRAS),
    ("smooth", i8),                            # 1: a smooth extra force acts on the stage or the motor
    ("simple", i8),                            # 1: a period may be one chunk under one voltage
    ("plain", i8),                             # 1: no extra force and no backlash
    ("quick", i8),                             # 1: simple and plain, and the contacts need nothing beyond `slip.near`
    ("modulated", i8),                         # 1: a limit factor depends on position or dwell, or blocks creep
    ("varies", i8),                            # 1: modulated, or the friction is random
    ("electrical", i8),                        # 1: dead zone, delay, lag, warming or amplifier noise
    # random friction
    ("random_length", f8), ("random_time", f8), ("random_share", f8), ("random_clip", f8),
    # √share of the travel's part, √(1 − share) of the time's
    ("random_share_root", f8), ("random_rest_root", f8),
    ("random_travel_step", f8), ("random_time_step", f8),       # travel and time after which q is advanced
    # sensors
    ("encoder_count", f8), ("per_count", f8), ("encoder_noise", f8), ("current_noise", f8),
    ("interferometer_noise", f8),
    # 1: the encoder has an error of interpolation of its own
    ("interpolates", i8), ("signal_number", f8), ("signals_per_metre", f8), ("interpolation", f8, 2),
    ("senses_current", i8),                    # 1: the current's sensor is not ideal, see `readings.sensed_current`
    ("current_filter", f8, 3), ("current_sample", f8, 3),
    ("current_offset", f8), ("current_range", f8), ("current_quantum", f8), ("per_current_quantum", f8),
    # number of the position's sensor, its own numbers
    ("position_sensor", i8), ("sensor_parameters", f8, SENSOR),
    ("late", f8), ("jitter", f8), ("lost", f8),
    ("sde_number", f8), ("sde_amplitude", f8, 3), ("sde_phase", f8, 3), ("scale", f8),
    ("drift_amplitude", f8), ("drift_time", f8), ("drift_rate", f8), ("drift_expansion", f8),
    ("air_path", f8), ("air_temperature_rate", f8), ("air_pressure_rate", f8),
    ("air_temperature_swing", f8), ("air_pressure_swing", f8), ("air_swing_time", f8), ("air_compensated", i8),
    ("line_frequency", f8, LINES), ("line_amplitude", f8, LINES), ("line_phase", f8, LINES), ("lines", i8),
    ("stage_temperature_rise", f8), ("stage_temperature_time", f8),
    ("sensing", i8),                           # 1: an effect acts on what the sensors say
    # actuator: its number, whether it shapes the command and pulls with a torque that is not linear, its own numbers
    ("drive", i8), ("shaped", i8), ("pulls", i8), ("drive_parameters", f8, DRIVE),
    # spring and damper between stage and ground [N/m, N s/m], zero force at x = 0
    ("flexure", f8), ("flexure_damping", f8),
])

#: State of one contact.
CONTACT_STATE = np.dtype([
    ("force", f8, BLOCKS),         # f_j of sticking blocks; of slipping ones the offset from `slip_force`
    ("stuck", f8, BLOCKS),         # 1 sticks, 0 slips
    ("stuck_weight_force", f8),    # Σ α_j f_j over sticking blocks, the sum of their forces, without the stretch
    ("stuck_stiffness", f8),       # Σ k_j over sticking blocks
    ("slip_weight", f8),           # Σ α_j over slipping blocks
    ("slip_force", f8),            # their common normalised force, sign removed
    ("slip_offset", f8),           # decay of the offsets since they were set
    ("direction", f8),             # sign of the slip
    ("slip_change", f8),           # df/dt · T over the last chunk in slip, to start the next from
    ("law_state", f8, LAW), ("law_force", f8), ("law_before", f8), # of another law: state, force now and a chunk ago
    ("mask", i8),                  # bit j: block j sticks
    ("stretch", f8),               # travel not yet added to the sticking blocks' forces
    # stretch that brings no sticking block to its limit below this speed, while the limit factor is no smaller than
    # this
    ("ahead", f8), ("behind", f8), ("guard", f8), ("least_factor", f8),
    ("factor", f8),                # limit factor of this period
    ("q_travel", f8), ("q_time", f8), ("q", f8),
    ("lagged", f8),                # |w| seen by s when it lags
    ("dwell", f8), ("aged", f8), ("held", f8),
])

#: State of one machine.
STATE = np.dtype([
    ("current", f8), ("omega", f8), ("theta", f8), ("v", f8), ("x", f8),
    ("actuator", CONTACT_STATE), ("guideway", CONTACT_STATE),
    ("side", i8),                  # backlash: +1, −1 contact, 0 in the gap
    ("torque_friction", f8), ("guide_friction", f8),   # at the last end of a period [N m at the motor, N]
    ("voltage", f8),               # amplifier output at the end of the period
    ("pending", f8, DELAY), ("pending_at", i8),
    ("lagged_voltage", f8), ("heat", f8), ("resistance_now", f8),
    ("time", f8), ("periods", i8),
    ("random_travel", f8), ("random_wait", f8),        # since the random friction's last steps
    ("last_encoder", f8), ("last_current", f8),
    ("filtered_current", f8), ("current_before", f8),  # of the current's sensor, at the period before
    ("random", u8, 4),
    ("constant_change", f8),       # force constant and back-EMF over nominal, less 1
    ("drive", f8, DRIVE), ("sensor", f8, SENSOR),          # of the actuator, of the position's sensor
])

#: What the sensors say at the start of a period.
READINGS = np.dtype([
    ("encoder", f8), ("current", f8), ("motor_angle", f8), ("interferometer", f8),
    ("stage_temperature", f8), ("air_temperature", f8), ("air_pressure", f8), ("air_humidity", f8),
])

#: Work space of one thread: the mode matrices of one plant, and how far the last event's chunk went.
_MATRICES = [("matrix", f8, (SLOTS, LEVELS, INPUTS, OUTPUTS))]
_MODES = [("key", i8, SLOTS), ("slot", i8), ("resistance", f8), ("constant_change", f8), ("turned", f8), ("moved", f8)]
WORK = np.dtype(_MATRICES + _MODES)
#: The same for plants with a contact law that is not made of blocks: its type says that such laws are compiled in.
#: (Not at the end: numba takes a longer record for its beginning.)
LAW_WORK = np.dtype([*_MATRICES, ("any_law", i8), *_MODES])
