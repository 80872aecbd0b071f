"""The experiment that tells rivals apart: segments of a run file for what each effect needs to show itself."""

SCANS = [{"scan": {"to_m": 6.0e-3, "speed_m_s": v}} if far else {"scan": {"to_m": 0.0, "speed_m_s": v}}
         for v in (1.0e-4, 5.0e-4, 2.0e-3) for far in (True, False)]
SLOW_SCANS = [{"scan": {"to_m": 3.0e-3, "speed_m_s": 2.0e-4}}, {"scan": {"to_m": 0.0, "speed_m_s": 2.0e-4}}] * 3
FAST_SINES = [{"sine": {"amplitude_m": 2.0e-4, "frequency_hz": f, "cycles": 10}} for f in (0.5, 2.0, 5.0)]
DWELLS = [{"move_to_m": 2.0e-5 * (n % 2), "dwell_s": t} for n, t in enumerate((0.05, 0.2, 1.0, 5.0, 20.0, 0.05))]
REVERSALS = [{"sine": {"amplitude_m": a, "frequency_hz": 0.2, "cycles": 4}} for a in (2.0e-6, 2.0e-5, 2.0e-4)]
REST = [{"move_to_m": 0.0, "dwell_s": 20.0}]

NEEDS = {
    "direction_asymmetry": SCANS, "position_dependent_friction": SLOW_SCANS, "rising_static_friction": DWELLS,
    "frictional_lag": FAST_SINES, "presliding_creep": DWELLS, "viscous_change": SCANS, "nonlinear_viscous": SCANS,
    "friction_level_change": SCANS, "backlash": REVERSALS, "drive_compliance": FAST_SINES,
    "screw_pitch_error": SCANS, "torque_ripple": SLOW_SCANS, "payload_change": REVERSALS + FAST_SINES,
    "gravity_tilt": SCANS + REST, "cable_spring": SLOW_SCANS, "amplifier_offset": REST, "amplifier_gain": SCANS,
    "amplifier_deadband": REVERSALS, "resistance_rise": REST + SCANS, "transport_delay": FAST_SINES,
    "actuator_lag": FAST_SINES, "sampling_jitter": SCANS, "encoder_sde": SLOW_SCANS, "scale_error": SLOW_SCANS,
    "thermal_drift": REST * 3, "refractive_index": REST * 3, "floor_vibration": REST,
}


def experiment_for(ids):
    """Run file (a mapping) whose program shows the difference between these effects; nothing twice."""
    program = []
    for effect in ids:
        program += [segment for segment in NEEDS.get(effect, SCANS) if segment not in program]
    return {"period_s": 1.0e-4, "controller": {"type": "pid"}, "program": [dict(segment) for segment in program]}
