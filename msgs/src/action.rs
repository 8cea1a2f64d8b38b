//! The actions of `mr_damper_msgs`, defined by the `.action` files.

use serde::{Deserialize, Serialize};

use crate::Action;
use crate::message::{message, section};
use crate::nan;

/// Diagnoses the loaded model on recent data: finds a missing effect, names it and adds it to the
/// model.
#[derive(Clone, Copy, Debug)]
pub struct CloseLoop;

impl Action for CloseLoop {
    type Goal = CloseLoopGoal;
    type Result = CloseLoopResult;
    type Feedback = CloseLoopFeedback;
    const PACKAGE: &'static str = "mr_damper_msgs";
    const NAME: &'static str = "CloseLoop";
    const TYPE: &'static str = "mr_damper_msgs/action/CloseLoop";
}

/// Goal of [`CloseLoop`].
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CloseLoopGoal {
    /// Length of the recent data to use, in s.
    #[serde(deserialize_with = "nan::or_null")]
    pub history: f64,
}
message!(
    CloseLoopGoal,
    "mr_damper_msgs" / "action" / "CloseLoop_Goal",
    "23b65ddc6276b62e3e76a61983d49f1c166b0746a4fc0e048f897f082bf277c1",
    section(include_str!("../action/CloseLoop.action"), 0)
);

/// Result of [`CloseLoop`].
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct CloseLoopResult {
    /// Whether the diagnosis succeeded.
    pub success: bool,
    /// The diagnosis report as JSON, schema `mr-damper/close/1`.
    pub report: String,
}
message!(
    CloseLoopResult,
    "mr_damper_msgs" / "action" / "CloseLoop_Result",
    "03a62f53b153f0f87267718a3df319751d68e24a8c3ec581932b77ec8b023c57",
    section(include_str!("../action/CloseLoop.action"), 1)
);

/// Feedback of [`CloseLoop`].
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CloseLoopFeedback {
    /// Current stage, as text for people.
    pub stage: String,
    /// From 0 to 1.
    pub progress: f32,
}
message!(
    CloseLoopFeedback,
    "mr_damper_msgs" / "action" / "CloseLoop_Feedback",
    "8e332bd6edc165e9cf3a31a539207ef84486e7d4e18066a6100b4d6cc13e5754",
    section(include_str!("../action/CloseLoop.action"), 2)
);

/// Designs the run that best tells apart effects that a diagnosis could not, for the loaded model.
#[derive(Clone, Copy, Debug)]
pub struct Design;

impl Action for Design {
    type Goal = DesignGoal;
    type Result = DesignResult;
    type Feedback = DesignFeedback;
    const PACKAGE: &'static str = "mr_damper_msgs";
    const NAME: &'static str = "Design";
    const TYPE: &'static str = "mr_damper_msgs/action/Design";
}

/// Goal of [`Design`].
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DesignGoal {
    /// Effects to tell apart, such as `friction|gas_spring, inertia`. Empty: what `report` leaves open.
    pub question: String,
    /// JSON report of a diagnosis; empty if there is none.
    pub report: String,
    /// Largest displacement to either side of the middle, in m.
    #[serde(deserialize_with = "nan::or_null")]
    pub stroke: f64,
    /// Largest speed, in m/s.
    #[serde(deserialize_with = "nan::or_null")]
    pub speed: f64,
    /// Largest acceleration, in m/s²; 0: 10.
    #[serde(deserialize_with = "nan::or_null")]
    pub acceleration: f64,
    /// Smallest drive, in A or V as the drive of the model.
    #[serde(deserialize_with = "nan::or_null")]
    pub drive_min: f64,
    /// Largest drive, in A or V; both 0 for a model without a drive.
    #[serde(deserialize_with = "nan::or_null")]
    pub drive_max: f64,
    /// Duration of the run, in s; 0: 30.
    #[serde(deserialize_with = "nan::or_null")]
    pub duration: f64,
    /// Rate of the samples, in Hz; 0: 512.
    #[serde(deserialize_with = "nan::or_null")]
    pub rate: f64,
    /// Noise and misfit of the model, root mean square, in N; 0: that of the report, or of the model.
    #[serde(deserialize_with = "nan::or_null")]
    pub noise: f64,
    /// Another seed gives another run.
    pub seed: u64,
    /// Path of the run to write, on the node's machine; empty: a new CSV file.
    pub out: String,
}
message!(
    DesignGoal,
    "mr_damper_msgs" / "action" / "Design_Goal",
    "a47b4bf8c9444cc322c15c7ddead6b9b3f6bda5f9be28d65270286f22b044379",
    section(include_str!("../action/Design.action"), 0)
);

/// Result of [`Design`].
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct DesignResult {
    /// Whether a run was designed and written.
    pub success: bool,
    /// What the run decides; on failure, the cause and what to do.
    pub message: String,
    /// Path of the written run; empty if none was written.
    pub run_file: String,
    /// The figures as JSON, schema `mr-damper/design/1`; empty if no run was written.
    pub report: String,
}
message!(
    DesignResult,
    "mr_damper_msgs" / "action" / "Design_Result",
    "38bf8d7a50d8cc617039f52da6fb7e958f1b6ef666c8d23bb5dad4843356ae39",
    section(include_str!("../action/Design.action"), 1)
);

/// Feedback of [`Design`].
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DesignFeedback {
    /// Current stage, as text for people.
    pub stage: String,
    /// From 0 to 1.
    pub progress: f32,
}
message!(
    DesignFeedback,
    "mr_damper_msgs" / "action" / "Design_Feedback",
    "9586b323a44284fc76faef536c50ddfc41be8b20073b6a33711983c871940f85",
    section(include_str!("../action/Design.action"), 2)
);

/// Fits one model to recent data.
#[derive(Clone, Copy, Debug)]
pub struct Identify;

impl Action for Identify {
    type Goal = IdentifyGoal;
    type Result = IdentifyResult;
    type Feedback = IdentifyFeedback;
    const PACKAGE: &'static str = "mr_damper_msgs";
    const NAME: &'static str = "Identify";
    const TYPE: &'static str = "mr_damper_msgs/action/Identify";
}

/// Goal of [`Identify`].
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct IdentifyGoal {
    /// Model name, such as `fuzzy-tanh`.
    pub model: String,
    /// Length of the recent data to use, in s.
    #[serde(deserialize_with = "nan::or_null")]
    pub history: f64,
    /// Path of the model file to write, on the node's machine.
    pub out: String,
}
message!(
    IdentifyGoal,
    "mr_damper_msgs" / "action" / "Identify_Goal",
    "27a17034c794f2f100c1dcc2330420bb5e6239cb2f8e383a1042c52626d6be94",
    section(include_str!("../action/Identify.action"), 0)
);

/// Result of [`Identify`].
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct IdentifyResult {
    /// Whether a model was fitted and written.
    pub success: bool,
    /// The fitted model and how well it fits; on failure, the cause and what to do.
    pub message: String,
    /// Path of the written model file; empty if none was written.
    pub model_file: String,
}
message!(
    IdentifyResult,
    "mr_damper_msgs" / "action" / "Identify_Result",
    "ba1c08092cdaabf681f58e08fee6dcd40ea36589cce77338c6f0b1d04bdeaede",
    section(include_str!("../action/Identify.action"), 1)
);

/// Feedback of [`Identify`].
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct IdentifyFeedback {
    /// Current stage, as text for people.
    pub stage: String,
    /// From 0 to 1.
    pub progress: f32,
}
message!(
    IdentifyFeedback,
    "mr_damper_msgs" / "action" / "Identify_Feedback",
    "e59cf099ca6ec0fac30e376ca512cb4fc3961de9163c21fec75f2ca6bad6d0dc",
    section(include_str!("../action/Identify.action"), 2)
);
