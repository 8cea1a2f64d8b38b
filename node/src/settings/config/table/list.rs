//! The entries of the parameter table: node, command, plausibility, inputs, mirror.

use super::Mutability::{Never, Running, Unconfigured};
use super::{Parameter, ParameterKind};
use crate::settings::config::{Value, use_force_name};
use crate::zenoh::session::Rmw;
use mr_damper_model::inverse::Method;
use mr_damper_model::pipeline::{Mode, UseForce};

const NODE: [Parameter; 3] = [
    truth!(
        "autostart",
        Never,
        "true: configure and activate the node at once; false: wait for change_state, as lifecycle managers need",
        autostart
    ),
    truth!(
        "use_sim_time",
        Running,
        "true: use the time of /clock; false: use the system's time",
        use_sim_time
    ),
    Parameter {
        name: "mode",
        kind: ParameterKind::Choice(&["auto", "arx", "model", "fault"]),
        mutability: Running,
        doc: "auto: the best mode whose conditions are met; otherwise only the given mode, or fault if its conditions are not met (fault: no estimates)",
        get: |c| Value::Text(c.settings.only_mode.map_or("auto", Mode::name).to_owned()),
        set: |c, v| {
            if let Value::Text(t) = v {
                c.settings.only_mode =
                    [Mode::Arx, Mode::Model, Mode::Fault].into_iter().find(|mode| mode.name() == t);
            }
        },
    },
];

const MAIN: [Parameter; 33] = [
    list!(
        "dampers",
        "names of several dampers; each is a node in its own namespace, with parameters below its name (front_left.model); empty: the node itself is the damper",
        dampers
    ),
    text!(
        "model",
        ParameterKind::Text,
        Unconfigured,
        "model for simulation (free run): a preset (`mr-damper presets`) or a model file",
        model
    ),
    text!(
        "arx_model",
        ParameterKind::Text,
        Unconfigured,
        "ARX model, seeded with measured force: a preset, a model file, none, or auto (the thesis' best ARX model if model is a thesis preset, else none)",
        arx_model
    ),
    Parameter {
        name: "use_measured_force",
        kind: ParameterKind::Choice(&["auto", "never", "observer"]),
        mutability: Running,
        doc: "auto: measured force seeds the ARX model while it is fresh; observer: it corrects the simulation by a bias; never: it is used for the residual only",
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
    truth!(
        "boada.learn",
        Running,
        "true: a boada model learns from measured force while it runs; load_model and reset forget what was learned, and no file changes",
        settings.lazy_learning
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
        "gap between displacements beyond which the history restarts, s",
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
        "factor over the model's expected RMSE that is still normal; a residual that stays above it raises the alarm",
        settings.alarm_ratio
    ),
    double!(
        "residual.alarm_block_s",
        0.05..=10.0,
        Running,
        "length of the blocks over which the alarm computes the residual's power, s",
        settings.alarm_block_s
    ),
    double!(
        "residual.false_alarm_interval_s",
        60.0..=1e9,
        Running,
        "minimum of the mean time between false alarms, s",
        settings.false_alarm_interval_s
    ),
    double!(
        "history.duration_s",
        10.0..=3600.0,
        Running,
        "length of the raw input that is kept for the action close_loop, s; naming an effect needs at least 30 s of motion",
        history_duration_s
    ),
    truth!(
        "effects.track",
        Running,
        "true: estimate the ratio of the measured to the expected force and the values of the model's effects, publish them on effect_values after each window, and report a change",
        effects.track
    ),
    double!(
        "effects.window_s",
        48.0..=86400.0,
        Running,
        "length of a window from which the values of effects are estimated, s",
        effects.tracking.window_s
    ),
    double!(
        "effects.false_alarm_interval_s",
        3600.0..=1e10,
        Running,
        "minimum of the mean time between false alarms about changed values of effects, s of time with a residual",
        effects.tracking.false_alarm_interval_s
    ),
    truth!(
        "effects.adapt",
        Running,
        "true: with effects.track, the running model takes estimated values of its effects; its base stays as it is, and no file changes",
        effects.adapt
    ),
    double!(
        "effects.adapt_share",
        0.01..=1.0,
        Running,
        "largest difference of an adapted value to the value in the model file, as a share of the latter",
        effects.adapt_share
    ),
    text!(
        "fleet.out",
        ParameterKind::Text,
        Running,
        "folder in which rows about the damper are kept, a CSV file an hour for each table, in the layout of the Python module mr_damper.fleet; empty: nowhere",
        fleet_out
    ),
    text!(
        "close_loop.out",
        ParameterKind::Text,
        Running,
        "directory of the model files that the action close_loop writes, on the node's machine; empty: the system's temporary directory",
        close_loop_out
    ),
    truth!(
        "close_loop.auto_load",
        Running,
        "true: load the model that the action close_loop has found automatically; false: it is loaded only by a call of load_model",
        close_loop_auto_load
    ),
    text!(
        "filter.apply_to",
        ParameterKind::Choice(&["model", "inputs", "output", "none"]),
        Running,
        "where the low-pass acts: as in the model file (model), on displacement (inputs), on the model's output and the force it is compared with (output), or nowhere (none)",
        filter_apply_to
    ),
    double!(
        "filter.cutoff_hz",
        0.0..=10000.0,
        Running,
        "corner frequency of the low-pass, Hz, if filter.apply_to is set; 0: as in the model file",
        filter_cutoff_hz
    ),
    double!(
        "align_wait_s",
        0.0..=1.0,
        Never,
        "how long a displacement waits for drive, velocity and force with the same stamp, if these share stamps, s",
        align_wait_s
    ),
    double!(
        "deadline_s",
        0.0..=10.0,
        Never,
        "longest time from the receipt of a displacement to the publication of its estimate, s; later estimates are counted as missed_deadlines on /diagnostics; 0: no deadline",
        deadline_s
    ),
    integer!(
        "realtime_priority",
        -1..=99,
        Never,
        "SCHED_FIFO priority of the threads on the path of every sample, including the DDS library's; if the system refuses it, the node runs without it and warns; 0: none; -1: 20 if the system permits it, else none, without a warning",
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
        "hosts (IPv4 addresses or names) to which the node announces itself where multicast does not reach; the node is then reachable from the network; empty: ROS_STATIC_PEERS",
        discovery_peers
    ),
    text!(
        "discovery_range",
        ParameterKind::Choice(&["system_default", "localhost", "subnet"]),
        Never,
        "which machines can find the node; system_default: ROS_AUTOMATIC_DISCOVERY_RANGE or ROS_LOCALHOST_ONLY, else localhost",
        discovery_range
    ),
];

const COMMAND: [Parameter; 16] = [
    text!(
        "law",
        ParameterKind::Choice(&["off", "follow", "skyhook", "groundhook", "fixed"]),
        Running,
        "control law for the current; off: no current; follow: the current for the force_request, once one has arrived; skyhook, groundhook: \
         the current for a damper between body and sky, or wheel and ground (both need body_velocity); fixed: fixed.current_a",
        law
    ),
    Parameter {
        name: "inverse.method",
        kind: ParameterKind::Choice(&["search", "polynomial", "fuzzy", "chen", "wang-liao", "wang-hu"]),
        mutability: Running,
        doc: "how the current for a demanded force is found: by a search on the model; by a polynomial or fuzzy inverse that is fitted to the model when it is loaded; or by the inverse model chen, wang-liao or wang-hu, if mr-damper identify --inverse has put it into the model file",
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
    double_list!(
        "skyhook.gains_n_s_m",
        0.0..=1e6,
        Running,
        "dampings between body and sky at the currents skyhook.centres_a, blended by fuzzy sets over the current, N s/m; empty: skyhook.damping_n_s_m at all currents",
        skyhook_gains_n_s_m
    ),
    double_list!(
        "skyhook.centres_a",
        0.0..=100.0,
        Running,
        "increasing currents at which skyhook.gains_n_s_m hold, A; the sets are half as wide as the currents are apart",
        skyhook_centres_a
    ),
    double!(
        "groundhook.damping_n_s_m",
        0.0..=1e6,
        Running,
        "damping between wheel and ground, N s/m",
        groundhook_n_s_m
    ),
    double!("fixed.current_a", 0.0..=100.0, Running, "current of the control law fixed, A", fixed_a),
    double!(
        "request_timeout_s",
        0.001..=3600.0,
        Running,
        "age beyond which a force_request, body_velocity or displacement has no effect any more, s",
        settings.request_timeout_s
    ),
    double!(
        "current.max_a",
        0.001..=100.0,
        Running,
        "largest current of the driver, A; no larger current is commanded, and a measured current far above it is flagged",
        settings.limits.current_max_a
    ),
    Parameter {
        name: "current.rate_max_a_s",
        kind: ParameterKind::Double(0.0, 1e9),
        mutability: Running,
        doc: "largest rate of change of the driver's current, A/s; 0: unknown, so the rate is not limited",
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
        "safe current, A; commanded when no force is demanded any more or the motion is unknown",
        settings.limits.safe_a
    ),
    double!(
        "current.safe_after_s",
        0.0..=60.0,
        Running,
        "time to reach the safe current, s",
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
        "time constant of the coil current with lead compensation, s; used if the model includes a coil lag",
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
        "gain of the feedback of demanded minus measured force, 1; 0: no feedback",
        settings.limits.feedback_gain
    ),
];

const PLAUSIBLE: [Parameter; 5] = [
    double!(
        "plausible.displacement_max_m",
        1e-6..=1e9,
        Running,
        "largest displacement in either direction, m; larger values are refused",
        settings.plausible.displacement_max_m
    ),
    double!(
        "plausible.speed_max_m_s",
        1e-6..=1e9,
        Running,
        "largest speed of the rod, m/s; a higher measured speed is refused, and so is a displacement that would need a higher speed, until three agree",
        settings.plausible.speed_max_m_s
    ),
    double!(
        "plausible.force_max_n",
        1e-6..=1e9,
        Running,
        "largest force in either direction, N; larger values are refused, measured or demanded",
        settings.plausible.force_max_n
    ),
    double!(
        "plausible.stuck_s",
        1e-6..=1e9,
        Running,
        "how long displacement can stand still, while the rod is known to move, before it is flagged, s",
        settings.plausible.stuck_s
    ),
    double!(
        "plausible.passive_window_s",
        1e-6..=1e9,
        Running,
        "time constant over which the measured force must absorb energy, s",
        settings.plausible.passive_window_s
    ),
];

const STANDARD: [Parameter; 5] = [
    truth!(
        "standard.wrench",
        Never,
        "true: publish the force also on force_estimate_wrench, as geometry_msgs/msg/WrenchStamped; NaN unless the estimate is valid or degraded",
        standard.wrench
    ),
    text!(
        "standard.axis",
        ParameterKind::Choice(&["x", "y", "z"]),
        Never,
        "axis of the frame along which the wrench has the force",
        standard.axis
    ),
    truth!(
        "standard.joint_state",
        Never,
        "true: publish the force also on force_estimate_joint_state, as effort in sensor_msgs/msg/JointState; NaN unless the estimate is valid or degraded",
        standard.joint_state
    ),
    text!(
        "standard.joint",
        ParameterKind::Text,
        Never,
        "joint of force_estimate_joint_state; empty: the damper's name",
        standard.joint
    ),
    truth!(
        "standard.float64",
        Never,
        "true: publish force and commanded current also on force_estimate_float64 and current_command_float64, as std_msgs/msg/Float64; the force is NaN unless the estimate is valid or degraded",
        standard.float64
    ),
];

const ZENOH: [Parameter; 11] = [
    list!(
        "zenoh.listen",
        "endpoints that the Zenoh mirror listens on, e.g. ['tcp/127.0.0.1:7447']; empty: it does not listen",
        zenoh.listen
    ),
    list!("zenoh.connect", "endpoints of Zenoh routers or peers that the mirror connects to", zenoh.connect),
    text!(
        "zenoh.mode",
        ParameterKind::Choice(&["", "peer", "client", "router"]),
        Never,
        "role in the Zenoh network; empty: as in zenoh.config, else peer",
        zenoh.mode
    ),
    text!(
        "zenoh.config",
        ParameterKind::Text,
        Never,
        "Zenoh's own configuration file (JSON5) for TLS, users, access control, downsampling; endpoints and mode given here \
         override it; examples are in launch-configs/zenoh/",
        zenoh.config
    ),
    list!(
        "zenoh.commands",
        "commands that are accepted from Zenoh: force_request, load_model, set_mode; empty: none",
        zenoh.commands
    ),
    text!(
        "zenoh.model_dir",
        ParameterKind::Text,
        Never,
        "directory of the model files that the Zenoh command load_model can load; empty: presets only",
        zenoh.model_dir
    ),
    text!(
        "zenoh.rmw",
        ParameterKind::Choice(&Rmw::NAMES),
        Never,
        "visibility for nodes on rmw_zenoh in the same domain; publish: they see the node and its outputs; both: also its inputs, \
         which they can then publish as over DDS; off: nothing",
        zenoh.rmw
    ),
    text!(
        "zenoh.encoding",
        ParameterKind::Choice(&["cbor", "json", "cdr"]),
        Never,
        "encoding of the state/ keys",
        zenoh.encoding
    ),
    double!("zenoh.web_rate_hz", 20.0..=50.0, Never, "highest rate of the web/ keys, Hz", zenoh.web_rate_hz),
    double!(
        "zenoh.history_s",
        0.0..=600.0,
        Never,
        "length of the history that late joiners can query, s",
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

/// All parameters.
pub(super) fn all() -> impl Iterator<Item = Parameter> {
    NODE.into_iter()
        .chain(MAIN)
        .chain(COMMAND)
        .chain(PLAUSIBLE)
        .chain(INPUTS.into_iter().flatten())
        .chain(STANDARD)
        .chain(super::can::CAN)
        .chain(ZENOH)
}

/// Converts an infinite number, which means "none", to zero, which means the same in a parameter.
fn finite_or_zero(number: f64) -> f64 {
    if number.is_finite() { number } else { 0.0 }
}
