"""interferometer_logger: corrected positions with their uncertainty; the physics is `metrology.interferometer`.

Follows the instrument (of a simulated axis: topic `simulation`; a real one: `instrument_topic`), publishes
`interferometer`. The air comes from the instrument's weather station or from `air_temperature`, `air_pressure`,
`air_humidity`.
"""

import functools
import sys

import numpy as np
from microstage_msgs.msg import InterferometerReading, SimulationTruth
from rclpy.node import Node
from sensor_msgs.msg import FluidPressure, RelativeHumidity, Temperature

from microstage_ros.metrology.interferometer import Interferometer, budget, correct
from microstage_ros.metrology.refractive_index import ZERO_CELSIUS, Air, refractive_index
from microstage_ros.quantities.errors import InputError
from microstage_ros.ros.launching.parameters import Parameters
from microstage_ros.ros.launching.process import run_node
from microstage_ros.ros.loops.follower import Follower
from microstage_ros.ros.loops.instrument_topic import InstrumentTopic
from microstage_ros.ros.transport import topics
from microstage_ros.ros.transport.blocks import Outlet
from microstage_ros.ros.transport.codec import Codec, stamps_ns
from microstage_ros.ros.transport.servo_path import make_servo_path


KELVIN_FROM = 150.0
"""A temperature from here on is in kelvin, as `axis_driver` publishes it; below, in °C, as ``sensor_msgs/Temperature``
is defined. The index of air is known from −40 to 100 °C, 233 to 373 K."""


class InterferometerLogger(Node):
    """The logger's process."""

    def __init__(self):
        super().__init__("interferometer_logger")
        p = self.parameters = Parameters(self, "interferometer_logger")
        self._measured = {}
        self._zero = None  # air and `Interferometer` of the first reading
        self._uncertainty = p.expanded_uncertainty
        self._count = 0
        self._codec = Codec("InterferometerReading")
        servo = make_servo_path(self)
        self._outlet = Outlet(self, servo, InterferometerReading, topics.INTERFEROMETER)
        if p.instrument == "topic":
            if p.air == "instrument" and not p.air_compensated:
                raise InputError(
                    "interferometer_logger: parameter air",
                    p.air,
                    "topics, or air_compensated: true, since readings that come by topic bring no air with them",
                )
            self.loop = InstrumentTopic(self, p.instrument_topic, p.instrument_scale, self._take, self._outlet).loop
        else:
            self.loop = Follower(
                self,
                servo,
                SimulationTruth,
                topics.SIMULATION,
                p.window,
                self._take,
                self._outlet,
                p.expected_followers,
            ).loop
        if p.air == "topics":
            for kind, topic, field in (
                (Temperature, topics.AIR_TEMPERATURE, "temperature"),
                (FluidPressure, topics.AIR_PRESSURE, "fluid_pressure"),
                (RelativeHumidity, topics.AIR_HUMIDITY, "relative_humidity"),
            ):
                self.create_subscription(
                    kind,
                    topic,
                    functools.partial(self._measure, field),
                    topics.SLOW,
                )

    def _measure(self, field, message):
        value = getattr(message, field)
        if field == "temperature" and value < KELVIN_FROM:
            value += ZERO_CELSIUS
        self._measured[field] = value

    def _take(self, seen):
        air = Air(*(seen[name] for name in ("air_temperature", "air_pressure", "air_humidity")))
        if self.parameters.air == "topics":
            if len(self._measured) < 3:
                return  # no position without the air it was measured in
            air = Air(
                *(
                    np.full(len(seen), self._measured[name])
                    for name in ("temperature", "fluid_pressure", "relative_humidity")
                )
            )
        counted = seen["interferometer_position"]
        try:
            position, uncertainty = self._corrected(counted, air)
        except InputError as error:
            self.get_logger().error(str(error), throttle_duration_sec=1.0)
            return
        messages = self._codec.blank(stamps_ns(seen))
        for name, values in (
            ("sequence", seen["sequence"]),
            ("position", position),
            ("expanded_uncertainty", uncertainty),
            ("air_temperature", air.temperature_K),
            ("air_pressure", air.pressure_Pa),
            ("air_humidity", air.humidity),
            ("stage_temperature", seen["stage_temperature"]),
            ("correction", position - counted),
        ):
            messages[name] = values
        self._outlet.send_all(messages)

    def _corrected(self, counted, air):
        """Positions [m] from what the instrument counts, and their uncertainty [m]: the budget now and then."""
        p = self.parameters
        if (
            p.instrument == "topic" and p.air == "instrument"
        ):  # the instrument corrects, and tells neither air nor budget
            return counted, np.full(len(counted), p.expanded_uncertainty)
        if self._zero is None:
            first = _first(air)
            self._zero = first, Interferometer(
                assumed_index=float(refractive_index(first)), dead_path_m=p.dead_path, noise_m=p.noise
            )
        zeroed, setup = self._zero
        position = counted if p.air_compensated else correct(counted, air, zeroed, setup)
        uncertainty = np.full(len(counted), self._uncertainty)
        for k in range(-self._count % p.budget_every, len(counted), p.budget_every):
            own = budget(float(position[k]), _first(air, k), zeroed, setup).expanded_m
            uncertainty[k:] = self._uncertainty = max(p.expanded_uncertainty, own)
        self._count += len(counted)
        return position, uncertainty

    def close(self):
        """Nothing to hold on to."""


def _first(air, k=0):
    """Entry ``k`` of an `Air` of arrays."""
    return Air(*(float(values[k]) for values in (air.temperature_K, air.pressure_Pa, air.humidity)))


def main(arguments=None):
    """Run the node."""
    return run_node(InterferometerLogger, arguments)


if __name__ == "__main__":
    sys.exit(main())
