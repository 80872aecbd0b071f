"""Names and quality of service of all topics, in one place; every name is relative to the node's namespace."""

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

DEPTH = 5_000
"""Messages that a servo topic keeps for a slow reader: half a second at 10 kHz. Not more than Fast DDS stores for one
endpoint (its `max_samples`, 5000): beyond that a history of the last messages does not drop the oldest but refuses the
newest, and with data sharing the thread that reads looks at the refused one again for ever (upstream pull request
6490)."""

SERVO = QoSProfile(depth=DEPTH, reliability=ReliabilityPolicy.RELIABLE)
"""Once per control period, or a fixed part of it: nothing may be lost on the way to the bag."""

LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""The last value also for who comes later."""

SLOW = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
"""A few per second."""

STATE = "state"
COMMAND = "command"
CONTROLLER_STATE = "controller_state"
FRICTION = "friction"
INTERFEROMETER = "interferometer"
SIMULATION = "simulation"
TIMING = "timing"
CREDIT = "credit"
SENDERS = {
    STATE: ("axis_driver",),
    SIMULATION: ("axis_driver",),
    COMMAND: ("str_controller",),
    CONTROLLER_STATE: ("str_controller",),
    FRICTION: ("gms_observer",),
    INTERFEROMETER: ("interferometer_logger",),
}
"""Nodes that publish on a topic of the servo path; others only where none of these does."""

BLOCKS = "_blocks/"
"""Stands before the name of a topic whose messages come in blocks; ROS hides names that begin so."""

DRIVER_STATUS = "driver_status"
JOINT_STATES = "joint_states"
AIR_TEMPERATURE = "air_temperature"
AIR_PRESSURE = "air_pressure"
AIR_HUMIDITY = "air_humidity"
DIAGNOSTICS = "/diagnostics"
FOLLOW_REFERENCE = "follow_reference"
MOVE_TO = "move_to"
MOVE = "move"
STATISTICS = "statistics"
RESET_FAULT = "reset_fault"
RESET = "reset"
STOP = "stop"
HOLD = "hold"
HOME = "home"
JOG = "jog"
TRIP = "trip"
STATUS = "status"
TAKE_OVER = "take_over"
CELL_STATUS = "cell_status"
HEALTH = "health"
RESET_HEALTH = "reset_health"
INVESTIGATE = "investigate"
