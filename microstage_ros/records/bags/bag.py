"""Bags in and out: what the rest of the project uses, in one place."""

from microstage_ros.records.bags.bag_metadata import Qos
from microstage_ros.records.bags.bag_reader import Bag, read_bag, read_bags
from microstage_ros.records.bags.bag_writer import BagWriter
from microstage_ros.records.bags.definition import installed_definition
from microstage_ros.records.bags.layout import layout_of_message, layout_of_type
from microstage_ros.records.bags.mcap_sink import BagStopped

__all__ = ["Bag", "BagStopped", "BagWriter", "Qos", "installed_definition", "layout_of_message", "layout_of_type",
           "read_bag", "read_bags"]
