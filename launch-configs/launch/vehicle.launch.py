"""Starts the four dampers of a vehicle: in one process, or in four with separate:=true.

ros2 launch mr_damper vehicle.launch.py params_file:=/etc/mr-damper/vehicle.params.yaml

One process uses one DDS participant, so that a vehicle needs no more discovery traffic than one damper. Four processes
fail independently.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition, UnlessCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

CORNERS = ["front_left", "front_right", "rear_left", "rear_right"]


def argument(name, value_type):
    """A parameter of the node that is also an argument of this launch file."""
    return {name: ParameterValue(LaunchConfiguration(name), value_type=value_type)}


def process(**more):
    """A node process with the arguments of this launch file."""
    return Node(
        package="mr_damper",
        executable="mr-damper",
        arguments=["node"],
        ros_arguments=["--log-level", LaunchConfiguration("log_level")],
        parameters=[
            LaunchConfiguration("params_file"),
            argument("use_sim_time", bool),
            argument("autostart", bool),
        ],
        output="screen",
        **more,
    )


def generate_launch_description():
    separate = LaunchConfiguration("separate")
    params_file = PathJoinSubstitution([FindPackageShare("mr_damper"), "config", "vehicle.params.yaml"])
    return LaunchDescription([
        DeclareLaunchArgument(
            "params_file",
            default_value=params_file,
            description="Parameters (YAML); with one process, dampers in section /mr_damper lists the dampers it serves",
        ),
        DeclareLaunchArgument("separate", default_value="false", description="true: a process for each damper"),
        DeclareLaunchArgument("use_sim_time", default_value="false", description="Take the time from /clock"),
        DeclareLaunchArgument(
            "autostart", default_value="true", description="false: wait for a lifecycle manager to call change_state"
        ),
        DeclareLaunchArgument("log_level", default_value="info", description="debug, info, warn, error"),
        # No name is given: with one, launch would pass the parameters to /mr_damper only and not to the four
        # dampers.
        process(condition=UnlessCondition(separate)),
        *[process(namespace=corner, name="mr_damper", condition=IfCondition(separate)) for corner in CORNERS],
    ])
