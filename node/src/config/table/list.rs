//! The parameters themselves: node, command, plausibility, inputs, mirror.

use super::Change::{Never, Running, Unconfigured};
use super::{Kind, Parameter};
use crate::config::{Value, use_force_name};
use crate::sink::zenoh::Rmw;
use mr_damper_model::inverse::Method;
use mr_damper_model::pipeline::{Mode, UseForce};

const NODE: [Parameter; 3] = [
    truth!(
        "autostart",
        Never,
        "true: configure and activate the node at once; false: wait for change_state, as a lifecycle manager wants it",
        autostart
    ),
    truth!("use_sim_time", Running, "true: the time is what /clock says; false: the system's", use_sim_time),
    Parameter {
        name: "mode",
        kind: Kind::Choice(&["auto", "arx", "model", "fault"]),
        change: Running,
        doc: "auto: the best mode that its conditions allow; else only that one, or fault where it cannot be (fault: no estimates)",
        get: |c| Value::Text(c.settings.only_mode.map_or("auto", Mode::name).to_owned()),
        set: |c, v| {
            if let Value::Text(t) = v {
                c.settings.only_mode =
                    [Mode::Arx, Mode::Model, Mode::Fault].into_iter().find(|mode| mode.name() == t);
            }
        },
    },
];

const MAIN: [Parameter; 26] = [
    list!(
        "dampers",
        "names of several dampers, each a node in a namespace of its own with parameters below its name (front_left.model); none: the node is the damper",
        dampers
    ),
    text!(
        "model",
        Kind::Text,
        Unconfigured,
        "free-running model: a preset (`mr-damper presets`) or a model file",
        model
    ),
    text!(
        "arx_model",
        Kind::Text,
        Unconfigured,
        "ARX model that measured force seeds: a preset, a model file, none, or auto (the thesis' best ARX beside a thesis preset, else none)",
        arx_model
    ),
    Parameter {
        name: "use_measured_force",
        kind: Kind::Choice(&["auto", "never", "observer"]),
        change: Running,
        doc: "auto: measured force seeds the ARX model while it is fresh; observer: it corrects the free-running model through a bias; never: it serves the residual alone",
        get: |c| Value::Text(use_force_name(c.settings.use_measured_force).to_owned()),
        set: |c, v| {
            if let Value::Text(t) = v {
                c.settings.use_measured_force = match t.as_str() {
                    "never" => UseForce::Never,
                    "observer" => UseForce::Observer(c.observer_tau_s),
                    _ => UseForce::Auto,
                };
            }
        },
    },
    double!(
        "observer_tau_s",
        0.001..=3600.0,
        Running,
        "time constant with which the observer follows measured force, s",
        observer_tau_s
    ),
    double!(
        "force_timeout_s",
        0.001..=3600.0,
        Running,
        "age beyond which measured force counts as lost, s",
        settings.force_timeout_s
    ),
    double!(
        "coast_s",
        0.0..=3600.0,
        Running,
        "how long ARX runs on its own predictions after measured force is lost, s",
        settings.coast_s
    ),
    double!(
        "input_timeout_s",
        0.001..=3600.0,
        Running,
        "age beyond which displacement and drive count as stale, s",
        settings.input_timeout_s
    ),
    double!(
        "hold_s",
        0.0..=3600.0,
        Running,
        "how long the last estimate is held, flagged, when no model can run, s",
        settings.hold_s
    ),
    double!(
        "bumpless_tau_s",
        0.0..=3600.0,
        Running,
        "time constant with which the step at a change of mode decays, s",
        settings.bumpless_tau_s
    ),
    double!(
        "gap_s",
        0.001..=3600.0,
        Running,
        "gap between displacements beyond which history starts anew, s",
        settings.gap_s
    ),
    double!(
        "residual.window_s",
        0.01..=3600.0,
        Running,
        "time constant of the windowed residual figures, s",
        settings.residual_window_s
    ),
    double!(
        "residual.alarm_ratio",
        1.0..=1000.0,
        Running,
        "factor over the model's expected RSSE that is no fault yet; a residual that stays above it raises the alarm",
        settings.alarm_ratio
    ),
    double!(
        "residual.alarm_block_s",
        0.05..=10.0,
        Running,
        "length of the blocks over which the alarm takes the residual's power, s",
        settings.alarm_block_s
    ),
    double!(
        "residual.false_alarm_interval_s",
        60.0..=1e9,
        Running,
        "mean time between false alarms, at least, s",
        settings.false_alarm_interval_s
    ),
    double!(
        "history.duration_s",
        10.0..=3600.0,
        Running,
        "length of the raw input that is kept for the action close_loop, s; 30 s of motion are the least that names anything",
        history_duration_s
    ),
    text!(
        "close_loop.out",
        Kind::Text,
        Running,
        "directory of the model files that the action close_loop writes, on the node's machine; empty: the system's temporary directory",
        close_loop_out
    ),
    truth!(
        "close_loop.auto_load",
        Running,
        "true: swap the model that the action close_loop has found in, unasked; false: load_model does, when somebody calls it",
        close_loop_auto_load
    ),
    text!(
        "filter.apply_to",
        Kind::Choice(&["model", "inputs", "output", "none"]),
        Running,
        "where the low-pass sits: on displacement, on the model's output (and the force it is compared with), nowhere, or as the model file says",
        filter_apply_to
    ),
    double!(
        "filter.cutoff_hz",
        0.0..=10000.0,
        Running,
        "corner of the low-pass, Hz, when filter.apply_to is set; 0: the model file's",
        filter_cutoff_hz
    ),
    double!(
        "align_wait_s",
        0.0..=1.0,
        Never,
        "how long a displacement waits for drive, velocity and force of its stamp, where they share stamps, s",
        align_wait_s
    ),
    double!(
        "deadline_s",
        0.0..=10.0,
        Never,
        "how long after the receipt of its displacement an estimate has to be published, s; later ones are counted as missed_deadlines on /diagnostics; 0: no deadline",
        deadline_s
    ),
    integer!(
        "realtime_priority",
        0..=99,
        Never,
        "SCHED_FIFO priority of the threads that every sample passes, DDS's among them; where the system refuses, the node runs without and says so; 0: none",
        realtime_priority
    ),
    integer!(
        "domain_id",
        -1..=232,
        Never,
        "ROS domain; -1: ROS_DOMAIN_ID from the environment, else 0",
        domain_id
    ),
    list!(
        "discovery_peers",
        "hosts (IPv4 addresses or names) that are told of the node where no multicast reaches them; the node then leaves this machine; none: ROS_STATIC_PEERS",
        discovery_peers
    ),
    text!(
        "discovery_range",
        Kind::Choice(&["system_default", "localhost", "subnet"]),
        Never,
        "who may find the node; system_default: ROS_AUTOMATIC_DISCOVERY_RANGE or ROS_LOCALHOST_ONLY, else localhost",
        discovery_range
    ),
];

const COMMAND: [Parameter; 14] = [
    text!(
        "law",
        Kind::Choice(&["off", "follow", "skyhook", "groundhook", "fixed"]),
        Running,
        "what current is commanded: none at all; that of a force_request, once one has come; that of a damper between body and sky, or wheel and ground (both want body_velocity); a fixed one",
        law
    ),
    Parameter {
        name: "inverse.method",
        kind: Kind::Choice(&["search", "polynomial", "fuzzy"]),
        change: Running,
        doc: "how the current for a force is found: a search on the model, or a polynomial or fuzzy inverse that is fitted to it when it is loaded",
        get: |c| Value::Text(c.settings.method.name().to_owned()),
        set: |c, v| {
            if let Value::Text(t) = v {
                c.settings.method = Method::named(t).unwrap_or_default();
            }
        },
    },
    double!(
        "skyhook.damping_n_s_m",
        0.0..=1e6,
        Running,
        "damping between body and sky, N s/m",
        skyhook_n_s_m
    ),
    double!(
        "groundhook.damping_n_s_m",
        0.0..=1e6,
        Running,
        "damping between wheel and ground, N s/m",
        groundhook_n_s_m
    ),
    double!("fixed.current_a", 0.0..=100.0, Running, "current of the law fixed, A", fixed_a),
    double!(
        "request_timeout_s",
        0.001..=3600.0,
        Running,
        "age beyond which a force_request, body_velocity or displacement commands nothing any more, s",
        settings.request_timeout_s
    ),
    double!(
        "current.max_a",
        0.001..=100.0,
        Running,
        "largest current that the driver makes, A; none above it is commanded, and a measured one far above it is flagged",
        settings.limits.current_max_a
    ),
    Parameter {
        name: "current.rate_max_a_s",
        kind: Kind::Double(0.0, 1e9),
        change: Running,
        doc: "largest rate at which the driver's current changes, A/s; 0: not known, none is kept to",
        get: |c| Value::Double(finite_or_zero(c.settings.limits.rate_max_a_s)),
        set: |c, v| {
            if let Value::Double(x) = v {
                c.settings.limits.rate_max_a_s = if *x > 0.0 { *x } else { f64::INFINITY };
            }
        },
    },
    double!(
        "current.safe_a",
        0.0..=100.0,
        Running,
        "current to go to when nobody asks for anything any more or the motion is not known, A",
        settings.limits.safe_a
    ),
    double!(
        "current.safe_after_s",
        0.0..=60.0,
        Running,
        "how long that takes, s",
        settings.limits.safe_after_s
    ),
    double!(
        "current.hold_m_s",
        0.0..=1.0,
        Running,
        "speed below which the last current is held, m/s",
        settings.limits.hold_m_s
    ),
    double!(
        "current.lead_s",
        0.0..=60.0,
        Running,
        "time constant to which a coil's lag that the model knows is led, s",
        settings.limits.lead_s
    ),
    double!(
        "current.feedback_s",
        0.0..=60.0,
        Running,
        "time constant with which the inverse learns the model's bias from measured force, s",
        settings.limits.feedback_s
    ),
    double!(
        "current.feedback_gain",
        0.0..=5.0,
        Running,
        "how much of what the measured force misses is asked for on top, 1; 0 for none",
        settings.limits.feedback_gain
    ),
];

const PLAUSIBLE: [Parameter; 5] = [
    double!(
        "plausible.displacement_max_m",
        1e-6..=1e9,
        Running,
        "largest displacement either way, m; more is refused",
        settings.plausible.displacement_max_m
    ),
    double!(
        "plausible.speed_max_m_s",
        1e-6..=1e9,
        Running,
        "largest speed of the rod, m/s; a measured one above it is refused, and a displacement that would need more, until three agree",
        settings.plausible.speed_max_m_s
    ),
    double!(
        "plausible.force_max_n",
        1e-6..=1e9,
        Running,
        "largest force either way, N; more is refused, measured or asked for",
        settings.plausible.force_max_n
    ),
    double!(
        "plausible.stuck_s",
        1e-6..=1e9,
        Running,
        "how long displacement stands still, while the rod is known to move, before it is flagged, s",
        settings.plausible.stuck_s
    ),
    double!(
        "plausible.passive_window_s",
        1e-6..=1e9,
        Running,
        "time constant over which measured force must take energy, s",
        settings.plausible.passive_window_s
    ),
];

const ZENOH: [Parameter; 11] = [
    list!(
        "zenoh.listen",
        "endpoints that the Zenoh mirror listens on, e.g. ['tcp/127.0.0.1:7447']; none: it does not listen",
        zenoh.listen
    ),
    list!("zenoh.connect", "endpoints of Zenoh routers or peers that the mirror connects to", zenoh.connect),
    text!(
        "zenoh.mode",
        Kind::Choice(&["", "peer", "client", "router"]),
        Never,
        "how to take part in the Zenoh network; empty: as zenoh.config says, else peer",
        zenoh.mode
    ),
    text!(
        "zenoh.config",
        Kind::Text,
        Never,
        "configuration file of Zenoh's own (JSON5) for TLS, users, access control, downsampling; endpoints and mode given here are \
         stronger; launch-configs/zenoh/ has some",
        zenoh.config
    ),
    list!(
        "zenoh.commands",
        "commands that are taken from Zenoh: force_request, load_model, set_mode; none: nobody commands by Zenoh",
        zenoh.commands
    ),
    text!(
        "zenoh.model_dir",
        Kind::Text,
        Never,
        "directory of the model files that the Zenoh command load_model may name; empty: presets only",
        zenoh.model_dir
    ),
    text!(
        "zenoh.rmw",
        Kind::Choice(&Rmw::NAMES),
        Never,
        "what nodes on rmw_zenoh in the same domain see; publish: the node and its outputs; both: its inputs too, which are then taken \
         from them as over DDS; off: nothing",
        zenoh.rmw
    ),
    text!(
        "zenoh.encoding",
        Kind::Choice(&["cbor", "json", "cdr"]),
        Never,
        "encoding of the state/ keys",
        zenoh.encoding
    ),
    double!("zenoh.web_rate_hz", 1.0..=50.0, Never, "highest rate of the web/ keys, Hz", zenoh.web_rate_hz),
    double!(
        "zenoh.history_s",
        0.0..=600.0,
        Never,
        "length of the history that a late joiner can ask for, s",
        zenoh.history_s
    ),
    truth!(
        "zenoh.allow_non_loopback",
        Never,
        "allow Zenoh endpoints beyond this machine",
        zenoh.allow_non_loopback
    ),
];

const INPUTS: [[Parameter; 4]; 7] = [
    input!(displacement, "mr_damper_msgs/msg/Displacement", "m"),
    input!(velocity, "mr_damper_msgs/msg/Velocity", "m/s"),
    input!(coil_current, "mr_damper_msgs/msg/CoilCurrent", "A"),
    input!(command_voltage, "mr_damper_msgs/msg/CommandVoltage", "V"),
    input!(measured_force, "mr_damper_msgs/msg/Force", "N"),
    input!(body_velocity, "mr_damper_msgs/msg/Velocity", "m/s"),
    input!(force_request, "mr_damper_msgs/msg/Force", "N"),
];

/// All of them.
pub(super) fn all() -> impl Iterator<Item = Parameter> {
    NODE.into_iter()
        .chain(MAIN)
        .chain(COMMAND)
        .chain(PLAUSIBLE)
        .chain(INPUTS.into_iter().flatten())
        .chain(ZENOH)
}

/// A number that says "none" by being infinite, as one that says it by being zero.
fn finite_or_zero(number: f64) -> f64 {
    if number.is_finite() { number } else { 0.0 }
}
