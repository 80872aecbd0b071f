"""interferometer_logger: corrected positions with their uncertainty; the physics is `metrology.interferometer`.

Follows the instrument (of a simulated axis: topic `simulation`), publishes `interferometer`. The air comes from
the instrument's weather station or from `air_temperature`, `air_pressure`, `air_humidity`.
"""

import sys

from rclpy.node import Node
from sensor_msgs.msg import FluidPressure, RelativeHumidity, Temperature

from microstage_msgs.msg import InterferometerReading, SimulationTruth
from microstage_ros.axis.errors import InputError
from microstage_ros.metrology.interferometer import Interferometer, budget, correct
from microstage_ros.metrology.refractive_index import Air, refractive_index
from microstage_ros.nodes import topics
from microstage_ros.nodes.blocks import Outlet
from microstage_ros.nodes.codec import Codec, stamps_ns
from microstage_ros.nodes.follower import Follower
from microstage_ros.nodes.parameters import Parameters
from microstage_ros.nodes.process import run_node
from microstage_ros.nodes.servo_path import make_servo_path

_SEEN = ["sequence", "interferometer_position", "air_temperature", "air_pressure", "air_humidity", "stage_temperature"]


class InterferometerLogger(Node):
    """The logger's process."""

    def __init__(self):
        super().__init__("interferometer_logger")
        p = self.parameters = Parameters(self, "interferometer_logger")
        self._measured = {}
        self._zeroed = self._setup = None
        self._uncertainty = p.expanded_uncertainty
        self._count = 0
        self._pack = Codec("InterferometerReading").pack
        servo = make_servo_path(self)
        self._outlet = Outlet(self, servo, InterferometerReading, topics.INTERFEROMETER)
        self.loop = Follower(self, servo, SimulationTruth, topics.SIMULATION, p.window, self._take, self._outlet,
                             p.expected_followers).loop
        if p.air == "topics":
            for kind, topic, field in ((Temperature, topics.AIR_TEMPERATURE, "temperature"),
                                       (FluidPressure, topics.AIR_PRESSURE, "fluid_pressure"),
                                       (RelativeHumidity, topics.AIR_HUMIDITY, "relative_humidity")):
                self.create_subscription(kind, topic, lambda message, field=field: self._measured.__setitem__(
                    field, getattr(message, field)), topics.SLOW)

    def _take(self, messages):
        for time_ns, values in zip(stamps_ns(messages).tolist(), messages[_SEEN].tolist()):
            self._reading(time_ns, *values)

    def _reading(self, time_ns, sequence, counted, temperature, pressure, humidity, stage):
        """One reading of the instrument."""
        if self.parameters.air == "topics":
            if len(self._measured) < 3:
                return  # no position without the air it was measured in
            temperature, pressure, humidity = (self._measured[name] for name in (
                "temperature", "fluid_pressure", "relative_humidity"))
        air = Air(temperature, pressure, humidity)
        try:
            position = self._corrected(counted, air)
        except InputError as error:
            self.get_logger().error(str(error), throttle_duration_sec=1.0)
            return
        self._outlet.send(sequence, self._pack(time_ns, sequence, position, self._uncertainty, temperature, pressure,
                                               humidity, stage, position - counted))

    def _corrected(self, counted, air):
        """Position [m] from what the instrument counts; the budget now and then."""
        p = self.parameters
        if self._zeroed is None:
            self._zeroed = air
            self._setup = Interferometer(assumed_index=float(refractive_index(air)), dead_path_m=p.dead_path,
                                         noise_m=p.noise)
        position = counted if p.air_compensated else float(correct(counted, air, self._zeroed, self._setup))
        if self._count % p.budget_every == 0:
            own = budget(position, air, self._zeroed, self._setup).expanded_m
            self._uncertainty = max(p.expanded_uncertainty, own)
        self._count += 1
        return position

    def close(self):
        """Nothing to hold on to."""


def main(arguments=None):
    """Run the node."""
    return run_node(InterferometerLogger, arguments)


if __name__ == "__main__":
    sys.exit(main())
