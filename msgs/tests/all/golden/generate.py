#!/usr/bin/env python3
"""Writes cdr.tsv and hashes.tsv: the CDR bytes and type hashes of our messages, computed by PyPI rosbags.

usage: generate.py [--check] [--rosidl PREFIX...]

  --check             write nothing; fail if the files differ from what would be written
  --rosidl PREFIX...  also compare every hash with the JSON that rosidl installed under PREFIX/share:
                      our install prefix, and that of ROS 2 itself for the standard types

Needs `pip install rosbags==0.11.9`. The tests read only the two files and need no Python.
"""

import argparse
import json
import math
import sys
from pathlib import Path

import numpy
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

HERE = Path(__file__).resolve().parent
PACKAGE = HERE.parents[2]
NAN = math.nan

STANDARD = [
    'builtin_interfaces/msg/Time',
    'diagnostic_msgs/msg/DiagnosticArray',
    'diagnostic_msgs/msg/DiagnosticStatus',
    'diagnostic_msgs/msg/KeyValue',
    'geometry_msgs/msg/Twist',
    'geometry_msgs/msg/TwistStamped',
    'geometry_msgs/msg/Vector3',
    'geometry_msgs/msg/Wrench',
    'geometry_msgs/msg/WrenchStamped',
    'lifecycle_msgs/msg/State',
    'lifecycle_msgs/msg/Transition',
    'lifecycle_msgs/msg/TransitionDescription',
    'lifecycle_msgs/msg/TransitionEvent',
    'rcl_interfaces/msg/FloatingPointRange',
    'rcl_interfaces/msg/IntegerRange',
    'rcl_interfaces/msg/ListParametersResult',
    'rcl_interfaces/msg/Log',
    'rcl_interfaces/msg/Parameter',
    'rcl_interfaces/msg/ParameterDescriptor',
    'rcl_interfaces/msg/ParameterEvent',
    'rcl_interfaces/msg/ParameterValue',
    'rcl_interfaces/msg/SetParametersResult',
    'rosgraph_msgs/msg/Clock',
    'sensor_msgs/msg/JointState',
    'sensor_msgs/msg/Range',
    'sensor_msgs/msg/Temperature',
    'std_msgs/msg/Float32',
    'std_msgs/msg/Float64',
    'std_msgs/msg/Header',
    'type_description_interfaces/msg/Field',
    'type_description_interfaces/msg/FieldType',
    'type_description_interfaces/msg/IndividualTypeDescription',
    'type_description_interfaces/msg/KeyValue',
    'type_description_interfaces/msg/TypeDescription',
    'type_description_interfaces/msg/TypeSource',
]

# rosbags does not support services; these definitions are copied from the packages of ROS 2 Jazzy.
FOREIGN_SERVICES = {
    'lifecycle_msgs/srv/ChangeState': ('Transition transition', 'bool success'),
    'lifecycle_msgs/srv/GetAvailableStates': ('', 'State[] available_states'),
    'lifecycle_msgs/srv/GetAvailableTransitions': ('', 'TransitionDescription[] available_transitions'),
    'lifecycle_msgs/srv/GetState': ('', 'State current_state'),
    'rcl_interfaces/srv/DescribeParameters': ('string[] names', 'ParameterDescriptor[] descriptors'),
    'rcl_interfaces/srv/GetParameterTypes': ('string[] names', 'uint8[] types'),
    'rcl_interfaces/srv/GetParameters': ('string[] names', 'ParameterValue[] values'),
    'rcl_interfaces/srv/ListParameters': (
        'uint64 DEPTH_RECURSIVE=0\nstring[] prefixes\nuint64 depth', 'ListParametersResult result',
    ),
    'rcl_interfaces/srv/SetParameters': ('Parameter[] parameters', 'SetParametersResult[] results'),
    'rcl_interfaces/srv/SetParametersAtomically': ('Parameter[] parameters', 'SetParametersResult result'),
    'rosbag2_interfaces/srv/Burst': ('uint64 num_messages', 'uint64 actually_burst'),
    'rosbag2_interfaces/srv/GetRate': ('', 'float64 rate'),
    'rosbag2_interfaces/srv/IsPaused': ('', 'bool paused'),
    'rosbag2_interfaces/srv/Pause': ('', ''),
    'rosbag2_interfaces/srv/PlayNext': ('', 'bool success'),
    'rosbag2_interfaces/srv/Resume': ('', ''),
    'rosbag2_interfaces/srv/Seek': ('builtin_interfaces/Time time', 'bool success'),
    'rosbag2_interfaces/srv/SetRate': ('float64 rate', 'bool success'),
    'rosbag2_interfaces/srv/TogglePaused': ('', ''),
    'type_description_interfaces/srv/GetTypeDescription': (
        'string type_name\nstring type_hash\nbool include_type_sources true',
        'bool successful\nstring failure_reason\nTypeDescription type_description\n'
        'TypeSource[] type_sources\nKeyValue[] extra_information',
    ),
}

SECTIONS = {
    'msg': [''],
    'srv': ['_Request', '_Response'],
    'action': ['_Goal', '_Result', '_Feedback'],
}


def definitions():
    """Type name and text of every message in this package; services and actions are split into their parts."""
    for folder, suffixes in SECTIONS.items():
        for path in sorted((PACKAGE / folder).iterdir()):
            parts = path.read_text().split('---\n')
            assert len(parts) == len(suffixes), path
            for suffix, text in zip(suffixes, parts):
                yield f'mr_damper_msgs/{folder}/{path.stem}{suffix}', text


    for service, parts in FOREIGN_SERVICES.items():
        for suffix, text in zip(SECTIONS['srv'], parts):
            yield service + suffix, text


def load():
    """A type store with the standard types, our types, and the foreign services that we offer."""
    store = get_typestore(Stores.ROS2_JAZZY)
    ours = []
    for name, text in definitions():
        # rosbags knows only messages, so each part of a service is parsed as a message and renamed.
        package, _, base = name.split('/')
        as_message = f'{package}/msg/{base}'
        (fields,) = get_types_from_msg(text, as_message).values()
        if not fields[1]:
            # rosidl adds one byte to an empty structure, because C has no empty structures.
            filler = get_types_from_msg('uint8 structure_needs_at_least_one_member\n', as_message)
            (fields,) = filler.values()
        store.register({name: fields})
        ours.append(name)
    services = [f'mr_damper_msgs/srv/{path.stem}' for path in sorted((PACKAGE / 'srv').iterdir())]
    services += FOREIGN_SERVICES
    for name in services:
        describe_service(store, name)
    return store, ours, services


def describe_service(store, name):
    """Adds the service and its event as rosidl describes them; we hash them but never send them."""
    def one(of):
        return (Nodetype.NAME, of)

    def at_most_one(of):
        return (Nodetype.SEQUENCE, (one(of), 1))

    def number(kind):
        return (Nodetype.BASE, (kind, 0))

    # rosbags hashes the char of client_gid as an IDL char; rosidl reads char in a .msg file as uint8.
    store.fielddefs['service_msgs/msg/ServiceEventInfo'] = ([], [
        ('event_type', number('uint8')),
        ('stamp', one('builtin_interfaces/msg/Time')),
        ('client_gid', (Nodetype.ARRAY, (number('uint8'), 16))),
        ('sequence_number', number('int64')),
    ])
    store.fielddefs[f'{name}_Event'] = ([], [
        ('info', one('service_msgs/msg/ServiceEventInfo')),
        ('request', at_most_one(f'{name}_Request')),
        ('response', at_most_one(f'{name}_Response')),
    ])
    store.fielddefs[name] = ([], [
        ('request_message', one(f'{name}_Request')),
        ('response_message', one(f'{name}_Response')),
        ('event_message', one(f'{name}_Event')),
    ])


def time(sec=1_700_000_000, nanosec=123_456_789):
    return {'sec': sec, 'nanosec': nanosec}


def header(frame='damper', **stamp):
    return {'stamp': time(**stamp), 'frame_id': frame}


# String lengths that place the next number at every position within eight bytes.
FRAMES = ['', 'a', 'ab', 'abc', 'abcd', 'abcde', 'abcdef', 'abcdefg', 'front_left/rod', 'Dämpfer']


def frames(**fields):
    """One case per frame length."""
    return {f'frame_{len(f.encode())}': {'header': header(f), **fields} for f in FRAMES}


def estimate(**changes):
    return {'header': header(), 'force': -512.25, 'std_dev': 4.5, 'model': 'thesis/arx/rp3-cs', 'mode': 1,
            'validity': 2, 'reasons': 4 | 32 | 4096, 'input_age': 0.00125,
            'band_low': -520.0, 'band_high': -504.5, 'band_calibrated': True, **changes}


def status(level=0, name='mr_damper: estimator', message='', hardware='', **values):
    return {'level': level, 'name': name, 'message': message, 'hardware_id': hardware,
            'values': [{'key': k, 'value': v} for k, v in values.items()]}


def joints(name=('rod',), position=(0.0125,), velocity=(-0.5,), effort=(812.0,)):
    return {'header': header('base_link'), 'name': list(name), 'position': list(position),
            'velocity': list(velocity), 'effort': list(effort)}


def vector(x=0.0, y=0.0, z=0.0):
    return {'x': x, 'y': y, 'z': z}


def state(number=3, label='active'):
    return {'id': number, 'label': label}


def transition():
    return {'transition': state(3, 'activate'), 'start_state': state(2, 'inactive'), 'goal_state': state()}


def parameter(kind, **value):
    return {'type': kind, 'bool_value': False, 'integer_value': 0, 'double_value': 0.0, 'string_value': '',
            'byte_array_value': [], 'bool_array_value': [], 'integer_array_value': [],
            'double_array_value': [], 'string_array_value': [], **value}


def named(name):
    return {'name': name, 'value': parameter(3, double_value=0.25)}


def descriptor(**changes):
    return {'name': 'coast_s', 'type': 3, 'description': 'how long, s', 'additional_constraints': '',
            'read_only': False, 'dynamic_typing': False, 'floating_point_range': [], 'integer_range': [],
            **changes}


def field(name='force'):
    return {'name': name, 'type': {'type_id': 11, 'capacity': 0, 'string_capacity': 0, 'nested_type_name': ''},
            'default_value': ''}


def described():
    return {'type_name': 'a/msg/B', 'fields': [field(), field('xy')]}


CASES = {
    'builtin_interfaces/msg/Time': {
        'zero': time(0, 0), 'now': time(), 'before_1970': time(-2, 999_999_999),
        'first': time(-2**31, 0), 'last': time(2**31 - 1, 999_999_999),
    },
    'std_msgs/msg/Header': {f'frame_{len(f.encode())}': header(f) for f in FRAMES},
    'std_msgs/msg/Float64': {'pi': {'data': math.pi}, 'nan': {'data': NAN}, 'minus_zero': {'data': -0.0}},
    'std_msgs/msg/Float32': {'quarter': {'data': 0.25}, 'nan': {'data': NAN}, 'minus_zero': {'data': -0.0}},
    'geometry_msgs/msg/Vector3': {'all': vector(1.0, -2.5, 9.81), 'nan': vector(z=NAN)},
    'geometry_msgs/msg/Wrench': {'both': {'force': vector(1.0, 2.0, -750.0), 'torque': vector(0.5)}},
    'geometry_msgs/msg/WrenchStamped': frames(wrench={'force': vector(z=-750.0), 'torque': vector()}),
    'geometry_msgs/msg/Twist': {'both': {'linear': vector(z=-0.25), 'angular': vector(0.5)}},
    'geometry_msgs/msg/TwistStamped': frames(twist={'linear': vector(z=-0.25), 'angular': vector()}),
    'rosgraph_msgs/msg/Clock': {'now': {'clock': time()}},
    'sensor_msgs/msg/Temperature': frames(temperature=41.5, variance=0.25),
    'sensor_msgs/msg/Range': frames(radiation_type=1, field_of_view=0.5, min_range=0.0625, max_range=4.0,
                                    range=0.375, variance=0.0),
    'sensor_msgs/msg/JointState': {
        'empty': joints((), (), (), ()), 'one': joints(), 'no_velocity': joints(velocity=()),
        'three': joints(('a', 'bcd', 'efghi'), (1.0, 2.0, 3.0), (), (4.0, 5.0, 6.0)),
    },
    'diagnostic_msgs/msg/KeyValue': {
        'empty': {'key': '', 'value': ''}, 'pair': {'key': 'late', 'value': '12'},
    },
    'diagnostic_msgs/msg/DiagnosticStatus': {
        'ok': status(), 'warn': status(1, 'n', 'late', 'rig-7', late='12', dropped='3', mode='arx'),
    },
    'diagnostic_msgs/msg/DiagnosticArray': {
        'empty': {'header': header(''), 'status': []},
        'two': {'header': header(''), 'status': [status(), status(2, 'x', 'no displacement', 'rig', a='b')]},
    },
    'mr_damper_msgs/msg/Displacement': frames(displacement=0.0254, variance=1e-10),
    'mr_damper_msgs/msg/Velocity': frames(velocity=-0.1016, variance=0.0),
    'mr_damper_msgs/msg/CoilCurrent': frames(current=1.6, variance=1e-4),
    'mr_damper_msgs/msg/CommandVoltage': frames(voltage=2.25, variance=-1.0),
    'mr_damper_msgs/msg/Force': {
        **frames(force=1334.5, variance=16.0), 'nan': {'header': header(), 'force': NAN, 'variance': 0.0},
    },
    'mr_damper_msgs/msg/ForceEstimate': {
        **{f'frame_{i}_model_{j}': estimate(header=header(FRAMES[i]), model='m' * j)
           for i in range(4) for j in range(9)},
        'usual': estimate(),
        'unknown': estimate(force=NAN, std_dev=NAN, input_age=NAN, mode=4, validity=4, reasons=1,
                            band_low=NAN, band_high=NAN, band_calibrated=False),
        'not_ours': estimate(mode=200, validity=255, reasons=2**32 - 1),
    },
    'mr_damper_msgs/msg/ForceResidual': {
        **frames(measured=100.0, predicted=96.0, residual=4.0, normalised=0.8, windowed_rsse=5.5,
                 windowed_esr=0.0031, window=2.0, alarm=False),
        'alarm': {'header': header(), 'measured': 1.0, 'predicted': -1.0, 'residual': 2.0, 'normalised': NAN,
                  'windowed_rsse': NAN, 'windowed_esr': NAN, 'window': 0.5, 'alarm': True},
    },
    'mr_damper_msgs/msg/EffectValue': {
        **frames(effect='coil_lag', form='', parameter='tau_s', running=0.012, value=0.0143, low=0.0142, high=0.0144,
                 window=60.0, windows=12, changed=True),
        'unknown': {'header': header(), 'effect': 'coil_lag', 'form': 'rise_fall', 'parameter': 'tau_fall_s', 'running': 0.019,
                    'value': NAN, 'low': NAN, 'high': NAN, 'window': 60.0, 'windows': 0, 'changed': False},
    },
    'mr_damper_msgs/msg/CurrentCommand': {
        **frames(current=1.2, force_requested=500.0, force_expected=487.5, achievable=False, dissipative=True,
                 limited_by=1, achievable_min=120.0, achievable_max=487.5),
        'safe': {'header': header(), 'current': 0.0, 'force_requested': NAN, 'force_expected': NAN,
                 'achievable': True, 'dissipative': False, 'limited_by': 5, 'achievable_min': NAN, 'achievable_max': NAN},
    },
    'mr_damper_msgs/msg/ModeChange': frames(from_mode=0, to_mode=1, reason='measured force is 0.12 s old'),
    'mr_damper_msgs/srv/LoadModel_Request': {'preset': {'model': 'thesis/fuzzy-tanh/rp3-cs'}},
    'mr_damper_msgs/srv/LoadModel_Response': {'no': {'success': False, 'message': 'no such preset'}},
    'mr_damper_msgs/srv/Reset_Request': {'empty': {'structure_needs_at_least_one_member': 0}},
    'mr_damper_msgs/srv/Reset_Response': {'yes': {'success': True, 'message': ''}},
    'mr_damper_msgs/srv/SetMode_Request': {
        'model': {'mode': 2, 'automatic': False}, 'automatic': {'mode': 0, 'automatic': True},
    },
    'mr_damper_msgs/srv/SetMode_Response': {'yes': {'success': True, 'message': 'model'}},
    **{f'rosbag2_interfaces/srv/{part}': {'empty': {'structure_needs_at_least_one_member': 0}} for part in (
        'Pause_Request', 'Pause_Response', 'Resume_Request', 'Resume_Response', 'TogglePaused_Request',
        'TogglePaused_Response', 'IsPaused_Request', 'GetRate_Request', 'PlayNext_Request',
    )},
    **{f'rosbag2_interfaces/srv/{service}_Response': {'yes': {'success': True}, 'no': {'success': False}}
       for service in ('SetRate', 'PlayNext', 'Seek')},
    'rosbag2_interfaces/srv/IsPaused_Response': {'yes': {'paused': True}},
    'rosbag2_interfaces/srv/GetRate_Response': {'half': {'rate': 0.5}},
    'rosbag2_interfaces/srv/SetRate_Request': {'double': {'rate': 2.0}},
    'rosbag2_interfaces/srv/Burst_Request': {'ten': {'num_messages': 10}, 'all': {'num_messages': 0}},
    'rosbag2_interfaces/srv/Burst_Response': {'most': {'actually_burst': 2**64 - 1}},
    'rosbag2_interfaces/srv/Seek_Request': {'now': {'time': time()}},
    'mr_damper_msgs/action/CloseLoop_Goal': {'ten_seconds': {'history': 10.0}},
    'mr_damper_msgs/action/CloseLoop_Result': {'yes': {'success': True, 'report': '{"schema": "mr-damper/close/1"}'}},
    'mr_damper_msgs/action/CloseLoop_Feedback': {'half': {'stage': 'confirm', 'progress': 0.5}},
    'mr_damper_msgs/action/Design_Goal': {
        f'question_{j}': {
            'question': 'friction|gas_spring'[:j], 'report': '{}'[:j], 'stroke': 0.02, 'speed': 0.5, 'acceleration': 0.0,
            'drive_min': 0.0, 'drive_max': 2.0, 'duration': 30.0, 'rate': 512.0, 'noise': NAN, 'seed': 7, 'out': 'next.csv',
        } for j in range(9)
    },
    'mr_damper_msgs/action/Design_Result': {
        'yes': {'success': True, 'message': 'm', 'run_file': '/tmp/next.csv', 'report': '{"schema": "mr-damper/design/1"}'},
    },
    'mr_damper_msgs/action/Design_Feedback': {'half': {'stage': 'designing the run', 'progress': 0.5}},
    'mr_damper_msgs/action/Identify_Goal': {
        f'model_{j}': {'model': 'm' * j, 'history': 30.0, 'out': 'fit.toml'} for j in range(9)
    },
    'mr_damper_msgs/action/Identify_Result': {
        'yes': {'success': True, 'message': 'RSSE 12.5 N', 'model_file': '/tmp/fit.toml'},
    },
    'mr_damper_msgs/action/Identify_Feedback': {'start': {'stage': '', 'progress': 0.0}},
    'lifecycle_msgs/msg/State': {'empty': state(0, ''), 'active': state()},
    'lifecycle_msgs/msg/Transition': {'configure': state(1, 'configure')},
    'lifecycle_msgs/msg/TransitionDescription': {'activate': transition()},
    'lifecycle_msgs/msg/TransitionEvent': {'activate': {'timestamp': 1_700_000_000_123_456_789, **transition()}},
    'lifecycle_msgs/srv/GetState_Request': {'empty': {'structure_needs_at_least_one_member': 0}},
    'lifecycle_msgs/srv/GetState_Response': {'active': {'current_state': state()}},
    'lifecycle_msgs/srv/ChangeState_Request': {'activate': {'transition': state(3, 'activate')}},
    'lifecycle_msgs/srv/ChangeState_Response': {'yes': {'success': True}},
    'lifecycle_msgs/srv/GetAvailableStates_Request': {'empty': {'structure_needs_at_least_one_member': 0}},
    'lifecycle_msgs/srv/GetAvailableStates_Response': {
        'none': {'available_states': []}, 'two': {'available_states': [state(2, 'inactive'), state()]},
    },
    'lifecycle_msgs/srv/GetAvailableTransitions_Request': {'empty': {'structure_needs_at_least_one_member': 0}},
    'lifecycle_msgs/srv/GetAvailableTransitions_Response': {
        'none': {'available_transitions': []}, 'two': {'available_transitions': [transition(), transition()]},
    },
    'rcl_interfaces/msg/ParameterValue': {
        'unset': parameter(0), 'bool': parameter(1, bool_value=True), 'integer': parameter(2, integer_value=-7),
        'double': parameter(3, double_value=0.25), 'nan': parameter(3, double_value=NAN),
        'string': parameter(4, string_value='auto'), 'bytes': parameter(5, byte_array_value=[1, 2, 255]),
        'bools': parameter(6, bool_array_value=[True, False]),
        'integers': parameter(7, integer_array_value=[1, -2, 3]),
        'doubles': parameter(8, double_array_value=[0.5, -1.5]),
        'strings': parameter(9, string_array_value=['a', 'bcd']),
    },
    'rcl_interfaces/msg/Parameter': {f'name_{j}': named('n' * j) for j in range(9)},
    'rcl_interfaces/msg/FloatingPointRange': {'unit': {'from_value': 0.0, 'to_value': 1.0, 'step': 0.0}},
    'rcl_interfaces/msg/IntegerRange': {'bits': {'from_value': -1, 'to_value': 232, 'step': 1}},
    'rcl_interfaces/msg/ParameterDescriptor': {
        'plain': descriptor(), 'double': descriptor(
            floating_point_range=[{'from_value': 0.0, 'to_value': 3600.0, 'step': 0.0}]),
        'integer': descriptor(integer_range=[{'from_value': -1, 'to_value': 232, 'step': 1}], read_only=True),
    },
    'rcl_interfaces/msg/ParameterEvent': {
        'empty': {'stamp': time(), 'node': '/mr_damper', 'new_parameters': [], 'changed_parameters': [],
                  'deleted_parameters': []},
        'changed': {'stamp': time(), 'node': '/a/b', 'new_parameters': [named('x')],
                    'changed_parameters': [named('y'), named('zz')], 'deleted_parameters': []},
    },
    'rcl_interfaces/msg/SetParametersResult': {'no': {'successful': False, 'reason': 'out of range'}},
    'rcl_interfaces/msg/ListParametersResult': {'one': {'names': ['a.b'], 'prefixes': ['a']}},
    'rcl_interfaces/msg/Log': {
        'warn': {'stamp': time(), 'level': 30, 'name': 'front_left.mr_damper', 'msg': 'late', 'file': 'a.rs',
                 'function': 'm', 'line': 7},
    },
    'rcl_interfaces/srv/GetParameters_Request': {'two': {'names': ['a', 'bc']}},
    'rcl_interfaces/srv/GetParameters_Response': {'one': {'values': [parameter(3, double_value=0.25)]}},
    'rcl_interfaces/srv/GetParameterTypes_Request': {'none': {'names': []}},
    'rcl_interfaces/srv/GetParameterTypes_Response': {'two': {'types': [3, 0]}},
    'rcl_interfaces/srv/SetParameters_Request': {'two': {'parameters': [named('a'), named('bcd')]}},
    'rcl_interfaces/srv/SetParameters_Response': {'one': {'results': [{'successful': True, 'reason': ''}]}},
    'rcl_interfaces/srv/SetParametersAtomically_Request': {'one': {'parameters': [named('a')]}},
    'rcl_interfaces/srv/SetParametersAtomically_Response': {
        'no': {'result': {'successful': False, 'reason': 'out of range'}},
    },
    'rcl_interfaces/srv/ListParameters_Request': {'all': {'prefixes': [], 'depth': 0}, 'one': {'prefixes': ['a'], 'depth': 1}},
    'rcl_interfaces/srv/ListParameters_Response': {'one': {'result': {'names': ['a.b'], 'prefixes': ['a']}}},
    'rcl_interfaces/srv/DescribeParameters_Request': {'one': {'names': ['a']}},
    'rcl_interfaces/srv/DescribeParameters_Response': {'two': {'descriptors': [descriptor(), descriptor()]}},
    'type_description_interfaces/msg/FieldType': {'force': field()['type']},
    'type_description_interfaces/msg/Field': {'force': field()},
    'type_description_interfaces/msg/IndividualTypeDescription': {'force': described()},
    'type_description_interfaces/msg/TypeDescription': {
        'alone': {'type_description': described(), 'referenced_type_descriptions': []},
        'with': {'type_description': described(), 'referenced_type_descriptions': [described(), described()]},
    },
    'type_description_interfaces/msg/TypeSource': {
        'force': {'type_name': 'a/msg/B', 'encoding': 'msg', 'raw_file_contents': 'float64 x\n'},
    },
    'type_description_interfaces/msg/KeyValue': {'pair': {'key': 'k', 'value': 'v'}},
    'type_description_interfaces/srv/GetTypeDescription_Request': {
        'one': {'type_name': 'a/msg/B', 'type_hash': 'RIHS01_00', 'include_type_sources': True},
    },
    'type_description_interfaces/srv/GetTypeDescription_Response': {
        'no': {'successful': False, 'failure_reason': 'no such type', 'type_description': {
            'type_description': {'type_name': '', 'fields': []}, 'referenced_type_descriptions': []},
            'type_sources': [], 'extra_information': []},
        'yes': {'successful': True, 'failure_reason': '', 'type_description': {
            'type_description': described(), 'referenced_type_descriptions': [described()]},
            'type_sources': [{'type_name': 'a/msg/B', 'encoding': 'msg', 'raw_file_contents': 'float64 x\n'}],
            'extra_information': [{'key': 'k', 'value': 'v'}]},
    },
}


def build(store, name, value):
    """The rosbags object for one JSON-like value."""
    kind = store.types[name]
    fields = dict(store.fielddefs[name][1])
    assert set(fields) == set(value), (name, set(fields) ^ set(value))
    made = {}
    for key, (node, inner) in fields.items():
        item = value[key]
        if node.name == 'NAME':
            item = build(store, inner, item)
        elif node.name == 'SEQUENCE':
            (element, of), _ = inner
            if element.name == 'NAME':
                item = [build(store, of, i) for i in item]
            elif of[0] != 'string':
                # numpy's byte is signed.
                item = numpy.array(item, dtype='uint8' if of[0] == 'byte' else of[0])
        made[key] = item
    return kind(**made)


def plain(value):
    """Replaces NaN by None: JSON has no NaN, and the Rust side reads null as NaN."""
    if isinstance(value, dict):
        return {k: plain(v) for k, v in value.items()}
    if isinstance(value, list):
        return [plain(v) for v in value]
    return None if isinstance(value, float) and math.isnan(value) else value


def cdr_table(store):
    yield '# Made by generate.py; do not edit.'
    yield '# type\tcase\tJSON\tlittle endian CDR\tbig endian CDR'
    for name, cases in sorted(CASES.items()):
        for case, value in cases.items():
            message = build(store, name, value)
            little = bytes(store.serialize_cdr(message, name, little_endian=True)).hex()
            big = bytes(store.serialize_cdr(message, name, little_endian=False)).hex()
            text = json.dumps(plain(value), ensure_ascii=False, separators=(',', ':'))
            yield '\t'.join([name, case, text, little, big])


def hash_table(store, names):
    yield '# Made by generate.py; do not edit.'
    yield '# type\tRIHS01 hash'
    for name in sorted(names):
        yield f'{name}\t{store.hash_rihs01(name)}'


def rosidl_differences(prefixes, hashes):
    """Yields a line for each hash that differs from rosidl's or that rosidl did not install."""
    installed = {}
    packages = sorted({name.split('/')[0] for name in hashes})
    for prefix in prefixes:
        for package in packages:
            for path in sorted((Path(prefix) / 'share' / package).glob('*/*.json')):
                for entry in json.loads(path.read_text())['type_hashes']:
                    installed[entry['type_name']] = entry['hash_string']
    for name, ours in hashes.items():
        theirs = installed.get(name)
        if theirs is None:
            yield f'{name}: rosidl installed no hash under {" ".join(prefixes)}'
        elif theirs != ours:
            yield f'{name}: rosbags {ours}, rosidl {theirs}'
    print(f'{len(hashes.keys() & installed.keys())} of {len(hashes)} hashes compared with rosidl')


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--check', action='store_true')
    parser.add_argument('--rosidl', metavar='PREFIX', nargs='+')
    options = parser.parse_args()

    store, ours, services = load()
    messages = ours + STANDARD
    names = messages + services
    missing = set(messages) ^ set(CASES)
    if missing:
        sys.exit(f'add these to CASES, or define their types: {sorted(missing)}')

    troubles = []
    for file, lines in [('cdr.tsv', cdr_table(store)), ('hashes.tsv', hash_table(store, names))]:
        text = '\n'.join(lines) + '\n'
        path = HERE / file
        if not options.check:
            path.write_text(text)
        elif not path.exists() or path.read_text() != text:
            troubles.append(f'{path} differs from what generate.py writes: run it without --check')
    if options.rosidl:
        troubles += rosidl_differences(options.rosidl, {name: store.hash_rihs01(name) for name in names})
    if troubles:
        sys.exit('\n'.join(troubles))


if __name__ == '__main__':
    main()
