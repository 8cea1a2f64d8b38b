"""Starts the node for one damper.

ros2 launch mr_damper damper.launch.py namespace:=front_left model:=thesis/fuzzy-tanh/rp3-cs
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare


def argument(name, value_type):
    """A parameter of the node that is also an argument of this launch file."""
    return {name: ParameterValue(LaunchConfiguration(name), value_type=value_type)}


def generate_launch_description():
    params_file = PathJoinSubstitution([FindPackageShare("mr_damper"), "config", "damper.params.yaml"])
    return LaunchDescription([
        DeclareLaunchArgument("namespace", default_value="", description="Namespace of the damper"),
        DeclareLaunchArgument("name", default_value="mr_damper", description="Name of the node"),
        DeclareLaunchArgument(
            "model",
            default_value="thesis/fuzzy-tanh/rp3-cs",
            description="A preset (mr-damper presets) or the path of a model file; a model in params_file takes precedence",
        ),
        DeclareLaunchArgument("params_file", default_value=params_file, description="Parameters (YAML)"),
        DeclareLaunchArgument("use_sim_time", default_value="false", description="Take the time from /clock"),
        DeclareLaunchArgument(
            "autostart", default_value="true", description="false: wait for a lifecycle manager to call change_state"
        ),
        DeclareLaunchArgument("log_level", default_value="info", description="debug, info, warn, error"),
        Node(
            package="mr_damper",
            executable="mr-damper",
            name=LaunchConfiguration("name"),
            namespace=LaunchConfiguration("namespace"),
            arguments=["node"],
            ros_arguments=["--log-level", LaunchConfiguration("log_level")],
            # In order of increasing precedence.
            parameters=[
                argument("model", str),
                LaunchConfiguration("params_file"),
                argument("use_sim_time", bool),
                argument("autostart", bool),
            ],
            output="screen",
        ),
    ])
