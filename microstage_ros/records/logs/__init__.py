"""Logs of machines that other people built: read as they are, converted once to SI, with what was odd about them."""

from microstage_ros.records.logs.description import LogDescription, load_description
from microstage_ros.records.logs.log import Log, read_log

__all__ = ["Log", "LogDescription", "load_description", "read_log"]
