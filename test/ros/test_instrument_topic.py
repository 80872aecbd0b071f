"""A real interferometer: readings enter by a topic of their own, with the air from topics or corrected by the instrument."""

import math
import subprocess
import sys

import pytest

from microstage_ros.metrology.refractive_index import Air, refractive_index

from ros_support import own_domain, ros_node, spin_until

NODE = [sys.executable, "-m", "microstage_ros.ros.nodes.interferometer_logger", "--ros-args", "-r", "__ns:=/axis",
        "-p", "instrument:=topic"]


def _publish(node, readings, air=None):
    """Publish readings [m] until as many came back; the messages of `interferometer`."""
    from geometry_msgs.msg import PointStamped
    from microstage_msgs.msg import InterferometerReading
    from sensor_msgs.msg import FluidPressure, RelativeHumidity, Temperature

    found = []
    node.create_subscription(InterferometerReading, "interferometer", found.append, 1000)
    raw = node.create_publisher(PointStamped, "interferometer_raw", 1000)
    slow = [(node.create_publisher(kind, topic, 10), kind, field) for kind, topic, field in (
        (Temperature, "air_temperature", "temperature"), (FluidPressure, "air_pressure", "fluid_pressure"),
        (RelativeHumidity, "air_humidity", "relative_humidity"))] if air else []
    spin_until(node, lambda: raw.get_subscription_count() and node.count_publishers("interferometer"))
    count = 0

    def go_on():
        nonlocal count
        for publisher, kind, field in slow:
            publisher.publish(kind(**{field: air[field]}))
        message = PointStamped()
        message.header.stamp.sec, message.header.stamp.nanosec = 100 + count, 5
        message.point.x = readings[count % len(readings)]
        raw.publish(message)
        count += 1
        return len(found) >= len(readings)

    spin_until(node, go_on)
    return found


@pytest.mark.parametrize("corrected, temperature", [(True, None), (False, 293.15), (False, 20.0)])
def test_readings_of_an_instrument_are_corrected_and_stamped(corrected, temperature):
    """The air's temperature in kelvin, or in °C, as a sensor's node has it."""
    settings = ["-p", "instrument_scale:=-1.0", "-p", f"air_compensated:={str(corrected).lower()}", "-p", "dead_path:=0.1"]
    air = None if corrected else {"temperature": temperature, "fluid_pressure": 101325.0, "relative_humidity": 0.5}
    with ros_node() as node:
        process = subprocess.Popen(NODE + settings + ([] if corrected else ["-p", "air:=topics"]))
        try:
            found = _publish(node, [1e-3, 2e-3, 3e-3], air)
        finally:
            process.terminate()
            process.wait(120)
    for message in found:
        n = message.header.stamp.sec - 100
        assert message.header.stamp.nanosec == 5 and message.sequence == 0
        # the air is what it was at zero: position = −scale · reading, whatever the index
        assert message.position == pytest.approx(-[1e-3, 2e-3, 3e-3][n % 3], abs=1e-12)
        assert message.expanded_uncertainty >= 40e-9
        assert math.isnan(message.air_temperature) if corrected else message.air_temperature == pytest.approx(293.15)
    assert corrected or refractive_index(Air(293.15, 101325.0, 0.5)) > 1.0002


def test_readings_by_topic_without_air_are_refused_in_one_line():
    with own_domain():
        done = subprocess.run([*NODE, "-p", "air_compensated:=false"], capture_output=True, text=True, timeout=240, check=False)
    assert done.returncode == 2 and "parameter air: got 'instrument'" in done.stderr and len(done.stderr.strip().splitlines()) == 1
