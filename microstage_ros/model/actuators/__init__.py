"""Actuators by name: one file each, one line each in `ACTUATORS`.

>>> actuator_of(axis).command.unit        # what the machine of an axis file is commanded with
'V'
"""

from microstage_ros.model.actuators.actuator import Actuator
from microstage_ros.model.actuators.current_motor import CurrentMotor
from microstage_ros.model.actuators.force import Force
from microstage_ros.model.actuators.piezo import Piezo
from microstage_ros.model.actuators.stepper import Stepper
from microstage_ros.model.actuators.voice_coil import VoiceCoil
from microstage_ros.model.actuators.voltage_motor import VoltageMotor

ACTUATORS = (
    VoltageMotor,
    Force,
    CurrentMotor,
    VoiceCoil,
    Stepper,
    Piezo,
)
BY_NAME = {actuator.name: actuator for actuator in ACTUATORS}
for _number, _actuator in enumerate(ACTUATORS):
    _actuator.number = _number


def actuator_of(axis):
    """The `Actuator` class of an axis's drive."""
    return BY_NAME[axis.choices["drive.type"]]


__all__ = ["ACTUATORS", "BY_NAME", "Actuator", "actuator_of"]
