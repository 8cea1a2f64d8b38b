//! The messages of `mr_damper_msgs`, defined by the `.msg` files.
//!
//! SI units (REP-103). Positive displacement and velocity extend the damper; positive force is tension on the rod.
//! NaN means unknown in the fields whose documentation allows it.

use serde::{Deserialize, Serialize};

use crate::definition::definition;
use crate::message::message;
use crate::nan;
use crate::standard::Header;
use crate::state::Reasons;

/// Displacement of the damper rod.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Displacement {
    /// When the sample was taken, and the frame of the damper.
    pub header: Header,
    /// Displacement in m; positive extends the damper.
    #[serde(deserialize_with = "nan::or_null")]
    pub displacement: f64,
    /// Variance in m^2; zero or negative is unknown.
    #[serde(deserialize_with = "nan::or_null")]
    pub variance: f64,
}
message!(
    Displacement,
    "mr_damper_msgs" / "msg" / "Displacement",
    "a396173d439a26bd2d68f5f701d40519e45d54b57f26fac73387b1979dcb2964",
    definition!(include_str!("../msg/Displacement.msg"), Header Time)
);

/// Velocity of the damper rod, or of the vehicle's body above the damper.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Velocity {
    /// When the sample was taken, and the frame of the damper.
    pub header: Header,
    /// Velocity in m/s; positive rod velocity extends the damper, positive body velocity points up.
    #[serde(deserialize_with = "nan::or_null")]
    pub velocity: f64,
    /// Variance in m^2/s^2; zero or negative is unknown.
    #[serde(deserialize_with = "nan::or_null")]
    pub variance: f64,
}
message!(
    Velocity,
    "mr_damper_msgs" / "msg" / "Velocity",
    "9dd37c8fb4333f3e997e53611b53ef5b148eaf66a668f37e770bc299320e5249",
    definition!(include_str!("../msg/Velocity.msg"), Header Time)
);

/// Current through the damper's coil.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CoilCurrent {
    /// When the sample was taken, and the frame of the damper.
    pub header: Header,
    /// Current in A, zero or positive.
    #[serde(deserialize_with = "nan::or_null")]
    pub current: f64,
    /// Variance in A^2; zero or negative is unknown.
    #[serde(deserialize_with = "nan::or_null")]
    pub variance: f64,
}
message!(
    CoilCurrent,
    "mr_damper_msgs" / "msg" / "CoilCurrent",
    "4962695619ddd943ff2f437c72165627710a4a916f3473db5fee92b232ab84b6",
    definition!(include_str!("../msg/CoilCurrent.msg"), Header Time)
);

/// Command voltage of the damper's driver, for dampers whose runs record voltage instead of current.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CommandVoltage {
    /// When the sample was taken, and the frame of the damper.
    pub header: Header,
    /// Voltage in V.
    #[serde(deserialize_with = "nan::or_null")]
    pub voltage: f64,
    /// Variance in V^2; zero or negative is unknown.
    #[serde(deserialize_with = "nan::or_null")]
    pub variance: f64,
}
message!(
    CommandVoltage,
    "mr_damper_msgs" / "msg" / "CommandVoltage",
    "5fb347375b34d68b7a0b7ebd8a5c3117df1342cecd6d0e4dcc33d70cad14c750",
    definition!(include_str!("../msg/CommandVoltage.msg"), Header Time)
);

/// Force of the damper on its rod, measured or requested.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Force {
    /// When the sample was taken, and the frame of the damper.
    pub header: Header,
    /// Force in N; positive is tension on the rod.
    #[serde(deserialize_with = "nan::or_null")]
    pub force: f64,
    /// Variance in N^2; zero or negative is unknown.
    #[serde(deserialize_with = "nan::or_null")]
    pub variance: f64,
}
message!(
    Force,
    "mr_damper_msgs" / "msg" / "Force",
    "cd7fad9be3a3db26d9125d3dc20f32c0fe1c6c690dafbaefde0ee10d8e8ba422",
    definition!(include_str!("../msg/Force.msg"), Header Time)
);

/// Estimated force of the damper, with its uncertainty and validity.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ForceEstimate {
    /// Stamp and frame of the displacement sample that caused this estimate.
    pub header: Header,
    /// Force in N; positive is tension on the rod. NaN when `validity` is `Invalid` and no force is available.
    #[serde(deserialize_with = "nan::or_null")]
    pub force: f64,
    /// Standard deviation of the force in N; NaN is unknown.
    #[serde(deserialize_with = "nan::or_null")]
    pub std_dev: f64,
    /// Name of the loaded model.
    pub model: String,
    /// A [`Mode`](crate::Mode).
    pub mode: u8,
    /// A [`Validity`](crate::Validity).
    pub validity: u8,
    /// Why `validity` is not `Valid`.
    pub reasons: Reasons,
    /// Displacement stamp minus stamp of the drive sample used, in s; NaN if no drive sample was used.
    #[serde(deserialize_with = "nan::or_null")]
    pub input_age: f64,
    /// Lower end of the 90 % interval in N; NaN is unknown.
    #[serde(deserialize_with = "nan::or_null")]
    pub band_low: f64,
    /// Upper end of the 90 % interval in N; NaN is unknown.
    #[serde(deserialize_with = "nan::or_null")]
    pub band_high: f64,
    /// True if the interval is calibrated on held-out runs of the model; false if it is computed from `std_dev`,
    /// assuming normal errors.
    pub band_calibrated: bool,
}
message!(
    ForceEstimate,
    "mr_damper_msgs" / "msg" / "ForceEstimate",
    "9dc78705ac5ed035bf624baa16dcbe27da337cfbb7421937be2c52883cc4de96",
    definition!(include_str!("../msg/ForceEstimate.msg"), Header Time)
);

/// Measured force compared with the model's prediction: how far to trust the model now.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ForceResidual {
    /// The stamp of the measured force, and the frame of the damper.
    pub header: Header,
    /// Measured force in N.
    #[serde(deserialize_with = "nan::or_null")]
    pub measured: f64,
    /// Simulated force (free run) in N: measured force is never fed back.
    #[serde(deserialize_with = "nan::or_null")]
    pub predicted: f64,
    /// Measured minus predicted, in N.
    #[serde(deserialize_with = "nan::or_null")]
    pub residual: f64,
    /// Residual divided by its expected standard deviation; NaN if that is unknown.
    #[serde(deserialize_with = "nan::or_null")]
    pub normalised: f64,
    /// RMSE over the window (RSSE in the thesis), in N; NaN before there are enough samples.
    #[serde(deserialize_with = "nan::or_null")]
    pub windowed_rsse: f64,
    /// NMSE over the window (error-to-signal ratio, ESR, in the thesis), dimensionless; NaN while it is undefined.
    #[serde(deserialize_with = "nan::or_null")]
    pub windowed_esr: f64,
    /// Time constant of the exponential forgetting, in s.
    #[serde(deserialize_with = "nan::or_null")]
    pub window: f64,
    /// The residual is larger than noise explains.
    pub alarm: bool,
}
message!(
    ForceResidual,
    "mr_damper_msgs" / "msg" / "ForceResidual",
    "38bba8b904b2ccb859d72bc44adedc94d2e4952c5bffeecaa981b749ef7e2ff1",
    definition!(include_str!("../msg/ForceResidual.msg"), Header Time)
);

/// Coil current that brings the damper's force as close as possible to a requested force.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CurrentCommand {
    /// The stamp of the sample that caused this command, and the frame of the damper.
    pub header: Header,
    /// Current in A; never NaN.
    #[serde(deserialize_with = "nan::or_null")]
    pub current: f64,
    /// Requested force in N; NaN if no force is requested.
    #[serde(deserialize_with = "nan::or_null")]
    pub force_requested: f64,
    /// Force in N that the model expects at this current; NaN is unknown.
    #[serde(deserialize_with = "nan::or_null")]
    pub force_expected: f64,
    /// The damper can give the requested force now.
    pub achievable: bool,
    /// The requested force takes energy out of the motion.
    pub dissipative: bool,
    /// A [`LimitedBy`](crate::LimitedBy).
    pub limited_by: u8,
    /// Smallest force that the damper can give at this motion, in N; NaN is unknown.
    #[serde(deserialize_with = "nan::or_null")]
    pub achievable_min: f64,
    /// Largest force that the damper can give at this motion, in N; NaN is unknown.
    #[serde(deserialize_with = "nan::or_null")]
    pub achievable_max: f64,
}
message!(
    CurrentCommand,
    "mr_damper_msgs" / "msg" / "CurrentCommand",
    "dc7ce57a11f98b8a5abd37e06778ecb3ccc943ea12cdf9213748af1df0a9f6aa",
    definition!(include_str!("../msg/CurrentCommand.msg"), Header Time)
);

/// The estimator changed its mode.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ModeChange {
    /// The stamp of the sample that caused the change, and the frame of the damper.
    pub header: Header,
    /// The [`Mode`](crate::Mode) before.
    pub from_mode: u8,
    /// The [`Mode`](crate::Mode) after.
    pub to_mode: u8,
    /// Reason, as text for people.
    pub reason: String,
}
message!(
    ModeChange,
    "mr_damper_msgs" / "msg" / "ModeChange",
    "e5f7a962c23525fa409c9158140c100ad502ddfd943fb6620d3cbbad2ceca112",
    definition!(include_str!("../msg/ModeChange.msg"), Header Time)
);

/// A value of an effect of the running model, estimated from measured force over a window.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct EffectValue {
    /// The stamp of the last sample of the window, and the frame of the damper.
    pub header: Header,
    /// Id of the effect, as in model files.
    pub effect: String,
    /// Form of the effect, as in model files; empty if it has only one.
    pub form: String,
    /// Name of the value, as in model files. It ends in the unit.
    pub parameter: String,
    /// The value in the running model.
    #[serde(deserialize_with = "nan::or_null")]
    pub running: f64,
    /// The estimate, in the same unit; NaN if the window does not determine it.
    #[serde(deserialize_with = "nan::or_null")]
    pub value: f64,
    /// Low end of its 95 % interval, which contains chance alone; NaN if the window does not determine it.
    #[serde(deserialize_with = "nan::or_null")]
    pub low: f64,
    /// High end of that interval.
    #[serde(deserialize_with = "nan::or_null")]
    pub high: f64,
    /// Length of the window, s.
    #[serde(deserialize_with = "nan::or_null")]
    pub window: f64,
    /// Number of windows that were compared so far, this one included.
    pub windows: u32,
    /// True from the window on that shows a change of the value, until another model is loaded.
    pub changed: bool,
}
message!(
    EffectValue,
    "mr_damper_msgs" / "msg" / "EffectValue",
    "afc6b29f59964b92477f7f307d57cb8ed686cd008bbe8d7980cd10efd6dc9632",
    definition!(include_str!("../msg/EffectValue.msg"), Header Time)
);
