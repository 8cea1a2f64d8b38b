//! Configuration of the node: one table of parameters behind file, ROS parameters and flags.
//!
//! Sources in order of increasing precedence: defaults, configuration file (`--config`), ROS parameters (`--ros-args`,
//! `--params-file`), flags. [`dampers`] combines them. At run time, the ROS parameter services change the parameters
//! that the table marks for this.

mod assignment;
mod dampers;
mod file;
mod flags;
mod foreign;
mod params_file;
pub mod qos;
pub mod ros_args;
mod session;
mod table;
mod value;

pub use assignment::Assignment;
pub use dampers::{Damper, dampers};
pub use flags::{ParameterFlags, UnlistedParameterFlags};
pub use ros_args::RosArgs;
pub use session::{rmw, zenoh_config};
pub use table::{Mutability, Parameter, ParameterKind, TABLE, find, is_known};
pub use value::Value;

use crate::settings::error::NodeError;
use mr_damper_model::condition::ApplyTo;
use mr_damper_model::inverse::{ControlLaw, SkyhookGains};
use mr_damper_model::pipeline::{Settings, UseForce};
use mr_damper_model::tracking::TrackingSettings;
use qos::Overrides;

/// Configuration of one input topic.
#[derive(Debug, Clone, PartialEq)]
pub struct InputConfig {
    /// Message type: the project's own, `std_msgs/msg/Float64`, or `sensor_msgs/msg/JointState`.
    pub message_type: String,
    /// Joint that is read from a `JointState`.
    pub joint: String,
    /// 1 or -1: converts the sensor's sign to this project's convention (extension and tension are positive).
    pub sign: f64,
    /// Subtracted from the reading before the sign is applied, in the reading's SI unit.
    pub offset: f64,
}

impl Default for InputConfig {
    fn default() -> Self {
        Self { message_type: String::new(), joint: String::new(), sign: 1.0, offset: 0.0 }
    }
}

/// The outputs as standard messages.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StandardSettings {
    /// Publish the force as `geometry_msgs/msg/WrenchStamped`.
    pub wrench: bool,
    /// Axis of the frame along which the wrench has the force: `x`, `y` or `z`.
    pub axis: String,
    /// Publish the force as effort in `sensor_msgs/msg/JointState`.
    pub joint_state: bool,
    /// Joint of this message; empty: the damper's name.
    pub joint: String,
    /// Publish the force and the commanded current as `std_msgs/msg/Float64`.
    pub float64: bool,
}

impl Default for StandardSettings {
    fn default() -> Self {
        Self { wrench: false, axis: "x".to_owned(), joint_state: false, joint: String::new(), float64: false }
    }
}

/// The use of a CAN bus.
#[derive(Debug, Clone, PartialEq)]
pub struct CanSettings {
    /// The interface; empty: no bus.
    pub interface: String,
    /// DBC files that describe the messages of the bus.
    pub dbc: Vec<String>,
    /// Inputs, each with its signal: `displacement=SUSP_FL.Position`.
    pub map: Vec<String>,
    /// Messages whose alive counter and checksum are checked: `SUSP_FL,counter=Alive,checksum=Crc`.
    pub check: Vec<String>,
    /// Outputs, each with its message and signals: `force_estimate=DAMPER_FL,force=Force`.
    pub out: Vec<String>,
    /// Shortest time between two frames of one output, s.
    pub period_s: f64,
}

impl Default for CanSettings {
    fn default() -> Self {
        let (dbc, map, check, out) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        Self { interface: String::new(), dbc, map, check, out, period_s: 0.01 }
    }
}

/// Settings of the Zenoh mirror.
#[derive(Debug, Clone, PartialEq)]
pub struct ZenohSettings {
    /// Endpoints to listen on. The mirror is off if `connect` and `config` are empty as well.
    pub listen: Vec<String>,
    /// Endpoints to connect to.
    pub connect: Vec<String>,
    /// `peer`, `client` or `router`; empty: as in `config`, else peer.
    pub mode: String,
    /// Zenoh's own configuration file (JSON5); empty: none.
    pub config: String,
    /// Commands that are accepted from Zenoh: `force_request`, `load_model`, `set_mode`.
    pub commands: Vec<String>,
    /// Directory of the model files that may be loaded over Zenoh; empty: presets only.
    pub model_dir: String,
    /// Visibility for nodes on rmw_zenoh: `off`, `publish` or `both`.
    pub rmw: String,
    /// `cbor`, `json` or `cdr`.
    pub encoding: String,
    /// Rate of the `web/` keys, Hz.
    pub web_rate_hz: f64,
    /// Length of the history that late joiners can query, s.
    pub history_s: f64,
    /// Allow endpoints beyond this machine.
    pub allow_non_loopback: bool,
}

/// How the values of the model's effects are followed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EffectSettings {
    /// Estimate the values from measured force.
    pub track: bool,
    /// Windows, and the rate of false alarms.
    pub tracking: TrackingSettings,
    /// Let the running model take the estimates.
    pub adapt: bool,
    /// Largest difference of an adapted value to the loaded one, as a share of the latter.
    pub adapt_share: f64,
}

/// The node's configuration.
#[derive(Debug, Clone, PartialEq)]
pub struct Config {
    /// Configure and activate the node at once.
    pub autostart: bool,
    /// Use the time of `/clock`.
    pub use_sim_time: bool,
    /// Names of the process's dampers; empty: the node itself is the damper.
    pub dampers: Vec<String>,
    /// Preset name or model file of the model for simulation (free run).
    pub model: String,
    /// Preset name or model file of the ARX model; `none`; or `auto`: the thesis' best ARX model for thesis presets,
    /// otherwise none.
    pub arx_model: String,
    /// Settings of the pipeline.
    pub settings: Settings,
    /// `filter.apply_to`; `model` for the model file's own setting.
    pub filter_apply_to: String,
    /// `filter.cutoff_hz`; 0 for the model file's own value.
    pub filter_cutoff_hz: f64,
    /// Displacement input.
    pub displacement: InputConfig,
    /// Velocity input.
    pub velocity: InputConfig,
    /// Coil current input.
    pub coil_current: InputConfig,
    /// Command voltage input.
    pub command_voltage: InputConfig,
    /// Measured force input.
    pub measured_force: InputConfig,
    /// Input of the body's velocity.
    pub body_velocity: InputConfig,
    /// Input of demanded forces.
    pub force_request: InputConfig,
    /// Time constant of the observer, s.
    pub observer_tau_s: f64,
    /// `off`, `follow`, `skyhook`, `groundhook` or `fixed`.
    pub law: String,
    /// Damping of the control law skyhook, N s/m.
    pub skyhook_n_s_m: f64,
    /// Dampings of the control law skyhook at the currents `skyhook_centres_a`, N s/m; empty: `skyhook_n_s_m` at all currents.
    pub skyhook_gains_n_s_m: Vec<f64>,
    /// Currents of `skyhook_gains_n_s_m`, A.
    pub skyhook_centres_a: Vec<f64>,
    /// Damping of the control law groundhook, N s/m.
    pub groundhook_n_s_m: f64,
    /// Current of the control law fixed, A.
    pub fixed_a: f64,
    /// Length of the raw input that is kept for `close_loop`, s.
    pub history_duration_s: f64,
    /// How the values of the model's effects are followed.
    pub effects: EffectSettings,
    /// Folder in which rows about the damper are kept, an hour at a time; empty: nowhere.
    pub fleet_out: String,
    /// Directory of the model files that `close_loop` writes; empty: the system's temporary directory.
    pub close_loop_out: String,
    /// Load the model found by `close_loop` automatically.
    pub close_loop_auto_load: bool,
    /// How long a displacement waits for drive, velocity and force with the same stamp, s.
    pub align_wait_s: f64,
    /// Longest time from the receipt of a displacement to the publication of its estimate, s; 0: no limit.
    pub deadline_s: f64,
    /// `SCHED_FIFO` priority of the threads on the path of every sample; 0: none; -1: 20 if the system permits it.
    pub realtime_priority: i64,
    /// ROS domain; negative: `ROS_DOMAIN_ID`, else 0.
    pub domain_id: i64,
    /// `localhost`, `subnet` or `system_default`.
    pub discovery_range: String,
    /// Hosts to which the node announces itself by unicast; empty: `ROS_STATIC_PEERS`.
    pub discovery_peers: Vec<String>,
    /// QoS of topics that differs from the node's own.
    pub qos: Overrides,
    /// Outputs as standard messages.
    pub standard: StandardSettings,
    /// CAN bus.
    pub can: CanSettings,
    /// Zenoh mirror.
    pub zenoh: ZenohSettings,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            autostart: true,
            use_sim_time: false,
            dampers: Vec::new(),
            model: String::new(),
            arx_model: "auto".to_owned(),
            settings: Settings::default(),
            filter_apply_to: "model".to_owned(),
            filter_cutoff_hz: 0.0,
            displacement: InputConfig::default(),
            velocity: InputConfig::default(),
            coil_current: InputConfig::default(),
            command_voltage: InputConfig::default(),
            measured_force: InputConfig::default(),
            body_velocity: InputConfig::default(),
            force_request: InputConfig::default(),
            observer_tau_s: 0.2,
            law: "follow".to_owned(),
            skyhook_n_s_m: 1500.0,
            skyhook_gains_n_s_m: Vec::new(),
            skyhook_centres_a: Vec::new(),
            groundhook_n_s_m: 1500.0,
            fixed_a: 0.0,
            history_duration_s: 120.0,
            effects: EffectSettings {
                track: false,
                tracking: TrackingSettings::default(),
                adapt: false,
                adapt_share: 0.2,
            },
            fleet_out: String::new(),
            close_loop_out: String::new(),
            close_loop_auto_load: false,
            align_wait_s: 0.05,
            deadline_s: 0.0,
            realtime_priority: -1,
            domain_id: -1,
            discovery_range: "system_default".to_owned(),
            discovery_peers: Vec::new(),
            qos: Overrides::default(),
            standard: StandardSettings::default(),
            can: CanSettings::default(),
            zenoh: ZenohSettings {
                listen: Vec::new(),
                connect: Vec::new(),
                mode: String::new(),
                config: String::new(),
                commands: Vec::new(),
                model_dir: String::new(),
                rmw: "off".to_owned(),
                encoding: "cbor".to_owned(),
                web_rate_hz: 30.0,
                history_s: 10.0,
                allow_non_loopback: false,
            },
        }
    }
}

impl Config {
    /// Sets the parameter called `name`: one of the table, or a QoS override.
    ///
    /// # Errors
    /// [`NodeError::Parameter`] with the name, the value and the accepted values; the configuration is then unchanged.
    pub fn set(&mut self, name: &str, value: &Value) -> Result<(), NodeError> {
        if Overrides::are_meant(name) {
            return self.qos.set(name, value);
        }
        let parameter = find(name)?;
        let value = parameter.check(value)?;
        (parameter.set)(self, &value);
        Ok(())
    }

    /// The value of the parameter called `name`.
    ///
    /// # Errors
    /// [`NodeError::UnknownParameter`] when the parameter does not exist.
    pub fn get(&self, name: &str) -> Result<Value, NodeError> {
        match self.qos.get(name) {
            Some(value) => Ok(value.clone()),
            None => Ok((find(name)?.get)(self)),
        }
    }

    /// The settings of the pipeline that result from all parameters.
    #[must_use]
    pub fn pipeline_settings(&self, model_cutoff_hz: f64) -> Settings {
        let cutoff_hz = if self.filter_cutoff_hz > 0.0 { self.filter_cutoff_hz } else { model_cutoff_hz };
        let apply_to = match self.filter_apply_to.as_str() {
            "inputs" => Some(ApplyTo::Inputs),
            "output" => Some(ApplyTo::Output),
            "none" => Some(ApplyTo::None),
            _ => None,
        };
        let use_measured_force = match self.settings.use_measured_force {
            UseForce::Observer(_) => UseForce::Observer(self.observer_tau_s),
            other => other,
        };
        let law = match self.law.as_str() {
            "off" => ControlLaw::Off,
            "skyhook" if self.skyhook_gains_n_s_m.is_empty() && self.skyhook_centres_a.is_empty() => {
                ControlLaw::Skyhook(self.skyhook_n_s_m)
            }
            "skyhook" => ControlLaw::SkyhookGains(SkyhookGains::new(
                &self.skyhook_gains_n_s_m,
                &self.skyhook_centres_a,
            )),
            "groundhook" => ControlLaw::Groundhook(self.groundhook_n_s_m),
            "fixed" => ControlLaw::Fixed(self.fixed_a),
            _ => ControlLaw::Follow,
        };
        let filter = apply_to.map(|apply_to| (apply_to, cutoff_hz));
        let stamp_ahead_s =
            if self.use_sim_time { Settings::SIMULATED_STAMP_AHEAD_S } else { self.settings.stamp_ahead_s };
        Settings { filter, use_measured_force, law, stamp_ahead_s, ..self.settings }
    }
}

/// `auto`, `never` or `observer`.
pub(crate) const fn use_force_name(use_force: UseForce) -> &'static str {
    match use_force {
        UseForce::Auto => "auto",
        UseForce::Never => "never",
        UseForce::Observer(_) => "observer",
    }
}
