"""An incremental encoder: y = q · round((x + noise) / q), see `readings`.

Its own error of interpolation where it has one.

Derived: by definition of a count.
"""

from microstage_ros.model.sensors.position import PositionSensor


class Incremental(PositionSensor):
    """The usual sensor: counts of ``sensors.encoder.resolution``."""

    name = "incremental"
