"""No control: the output is zero, and what moves the axis is the disturbance voltage of the run."""

from microstage_ros.control.gains import record_type

GAINS = ()
PARAMETERS = record_type(GAINS, [("unused", "f8")])
