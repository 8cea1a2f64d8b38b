//! Force models of magneto-rheological (MR) dampers: identification from recorded runs, simulation, diagnosis of missing physical
//! effects, and the current for a demanded force.
//!
//! # Tutorial
//!
//! **Load a published model** and compute a force. The presets are the models of the thesis, see [`preset`]. A positive velocity extends
//! the damper, a positive force is tension on the rod.
//!
//! ```
//! use mr_damper_model::effect::AugmentedState;
//! use mr_damper_model::force::Inputs;
//! use mr_damper_model::preset;
//!
//! let published = preset::load("thesis/fuzzy-tanh/rp3-cs")?;
//! let extending = |drive| Inputs {
//!     dt_s: None,
//!     displacement_m: 0.0,
//!     velocity_m_s: 0.2,
//!     acceleration_m_s2: 0.0,
//!     drive, // the coil current, A
//!     case_temp_c: 25.0,
//! };
//! let force_n = |drive| published.free_run(&mut AugmentedState::default(), &extending(drive));
//! let (soft_n, hard_n) = (force_n(0.0).expect("finite"), force_n(2.5).expect("finite"));
//! assert!(0.0 < soft_n && 2.0 * soft_n < hard_n, "{soft_n} N without current, {hard_n} N at 2.5 A");
//! # Ok::<(), mr_damper_model::Error>(())
//! ```
//!
//! **Simulate two runs** on the virtual rig: ten seconds of one of the thesis' experiments, with noise of the transducers. The seed
//! selects the random motion, current and noise. **Identify** fuzzy-tanh on the first run, and **evaluate** it on the second one, which
//! the fit has not seen. An NMSE of 0.05 means that the model explains 95 % of the variance of the force. A recorded run is a
//! [`sample::Run`] too; `mr-damper-runs` reads CSV files and rosbags.
//!
//! ```
//! use mr_damper_model::evaluate::evaluate;
//! use mr_damper_model::identify::{ModelSpec, Options, Watch, identify};
//! use mr_damper_model::pipeline::Settings;
//! use mr_damper_model::rig::{Channels, Experiment, Plant, record};
//!
//! let experiment = Experiment::thesis("RP3-CS").expect("an experiment of the thesis").with_duration_s(10.0);
//! let run = |seed| record(&experiment, &Plant::default(), &Channels::default(), seed);
//!
//! let options = Options { restarts: 4, ..Options::default() };
//! let identified = identify(ModelSpec::FUZZY_TANH, &[run(1)], &options, &Watch::none())?;
//!
//! let evaluation = evaluate(identified.model, &run(2), Settings::default(), |_| true)?;
//! let error = evaluation.free_run.expect("the run has a force");
//! assert!(error.esr < 0.05, "RMSE {} N, NMSE {}", error.rsse_n, error.esr);
//! # Ok::<(), mr_damper_model::Error>(())
//! ```
//!
//! **Compute the current for a demanded force** with the inverse controller. A damper can only absorb energy, so it cannot deliver every
//! force. The command says whether the demand is achievable, and which force the model expects.
//!
//! ```
//! # use mr_damper_model::force::Inputs;
//! # use mr_damper_model::preset;
//! use mr_damper_model::inverse::{Demand, InverseController, LimitedBy, Limits};
//!
//! # let published = preset::load("thesis/fuzzy-tanh/rp3-cs")?;
//! # let extending = Inputs {
//! #     dt_s: Some(1.0 / 512.0), displacement_m: 0.0, velocity_m_s: 0.2, acceleration_m_s2: 0.0, drive: f64::NAN, case_temp_c: 25.0,
//! # };
//! let mut controller = InverseController::new(&published, Limits::default())?;
//! let command = controller.step(&extending, Demand::Force(400.0), None);
//! assert!(command.is_achievable && (command.expected.get() - 400.0).abs() < 1.0, "{command:?}");
//!
//! // A force that pushes while the damper extends would drive the rod.
//! let command = controller.step(&extending, Demand::Force(-400.0), None);
//! assert_eq!((command.is_achievable, command.limited_by), (false, LimitedBy::Passivity));
//! # Ok::<(), mr_damper_model::Error>(())
//! ```
//!
//! # Where to go on
//!
//! | task | module |
//! |---|---|
//! | force estimates and residuals, sample by sample, live or replayed | [`pipeline`] |
//! | name the effect that a model lacks | [`diagnose`] |
//! | follow the values of a model's effects while the damper runs | [`tracking`] |
//! | compare models over many experiments | [`compare`] |
//! | a standard deviation and a 90 % band for each estimate | [`calibrate`], [`uncertainty`] |
//! | write and read a model as a file | [`model_file`] |

pub mod calibrate;
pub mod compare;
pub mod condition;
pub mod diagnose;
mod edit_distance;
pub mod effect;
pub mod elementary;
pub mod error;
pub mod evaluate;
pub mod fis;
pub mod force;
pub mod identify;
pub mod inverse;
mod inverse_model;
mod lanes;
pub mod metrics;
pub mod model;
pub mod model_file;
mod parallel;
pub mod pipeline;
pub mod preset;
pub mod rig;
pub mod sample;
pub mod statistics;
pub mod tracking;
pub mod uncertainty;
pub mod units;

#[cfg(test)]
#[path = "../tests/oracles/mod.rs"]
mod numbers;

pub use error::Error;
