"""Reads a launch file of mr_damper and starts its processes, like `ros2 launch`.

No wheel contains ROS' `launch` and `launch_ros`, so this script replaces them. It implements only the part of their API and XML that
our files use, and refuses everything else. Commands are built like in launch_ros of Humble and later (launch_ros/actions/node.py):
package and executable from the real ament index; parameters in the given order, each as a file. A dictionary becomes a file for the
node if name and namespace are known, otherwise for all nodes.

usage: launch_files.py PREFIX [--print] FILE [argument:=value...]

PREFIX is the directory where the package is installed. --print prints the commands in one line of JSON. Without it the processes are
started; one line gives their process ids, SIGINT is forwarded to them, and a last line gives their exit codes.
"""

import importlib.util
import json
import os
import pathlib
import shlex
import signal
import subprocess
import sys
import tempfile
import types
import xml.etree.ElementTree as ElementTree

import yaml
from ament_index_python.packages import get_package_prefix, get_package_share_directory

TYPES = {"str": str, "bool": bool, "int": int, "float": float}


class Context:
    """Values of arguments, and the directory for parameter files."""

    def __init__(self, given, folder):
        self.given, self.folder, self.values, self.declared = given, folder, {}, []

    def text(self, item):
        """The text of a substitution, or of a list of them."""
        if isinstance(item, (list, tuple)):
            return "".join(self.text(part) for part in item)
        return item if isinstance(item, str) else item.text(self)


class LaunchConfiguration:
    def __init__(self, name):
        self.name = name

    def text(self, context):
        if self.name not in context.values:
            sys.exit(f"launch configuration '{self.name}' does not exist")
        return context.values[self.name]


class FindPackageShare:
    def __init__(self, package):
        self.package = package

    def text(self, context):
        return get_package_share_directory(context.text(self.package))


class PathJoinSubstitution:
    def __init__(self, parts):
        self.parts = parts

    def text(self, context):
        return os.path.join(*(context.text(part) for part in self.parts))


class Condition:
    def __init__(self, text, wanted):
        self.item, self.wanted = text, wanted

    def holds(self, context):
        text = context.text(self.item).strip().lower()
        if text not in ("true", "1", "false", "0"):
            sys.exit(f"a condition is '{text}'; it must be true, 1, false or 0")
        return (text in ("true", "1")) == self.wanted


class ParameterValue:
    def __init__(self, value, value_type):
        self.value, self.value_type = value, value_type

    def evaluate(self, context):
        text = context.text(self.value)
        if self.value_type is str:
            return text
        value = yaml.safe_load(text)
        if type(value) is not self.value_type:
            sys.exit(f"'{text}' is not a {self.value_type.__name__}")
        return value


class DeclareLaunchArgument:
    def __init__(self, name, default_value, description):
        self.name, self.default = name, default_value
        assert description, f"{name} has no description"

    def visit(self, context):
        context.declared.append(self.name)
        context.values[self.name] = context.given.get(self.name, context.text(self.default))
        return []


class Node:
    def __init__(self, *, package, executable, arguments, ros_arguments, parameters, output,
                 name=None, namespace=None, condition=None):
        self.package, self.executable, self.output = package, executable, output
        self.arguments, self.ros_arguments, self.parameters = arguments, ros_arguments, parameters
        self.name, self.namespace, self.condition = name, namespace, condition
        assert output in ("screen", "log", "both"), output

    def visit(self, context):
        if self.condition is not None and not self.condition.holds(context):
            return []
        package, executable = context.text(self.package), context.text(self.executable)
        program = os.path.join(get_package_prefix(package), "lib", package, executable)
        if not os.access(program, os.X_OK):
            sys.exit(f"executable '{executable}' not found on the libexec directory '{os.path.dirname(program)}'")
        command = [program, *map(context.text, self.arguments)]
        command += ["--ros-args", *map(context.text, self.ros_arguments), "--ros-args"]
        section = "/**"
        if self.name is not None:
            command += ["-r", f"__node:={context.text(self.name)}"]
        if self.namespace is not None:
            namespace = "/" + context.text(self.namespace).lstrip("/")
            command += ["-r", f"__ns:={namespace}"]
            if self.name is not None:
                section = f"{namespace.rstrip('/')}/{context.text(self.name)}"
        for parameters in self.parameters:
            if isinstance(parameters, dict):
                values = {name: value.evaluate(context) for name, value in parameters.items()}
                file, path = tempfile.mkstemp(prefix="launch_params_", dir=context.folder)
                with os.fdopen(file, "w", encoding="utf-8") as out:
                    yaml.dump({section: {"ros__parameters": values}}, out, default_flow_style=False)
            else:
                path = context.text(parameters)
                if not os.path.isfile(path):
                    sys.exit(f"Parameter file path is not a file: {path}")
            command += ["--params-file", path]
        return [command]


class LaunchDescription:
    def __init__(self, entities):
        self.entities = entities


def module(name, **contents):
    made = types.ModuleType(name)
    vars(made).update(contents)
    sys.modules[name] = made


def read_python(path):
    """Runs a Python launch file with the classes above."""
    module("launch", LaunchDescription=LaunchDescription)
    module("launch.actions", DeclareLaunchArgument=DeclareLaunchArgument)
    module("launch.conditions", IfCondition=lambda text: Condition(text, True),
           UnlessCondition=lambda text: Condition(text, False))
    module("launch.substitutions", LaunchConfiguration=LaunchConfiguration, PathJoinSubstitution=PathJoinSubstitution)
    module("launch_ros")
    module("launch_ros.actions", Node=Node)
    module("launch_ros.parameter_descriptions", ParameterValue=ParameterValue)
    module("launch_ros.substitutions", FindPackageShare=FindPackageShare)
    spec = importlib.util.spec_from_file_location("launch_file", path)
    file = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(file)
    return file.generate_launch_description().entities


def substitutions(text):
    """The parts of an attribute: text, $(var NAME), $(find-pkg-share PACKAGE)."""
    parts = []
    while "$(" in text:
        plain, rest = text.split("$(", 1)
        inner, text = rest.split(")", 1)
        kind, name = inner.split()
        made = {"var": LaunchConfiguration, "find-pkg-share": FindPackageShare}[kind](name)
        parts += [plain, made]
    return [*parts, text]


def read_xml(path):
    """Reads an XML launch file."""
    root = ElementTree.parse(path).getroot()
    assert root.tag == "launch" and not root.attrib, root.attrib
    return [{"arg": xml_argument, "node": xml_node}[child.tag](child) for child in root]


def taken(element, *wanted, optional=()):
    """The attributes of an element, which must have all of `wanted`, may have `optional`, and no others."""
    missing, more = set(wanted) - set(element.attrib), set(element.attrib) - {*wanted, *optional}
    if missing or more:
        sys.exit(f"<{element.tag}>: missing {sorted(missing)}, unexpected {sorted(more)}")
    return [element.get(name) for name in (*wanted, *optional)]


def xml_argument(element):
    name, default, description = taken(element, "name", "default", "description")
    return DeclareLaunchArgument(name, substitutions(default), description)


def xml_node(element):
    package, executable, arguments, ros_arguments, output, name, namespace, yes, no = taken(
        element, "pkg", "exec", "args", "ros_args", "output", optional=("name", "namespace", "if", "unless"))
    condition = Condition(substitutions(yes), True) if yes else Condition(substitutions(no), False) if no else None
    return Node(
        package=package, executable=executable, output=output, condition=condition,
        arguments=shlex.split(arguments),
        ros_arguments=[substitutions(part) for part in split_outside_of_substitutions(ros_arguments)],
        parameters=[xml_parameter(child) for child in element],
        name=None if name is None else substitutions(name),
        namespace=None if namespace is None else substitutions(namespace))


def split_outside_of_substitutions(text):
    return [part.replace("\0", " ") for part in text.replace("$(var ", "$(var\0").split()]


def xml_parameter(element):
    assert element.tag == "param", element.tag
    if "from" in element.attrib:
        return substitutions(taken(element, "from")[0])
    name, value, kind = taken(element, "name", "value", "type")
    return {name: ParameterValue(substitutions(value), TYPES[kind])}


def commands(path, given, folder):
    context = Context(given, folder)
    entities = (read_xml if path.suffix == ".xml" else read_python)(path)
    made = [command for entity in entities for command in entity.visit(context)]
    unknown = set(given) - set(context.declared)
    if unknown:
        sys.exit(f"{path}: unknown argument {sorted(unknown)}; arguments are {context.declared}")
    return made


def run(made):
    """Starts the commands, forwards SIGINT, and prints their exit codes."""
    processes = [subprocess.Popen(command, stdout=sys.stderr) for command in made]
    # SIGINT goes only to this process, in a session of its own or not, and is forwarded once to each child.
    signal.signal(signal.SIGINT, lambda *_: [process.send_signal(signal.SIGINT) for process in processes])
    print(json.dumps({"event": "started", "pids": [process.pid for process in processes]}), flush=True)
    codes = [process.wait() for process in processes]
    print(json.dumps({"event": "ended", "codes": codes}), flush=True)
    sys.exit(any(codes))


def main():
    prefix, *words = sys.argv[1:]
    os.environ["AMENT_PREFIX_PATH"] = f"{prefix}:{os.environ['AMENT_PREFIX_PATH']}"
    only_print = words[:1] == ["--print"]
    path, *assignments = words[only_print:]
    given = dict(assignment.split(":=", 1) for assignment in assignments)
    with tempfile.TemporaryDirectory() as folder:
        made = commands(pathlib.Path(path), given, folder)
        if only_print:
            # Parameter files are shown by their content, so that two launch files can be compared.
            shown = [[yaml.safe_load(pathlib.Path(word).read_text()) if word.startswith(folder) else word
                      for word in command] for command in made]
            print(json.dumps({"commands": shown}))
        else:
            run(made)


main()
