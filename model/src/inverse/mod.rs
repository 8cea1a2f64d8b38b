//! The inverse model: the coil current that gives a demanded force.
//!
//! ```text
//! demand ──→ dissipative? ──→ clip to the damper's range ──→ F(i, x, v, states) = Fd ──→ lead ──→ rate, saturation ──→ current
//!                                      ↑                              ↑
//!                              F(0), F(i_max)              bias ← measured force - F
//! ```
//!
//! A semi-active damper absorbs energy and cannot deliver any. At each motion its force lies between F(0) and F(i_max). A
//! demand outside this range is clipped to the nearer end, and the command says why. [`Solver`] finds the current for any
//! forward model by a bracketed search with a bounded number of steps. It needs a force that is monotonic in the current;
//! [`Shape`] checks this on a grid when a model is loaded. A surrogate [`Method`] is fitted to the model at the
//! same time; a learned inverse ([`InverseModel`]) was identified from runs, and comes with the model.
//! [`InverseController`] is the inverse controller that runs: it holds the model's state, compensates a coil lag with
//! a lead, learns the model's bias from a load cell, and stays within its [`Limits`]. A [`ControlLaw`] sets the
//! demanded force. [`track`] simulates how well a demand is followed, on the model and on the rig.
//!
//! Like the rest of this crate, the module reads no clock, does not allocate per sample and does not panic.

#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

mod control_law;
mod controller;
mod cycle;
mod fuzzy;
mod limits;
mod method;
mod parts;
mod polynomial;
mod prepare;
mod shape;
mod solve;
mod surrogate;
pub mod track;

pub use crate::inverse_model::{
    FuzzyAxis, InverseFuzzy, InverseKind, InverseModel, InverseNetwork, InverseScaling, InverseState,
};
pub use control_law::{ControlLaw, Demand, SkyhookGains};
pub use controller::{CurrentCommand, InverseController};
pub use limits::{LimitedBy, Limits};
pub use method::Method;
pub use parts::{InverseMap, InverseParts};
pub use shape::{Fold, Shape};
pub use solve::{MOST_STEPS, Moment, Solution, Solver};
pub use surrogate::SurrogateFit;
