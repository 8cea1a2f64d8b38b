//! The inverse model: the coil current that gives a demanded force.
//!
//! ```text
//! demand ──→ dissipative? ──→ clip to what the damper can ──→ F(i, x, v, states) = Fd ──→ lead ──→ rate, saturation ──→ current
//!                                      ↑                              ↑
//!                              F(0), F(i_max)              bias ← measured force - F
//! ```
//!
//! A semi-active damper takes energy out and cannot bring any in: at each motion it has the forces from F(0) to F(i_max) and
//! no others. What is asked for beyond them is clipped to the nearer end, and the command says why. [`Solver`] seeks the
//! current for any forward model by a bracketed search with a bounded number of steps; it needs a force that grows with
//! the current one way, which [`Shape`] looks at on a grid when a model is loaded. A [`Method`] other than the
//! search is fitted to the model then. [`Commander`] is what runs: it holds the
//! model's state, leads a coil that lags, learns the model's bias from a load cell, and never leaves its [`Limits`].
//! Which force is wanted is a [`Law`]'s business. [`track`] lets it follow a demand, on the model and on the rig.
//!
//! Like the rest of this crate: no clock, no allocation from sample to sample, no panic.

mod commander;
mod cycle;
mod fuzzy;
mod law;
mod limits;
mod method;
mod polynomial;
mod prepare;
mod shape;
mod solve;
mod surrogate;
pub mod track;

pub use commander::{Command, Commander};
pub use law::{Demand, Law};
pub use limits::{LimitedBy, Limits};
pub use method::Method;
pub use shape::{Fold, Shape};
pub use solve::{MOST_STEPS, Moment, Solution, Solver};
pub use surrogate::SurrogateFit;
