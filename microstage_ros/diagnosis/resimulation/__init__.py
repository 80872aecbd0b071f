"""A force-driven axis judged by closed-loop re-simulation.

The measured reference (and what was added to the command on purpose) goes through the same
controller and the model; the force that the model needs is compared with the force that was needed.
Nothing drifts, because the controller holds the model on the reference as it held the machine.
"""
