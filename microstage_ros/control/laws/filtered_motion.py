"""Error and velocities of a period, as control laws of the literature take them from the encoder alone.

Derived: the low-pass τ dv/dt = dx/dt − v by backward Euler over a period T.
"""

from microstage_ros.numerics.compiled import compiled


@compiled
def filtered_motion(motion, period, filter_time, reference, encoder):
    """Error e = r − x [m], speed of the reference and filtered speed of the encoder [m/s], into ``motion``.

    v_k = v_{k−1} + T / (T + τ) ((x_k − x_{k−1}) / T − v_{k−1}): backward Euler of a first-order low-pass.

    Parameters
    ----------
    motion : record `state.pid` of a controller, whose previous reference and encoder values go on.
    period, filter_time : T and τ [s]; with τ = 0 the speed is the raw difference.
    reference, encoder : r and x of this period [m].
    """
    motion.error = reference - encoder
    motion.reference_velocity = (reference - motion.previous_reference) / period
    share = period / (period + filter_time)
    motion.velocity += share * ((encoder - motion.previous_encoder) / period - motion.velocity)
    motion.previous_reference = reference
    motion.previous_encoder = encoder
