"""Every effect of the catalogue shows where its catalogue entry says it does."""

import numpy as np
import pytest

from microstage_ros.control.runs.run_file import NOISES, run_from_dict
from microstage_ros.control.runs.simulate import simulate
from microstage_ros.model.effects import REGISTRY, effects_of
from microstage_ros.model.sensors.readings import read_sensors
from microstage_ros.solver.open_loop import respond
from microstage_ros.solver.plant import new_readings, new_state

PERIOD = 1e-4
KM, R, KE, LEAD = 6.59e-3, 3.41, 6.589014636e-3, 2e-3 / (2 * np.pi) / 19


def steady(quiet, volts, seconds=0.4, **effects):
    """Mean of the last quarter of a constant-voltage run, by column."""
    r = respond(quiet(**effects), np.full(int(seconds / PERIOD), float(volts)))
    return {name: column[-len(column) // 4:].mean() for name, column in r.items()}


def sliding_friction(quiet, volts, **effects):
    """Torque at the motor that friction of both contacts takes in steady sliding."""
    return steady(quiet, volts, **effects)["torque_friction"]


def test_catalogue_is_complete(axis):
    assert set(effects_of(axis)) == set("""direction_asymmetry position_dependent_friction rising_static_friction frictional_lag
        presliding_creep viscous_change nonlinear_viscous friction_level_change backlash drive_compliance
        screw_pitch_error torque_ripple payload_change gravity_tilt cable_spring amplifier_offset amplifier_deadband
        amplifier_gain resistance_rise transport_delay actuator_lag sampling_jitter encoder_sde scale_error
        thermal_drift refractive_index floor_vibration""".split())
    assert all(len(effect.__doc__) > 40 for effect in REGISTRY.values())


def test_direction_asymmetry_keeps_its_sign_only_while_sliding(quiet):
    e = {"direction_asymmetry": {"asymmetry": 0.1}}
    limits = []
    for volts in (2, -2):
        end = steady(quiet, volts, **e)
        limits.append(end["torque_friction"] - 10.51e-6 * end["omega"] / 19)
    assert limits == pytest.approx([1.1 * 125.6e-6, -0.9 * 125.6e-6], rel=2e-3)
    assert abs(respond(quiet(**e), np.zeros(200))["x"][-1]) < 1e-15        # m: the last bits of the first state


def test_asymmetry_of_the_guideway_and_of_viscous_friction(quiet):
    guide = {"direction_asymmetry": {"contact": "guideway", "asymmetry": 0.2}}
    ends = [steady(quiet, volts, **guide) for volts in (2, -2)]
    assert [end["guide_friction"] - 20.0 * end["v"] for end in ends] == pytest.approx([1.2 * 0.9, -0.8 * 0.9], rel=1e-6)
    thick = {"direction_asymmetry": {"asymmetry": 0.0, "viscous_asymmetry": 0.3}}
    for volts in (2, -2):
        end = steady(quiet, volts, **thick)
        extra = KM * end["current"] - end["torque_friction"] - LEAD * end["guide_friction"]
        assert extra == pytest.approx(0.3 * 10.51e-6 * abs(end["omega"]) / 19, rel=1e-3)        # no flip


def test_position_dependent_friction_is_a_function_of_position_and_flips(quiet):
    e = {"position_dependent_friction": {"amplitude": 0.2, "period_m": 1e-3, "phase_rad": 0.5}}
    for volts in (2.0, -2.0):
        with_it, without = (respond(quiet(**f), np.full(4000, volts)) for f in (e, {}))
        x, extra = with_it["x"][2000:], (with_it["torque_friction"] - np.interp(np.arange(4000), np.arange(4000), without["torque_friction"]))[2000:]
        model = np.sign(volts) * 0.2 * 125.6e-6 * np.sin(2 * np.pi * x / 1e-3 + 0.5)
        assert np.corrcoef(extra, model)[0, 1] > 0.97 and np.polyfit(model, extra, 1)[0] == pytest.approx(1.0, abs=0.1)


def test_position_dependent_friction_as_a_table(quiet):
    e = {"position_dependent_friction": {"positions_m": [0.0, 1e-3, 2e-3, 3e-3], "factors": [1.0, 1.3, 0.8, 1.0]}}
    r = respond(quiet(**e), np.full(6000, 1.5))
    at = lambda x: np.interp(x, r["x"], r["torque_friction"])
    plain = sliding_friction(quiet, 1.5)
    assert at(1e-3) - plain == pytest.approx(0.3 * 125.6e-6, rel=0.15) and at(2e-3) - plain == pytest.approx(-0.2 * 125.6e-6, rel=0.2)


def breakaway(plant, dwell):
    """Voltage at which the axis lets go on a ramp after a dwell under a load of a third of it."""
    ramp = np.concatenate([np.full(int(dwell / PERIOD), 0.05), 0.05 + np.arange(2500) * PERIOD])
    r = respond(plant, ramp)
    return ramp[np.argmax(np.abs(r["v"]) > 1e-4)]


def test_rising_static_friction_grows_with_log_dwell(quiet):
    e = {"rising_static_friction": {"rate_per_decade": 0.1, "dwell_scale_s": 0.01, "release_m": 3e-5}}
    rise = [breakaway(quiet(**e), d) / breakaway(quiet(), d) - 1 for d in (0.1, 1.0, 5.0)]
    assert rise[0] < rise[1] < rise[2]
    # the ramp adds 0.1 s of dwell, and the axis creeps down the Stribeck curve before it lets go
    expected = 0.1 * np.log10(5.1 / 0.2)
    assert 0.5 * expected < rise[2] - rise[0] < 1.1 * expected


def test_frictional_lag_opens_a_loop_that_grows_with_frequency(quiet):
    def loop(frequency, **e):
        t = np.arange(int(3 / frequency / PERIOD)) * PERIOD
        r = respond(quiet(**e), 0.6 + 0.25 * np.sin(2 * np.pi * frequency * t))
        last = slice(-int(1 / frequency / PERIOD), None)
        w, f = r["omega"][last] / 19, r["torque_friction"][last] - 10.51e-6 * r["omega"][last] / 19
        return abs(np.sum(f * np.gradient(w)))
    e = {"frictional_lag": {"time_s": 3e-3}}
    assert loop(10, **e) > 3 * loop(10) and loop(10, **e) > 1.5 * loop(2, **e)


def test_presliding_creep_drifts_with_log_time_under_constant_load(quiet):
    e = {"presliding_creep": {"amplitude_m": 2e-9, "time_s": 0.05}}
    hold = np.full(100000, 0.06)
    x = respond(quiet(**e), hold)["x"]
    still = respond(quiet(), hold)["x"]
    assert abs(still[99999] - still[9000]) < 1e-11
    first, second = x[29999] - x[9000], x[99999] - x[29999]
    assert first > 5e-10 and second == pytest.approx(first, rel=0.3)      # per factor of 3.3 in time, not per second


def test_viscous_change_is_proportional_to_velocity(quiet):
    e = {"viscous_change": {"factor": 3.0}}
    for volts in (1.0, 3.0):
        w = steady(quiet, volts, **e)["omega"] / 19
        drop = 93.4e-6 * np.exp(-((w / 0.18) ** 0.9))
        assert sliding_friction(quiet, volts, **e) == pytest.approx(125.6e-6 + drop + 3 * 10.51e-6 * w, rel=1e-3)


def test_nonlinear_viscous_is_curved_in_velocity(quiet):
    e = {"nonlinear_viscous": {"coefficient": 2e-6, "exponent": 2.0}}
    for volts in (1.5, -3.0):
        end = steady(quiet, volts, 0.6, **e)
        w = end["omega"] / 19
        extra = KM * end["current"] - end["torque_friction"] - LEAD * end["guide_friction"]
        assert extra == pytest.approx(2e-6 * w * abs(w), rel=0.01)


def test_nonlinear_viscous_may_end_with_speed(quiet):
    film = {"nonlinear_viscous": {"coefficient": 3e-5, "exponent": 1.0, "saturation_speed": 2.0}}
    for volts in (1.5, -3.0):
        end = steady(quiet, volts, 0.6, **film)
        w = end["omega"] / 19
        extra = KM * end["current"] - end["torque_friction"] - LEAD * end["guide_friction"]
        assert extra == pytest.approx(np.sign(w) * 3e-5 * 2.0 * (1 - np.exp(-abs(w) / 2.0)), rel=0.01)


def test_friction_level_change_keeps_the_shape(quiet):
    e = {"friction_level_change": {"factor": 1.4}}
    for volts in (1.0, 3.0):
        w = steady(quiet, volts, **e)["omega"] / 19
        drop = 93.4e-6 * np.exp(-((w / 0.18) ** 0.9))
        assert sliding_friction(quiet, volts, **e) == pytest.approx(1.4 * (125.6e-6 + drop + 10.51e-6 * w), rel=1e-3)
    scaled = respond(quiet(friction_level_change={"factor": 1.4, "contact": "actuator"}), np.full(2000, 0.07))
    assert abs(scaled["x"][-1]) < abs(respond(quiet(), np.full(2000, 0.07))["x"][-1])


def test_backlash_moves_the_motor_and_not_the_stage_after_reversal_only(quiet):
    width = 0.01
    volts = np.concatenate([np.full(2000, 1.0), np.full(2000, -1.0)])
    r = respond(quiet(backlash={"width_rad": width}), volts)
    lost = LEAD * r["theta"] - r["x"]
    b = 2e-3 / (2 * np.pi) * width
    assert lost[1900] == pytest.approx(b / 2, rel=0.1) and lost[3900] == pytest.approx(-b / 2, rel=0.1)
    assert np.ptp(lost[1500:1990]) < 0.05 * b


def resonance(plant):
    """Spectral line of the drive train after a kick, without friction blocks."""
    plant["guideway"]["blocks"] = 0
    plant["actuator"]["blocks"] = 0
    r = respond(plant, np.where(np.arange(4096) < 5, 3.0, 0.0))
    windup = LEAD * r["theta"] - r["x"]
    spectrum = np.abs(np.fft.rfft(windup - windup.mean()))
    return np.argmax(spectrum[20:]) + 20


def test_drive_compliance_winds_up_with_the_load_and_lowers_the_resonance(quiet):
    soft = {"drive_compliance": {"stiffness_factor": 0.25, "damping_factor": 0.5}}
    assert resonance(quiet(**soft)) == pytest.approx(0.5 * resonance(quiet()), rel=0.1)
    for angle in (0.05, 0.1, -0.1):
        end = steady(quiet, 1.0, drive_compliance={"stiffness_factor": 0.25}, gravity_tilt={"angle_rad": angle})
        load = end["guide_friction"] + 3.06 * 9.80665 * np.sin(angle)
        assert LEAD * end["theta"] - end["x"] == pytest.approx(load / (0.25 * 1.2e7), rel=1e-3)


def test_screw_pitch_error_shows_between_motor_angle_and_position(quiet):
    e = {"screw_pitch_error": {"amplitude_m": 1e-6, "phase_rad": 0.3, "cumulative": 1e-4}}
    r = respond(quiet(**e), np.full(8000, 1.0))
    phi = r["theta"] / 19
    error = (r["x"] - LEAD * r["theta"])[1000:]
    model = (1e-6 * np.sin(phi + 0.3) + 1e-4 * LEAD * r["theta"])[1000:] - 0.95 / 1.2e7      # less the wind-up
    assert np.max(np.abs(error - model)) < 2e-8


def test_screw_pitch_error_is_a_ripple_of_u_that_grows_with_speed(axis):
    """Without a motor angle: at constant speed v of the stage the motor's varies by A/r of it, and u by K_E times that."""
    def ripple(speed, effects):
        tree = {"effects": effects, "noise": dict.fromkeys(NOISES, 0.0), "program": [{"scan": {"to_m": 7e-3, "speed_m_s": speed}}]}
        columns = simulate(axis, run_from_dict(tree), 0)
        x, u = columns["encoder_m"], columns["voltage_V"]
        turn = (x > 3e-3) & (x < 5e-3)
        return 2 * abs(np.mean(u[turn] * np.exp(2j * np.pi * x[turn] / 2e-3)))

    r = 2e-3 / (2 * np.pi)
    slow, fast = (ripple(v, {"screw_pitch_error": {"amplitude_m": 1e-5}}) for v in (5e-4, 1.5e-3))
    assert [slow, fast] == pytest.approx([KE * v / LEAD * 1e-5 / r for v in (5e-4, 1.5e-3)], rel=0.1)
    friction = {"position_dependent_friction": {"amplitude": 0.1, "period_m": 2e-3}}
    assert ripple(1.5e-3, friction) == pytest.approx(ripple(5e-4, friction), rel=0.1)


def test_torque_ripple_has_the_period_of_a_motor_turn_and_does_not_flip(quiet):
    e = {"torque_ripple": {"amplitude_Nm": 10e-6, "cycles_per_turn": 2.0, "phase_rad": 0.0}}
    for volts in (1.0, -1.0):
        r = respond(quiet(**e), np.full(6000, volts))
        moving = slice(3000, None)
        inertia = 1e-7 * np.gradient(r["omega"], PERIOD)
        left = (KM * r["current"] - inertia - r["torque_friction"] - LEAD * (r["guide_friction"] + 3.06 * np.gradient(r["v"], PERIOD)))[moving]
        model = -10e-6 * np.sin(2 * r["theta"][moving])
        assert np.polyfit(model, left, 1)[0] == pytest.approx(1.0, abs=0.1)


def test_payload_change_scales_guideway_friction(quiet):
    assert steady(quiet, 1.0, payload_change={"mass_kg": 3.06})["guide_friction"] == pytest.approx(
        2 * steady(quiet, 1.0)["guide_friction"], rel=0.01)


def test_payload_change_lowers_the_resonance_and_leaves_the_run_up(quiet):
    e = {"payload_change": {"mass_kg": 3.06}}
    assert resonance(quiet(**e)) == pytest.approx(resonance(quiet()) / np.sqrt(2.0), rel=0.1)
    plain, loaded = quiet(), quiet(**e)
    for plant in (plain, loaded):
        plant["guideway"]["blocks"] = plant["actuator"]["blocks"] = 0
    # mean over the first 6 ms, which the drive train's ringing leaves out; the added inertia's share of the rotor's is the most
    slower = 1 - np.mean(respond(loaded, np.full(60, 3.0))["omega"]) / np.mean(respond(plain, np.full(60, 3.0))["omega"])
    assert 0 < slower < 3.06 * LEAD**2 / 1e-7 < 0.01


def stage_force(quiet, volts, **effects):
    end = steady(quiet, volts, 0.5, **effects)
    return (KM * end["current"] - end["torque_friction"]) / LEAD - end["guide_friction"]


def test_gravity_tilt_is_a_constant_force_that_does_not_flip(quiet):
    e = {"gravity_tilt": {"angle_rad": 0.02}}
    weight = 3.06 * 9.80665 * np.sin(0.02)
    assert [stage_force(quiet, s, **e) for s in (2, -2)] == pytest.approx([weight, weight], rel=1e-2)
    assert respond(quiet(**e), np.zeros(3000))["x"][-1] < -1e-9          # there at rest too


def test_cable_spring_is_linear_in_position(quiet):
    for volts in (1.0, -1.0):                      # the same line in both directions
        r = respond(quiet(cable_spring={"stiffness_N_m": 500.0, "anchor_m": 1e-3}), np.full(8000, volts))
        tail = slice(4000, None, 50)
        force = (KM * r["current"] - r["torque_friction"])[tail] / LEAD - r["guide_friction"][tail]
        slope, offset = np.polyfit(r["x"][tail], force, 1)
        assert slope == pytest.approx(500, rel=0.05) and -offset / slope == pytest.approx(1e-3, abs=1e-4)


def test_amplifier_offset_is_a_constant_voltage(quiet):
    for volts in (1.0, -1.0):
        plain, shifted = steady(quiet, volts + 0.2), steady(quiet, volts, amplifier_offset={"offset_V": 0.2})
        assert shifted["omega"] == pytest.approx(plain["omega"], rel=1e-9)


def test_amplifier_deadband_leaves_no_current_near_zero(quiet):
    e = {"amplifier_deadband": {"half_width_V": 0.05}}
    assert np.all(np.abs(respond(quiet(**e), np.full(100, 0.049))["current"]) < 1e-12)      # A
    assert steady(quiet, 1.05, **e)["omega"] == pytest.approx(steady(quiet, 1.0)["omega"], rel=1e-9)


def test_amplifier_gain_scales_u(quiet):
    assert steady(quiet, 1.0, amplifier_gain={"factor": 1.1})["omega"] == pytest.approx(steady(quiet, 1.1)["omega"], rel=1e-9)


def test_resistance_rise_falls_and_recovers(quiet):
    e = {"resistance_rise": {"rise_per_joule": 20.0, "time_s": 1.0}}
    volts = np.concatenate([np.full(10000, 3.0), np.zeros(20000), np.full(1000, 3.0)])
    r = respond(quiet(**e), volts)
    felt = lambda n: (volts[n] - KE * r["omega"][n]) / r["current"][n] / R - 1
    heat, h = np.zeros(len(volts)), PERIOD
    for n in range(len(volts) - 1):
        heat[n + 1] = heat[n] + h * (20.0 * R * (1 + heat[n]) * r["current"][n] ** 2 - heat[n])
    for n in (100, 9990, 30005, 30900):
        assert felt(n) == pytest.approx(heat[n], rel=0.05)
    assert felt(9990) > 0.2 and felt(30005) < 0.4 * felt(9990)


def test_transport_delay_moves_the_current_in_time(quiet):
    kick = np.where(np.arange(60) >= 20, 1.0, 0.0)
    plain = respond(quiet(), kick)["current"]
    late = respond(quiet(transport_delay={"delay_s": 3e-4}), kick)["current"]
    assert np.allclose(late[3:], plain[:-3], rtol=1e-9, atol=1e-12)
    split = respond(quiet(transport_delay={"delay_s": 2.3e-4}), kick)["current"]
    rise = 1.0 / R * (1 - np.exp(-0.7 * PERIOD * R / 75e-6))       # of the 70 µs that are left; the motor has hardly turned
    assert np.all(np.abs(split[:23]) < 1e-12) and split[23] == pytest.approx(rise, rel=0.01)


def test_actuator_lag_follows_an_exponential(quiet):
    r = respond(quiet(actuator_lag={"time_s": 1e-3}), np.full(60, 0.05))
    t = np.arange(60) * PERIOD
    assert np.max(np.abs(R * r["current"] + KE * r["omega"] - 0.05 * (1 - np.exp(-t / 1e-3)))[5:]) < 2e-3


def readings_of(plant, moments, position=0.0, speed=0.0):
    """Arrays of readings of an axis put at given times, positions and speeds."""
    state, readings, rows = new_state(plant, 3), new_readings(), []
    for n, t in enumerate(moments):
        state["time"], state["periods"] = t, n
        state["x"] = position[n] if np.ndim(position) else position
        state["v"] = speed
        read_sensors(plant, state, readings)
        rows.append(readings.copy())
    return {name: np.array([row[name] for row in rows]) for name in rows[0].dtype.names}


def test_sampling_jitter_errs_in_proportion_to_velocity(quiet):
    plant = quiet(sampling_jitter={"late_s": 2e-5, "jitter_s": 1e-5, "lost_fraction": 0.0})
    spread = []
    for v in (1e-3, 2e-3):
        error = readings_of(plant, np.zeros(2000), 0.0, v)["encoder"]
        assert error.mean() == pytest.approx(v * (2e-5 + 1e-5 * np.sqrt(2 / np.pi)), rel=0.05)
        spread.append(error.std())
    assert spread[1] == pytest.approx(2 * spread[0], rel=0.1)


def test_lost_samples_repeat_the_one_before(quiet):
    plant = quiet(sampling_jitter={"lost_fraction": 0.1})
    y = readings_of(plant, np.zeros(3000), np.arange(3000) * 1e-7)["encoder"]
    assert np.mean(np.diff(y) == 0.0) == pytest.approx(0.1, abs=0.03)


def test_encoder_sde_is_periodic_in_position(quiet):
    plant = quiet(encoder_sde={"period_m": 1e-5, "amplitude1_m": 2e-8, "phase1_rad": 0.4, "amplitude2_m": 1e-8})
    x = np.linspace(0, 3e-5, 301)
    y = readings_of(plant, np.zeros(301), x)["encoder"] - x
    a = 2 * np.pi * x / 1e-5
    assert np.allclose(y, 2e-8 * np.sin(a + 0.4) + 1e-8 * np.sin(2 * a), atol=1e-15)


def test_scale_error_is_linear_in_position(quiet):
    x = np.linspace(-0.02, 0.02, 50)
    r = readings_of(quiet(scale_error={"relative": 5e-6}), np.zeros(50), x)
    assert np.polyfit(x, r["interferometer"] - r["encoder"], 1)[0] == pytest.approx(5e-6, rel=1e-6)


def test_thermal_drift_drifts_in_time(quiet):
    plant = quiet(thermal_drift={"amplitude_m": 1e-7, "time_s": 5.0, "expansion_m_K": 1e-7, "temperature_rise_K": 0.5})
    t = np.linspace(0, 30, 40)
    r = readings_of(plant, t)
    rise = r["stage_temperature"] - 293.15
    assert rise[-1] == pytest.approx(0.5 * (1 - np.exp(-3)), rel=1e-6)
    assert np.allclose(r["interferometer"] - r["encoder"], 1e-7 * (1 - np.exp(-t / 5)) + 1e-7 * rise, atol=1e-15)


def test_refractive_index_follows_pressure_and_temperature(quiet):
    plant = quiet(refractive_index={"path_m": 0.2, "pressure_rate_Pa_s": 2.0, "temperature_swing_K": 0.1, "swing_time_s": 7.0})
    r = readings_of(plant, np.linspace(0, 20, 50))
    index = -0.93e-6 * (r["air_temperature"] - 293.15) + 2.7e-9 * (r["air_pressure"] - 101325)
    assert np.ptp(index) > 1e-8 and np.allclose(r["interferometer"], 0.2 * index, atol=1e-15)


def test_floor_vibration_gives_lines_at_rest(quiet):
    plant = quiet(floor_vibration={"frequencies_hz": [30.0, 80.0], "amplitudes_m": [2e-8, 1e-8]})
    r = readings_of(plant, np.arange(10000) * PERIOD)
    for column in ("encoder", "interferometer"):
        lines = np.abs(np.fft.rfft(r[column])) * 2 / 10000
        assert lines[30] == pytest.approx(2e-8, rel=1e-3) and lines[80] == pytest.approx(1e-8, rel=1e-3)
        assert np.sort(lines)[-3] < 1e-12
