"""Errors of the replayed model itself that healthy axes show, as standard deviations of a form's sizes.

Measured on healthy records (three baselines of another simulator of the same axis, and simulated cases at
2, 4 and 6 % random friction): the scatter of each form's fitted size beyond its standard error.
"""

# calibrated by: the scatter that is told above, and validation.variation --group systematic (half and double: the same
# answers)
SYSTEMATIC: dict[str, dict] = {
    "command": {("generic:gain", ""): 0.15},
    "torque": {
        ("rising_static_friction", "0.03,3e-05"): 0.015,
        ("rising_static_friction", "0.2,2e-06"): 0.015,
        ("presliding_creep", "0.06,2e-08"): 1.5e-9,     # three times what was measured, by judgement
        ("frictional_lag", "0.003"): 0.04,
        ("nonlinear_viscous", "0.5"): 2.5e-7,
        ("direction_asymmetry", ""): 0.002,
        ("generic:acceleration", ""): 6.0e-6,
        ("payload_change", ""): 0.03,
        ("cable_spring", ""): (15.0, 1.0e-3),
    },
    "windup": {
        ("resistance_rise", "2"): (3.0e-4, 3.0e-3),
        ("amplifier_gain", ""): 5.0e-5,
        ("amplifier_offset", ""): 1.0e-5,
        ("screw_pitch_error", "1"): (2.0e-9, 2.0e-9, 6.0e-5),
        ("amplifier_deadband", "0.01"): 5.0e-6,
        ("backlash", "0.1"): 1.0e-9,
        ("drive_compliance", ""): 0.03,
    },
    "resonance": {
        ("drive_compliance", "0.8"): 0.1,
        ("drive_compliance", "1.25"): 0.1,
        ("drive_compliance", "0.51"): 0.03,
        ("drive_compliance", "2.44"): 0.05,
        ("payload_change", "1.25"): 0.1,
        ("payload_change", "1.97"): 0.03,
        ("payload_change", "0.64"): 0.05,
    },
}
