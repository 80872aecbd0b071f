"""Position sensors by name: one file each, one line each in `POSITION_SENSORS` (the first is the usual one)."""

from microstage_ros.model.sensors.capacitive import Capacitive
from microstage_ros.model.sensors.incremental import Incremental
from microstage_ros.model.sensors.lvdt import Lvdt
from microstage_ros.model.sensors.position import PositionSensor
from microstage_ros.model.sensors.sine_cosine import SineCosine

POSITION_SENSORS = (
    Incremental,
    SineCosine,
    Lvdt,
    Capacitive,
)
SENSOR_KEY = "sensors.encoder.type"
SENSORS_BY_NAME = {sensor.name: sensor for sensor in POSITION_SENSORS}
for _number, _sensor in enumerate(POSITION_SENSORS):
    _sensor.number = _number


def position_sensor_of(axis):
    """The `PositionSensor` class of an axis."""
    return SENSORS_BY_NAME[axis.choices.get(SENSOR_KEY, POSITION_SENSORS[0].name)]


__all__ = ["POSITION_SENSORS", "SENSORS_BY_NAME", "SENSOR_KEY", "PositionSensor", "position_sensor_of"]
