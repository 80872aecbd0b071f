"""Installs microstage_ros as an ament_python package: modules, executables, configuration."""

import ast
from glob import glob
from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "microstage_ros"
NODES = [
    "axis_driver", "str_controller", "gms_observer", "interferometer_logger", "move_server", "bag_recorder",
    "health_monitor",
]


def commands():
    """The names in ``LISTED`` of the command line, read without importing it."""
    tree = ast.parse(Path("microstage_ros/commands/__init__.py").read_text(encoding="utf-8"))
    listed = next(ast.literal_eval(node.value) for node in tree.body
                  if isinstance(node, ast.Assign) and node.targets[0].id == "LISTED")
    return [name for names in listed.values() for name in names]


def config_files():
    """(folder in the share, files) for every folder of ``config/``."""
    folders = ["config", *sorted(folder.rstrip("/") for folder in glob("config/*/", recursive=True))]
    return [(f"share/{PACKAGE}/{folder}", [f for f in glob(f"{folder}/*") if "." in f.split("/")[-1]])
            for folder in folders]


setup(
    name=PACKAGE,
    version="0.1.0",
    description="An ultra-high-precision linear axis beside ROS 2.",
    license="Apache-2.0",
    maintainer="microstage_ros maintainers",
    maintainer_email="maintainers@microstage-ros.org",
    python_requires=">=3.10",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={"": ["*.html", "*.j2", "*.css", "*.js", "*.yaml", "*.svg", "*.c"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        (f"share/{PACKAGE}/launch", glob("launch/*.py")),
        *config_files(),
    ],
    entry_points={"console_scripts": [
        *(f"{name} = {PACKAGE}.ros.nodes.{name}:main" for name in NODES),
        *(f"{name} = {PACKAGE}.commands.__main__:{name}" for name in commands()),
    ]},
    zip_safe=False,
)
