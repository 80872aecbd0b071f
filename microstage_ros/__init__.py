"""microstage_ros: a linear micro-positioning axis beside ROS 2, from its mathematics to its bags."""

__version__ = "0.1.0"
