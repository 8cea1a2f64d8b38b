//! Exports a model as C99 source for an electronic control unit (ECU).
//!
//! ```text
//! Model ── parameters ──┐                         ┌─ NAME.h: parameters, state, mrd_step
//!       └─ features ────┤                         │
//! c/*.c ── fragments ───┴─→ link, resolve, name ──┴─ NAME.c
//! ```
//!
//! The source computes what the free-run channel of the service computes, bit for bit: checks of the readings, conditioning, the force
//! model with its effects, and the reasons that the service publishes. It needs no heap, no C library and no globals: the caller holds the
//! state, and passes the parameters, which calibration may change at any time. Elementary functions are those of
//! [`mr_damper_model::elementary`], repeated line by line.
//!
//! # Fragments
//! A file in `c/` has one function of the exported code or a few, and begins with a comment that says what it computes. Lines in that
//! comment and after it guide the export:
//!
//! | line | meaning |
//! |---|---|
//! | `@needs a b` | the fragments `a.c` and `b.c` come before this one |
//! | `@header` | what follows goes to the header: types of the state |
//! | `@source` | what follows goes to the source, once |
//! | `@instance` | what follows goes to the source once for each effect of this kind |
//!
//! `#if MRD_FEATURE` ... `#else` ... `#endif` is resolved while exporting if the feature is one of ours, so the result contains no dead
//! code. `mrd_` and `MRD_` become the name of the export, so that several models fit into one program; `@WORD@` becomes what the export
//! puts there: the number of an effect (`@K@`), of the one inside (`@J@`), the field of a parameter.
//!
//! # Single precision
//! Fragments are in double precision. For [`Precision::Single`] the finished text is changed token by token, and `c/single/` has those
//! fragments that know how a number is stored, or how large its rounding error is.
//!
//! Not exported: modes and bumpless transfer between them, measured force and one-step prediction, plausibility checks over
//! several channels, and bands. The inverse controller follows requested forces; its other control laws and its feedback of measured
//! force are not exported. The correction of stamps that jitter is exported on request ([`CExport::corrected_stamps`]).

pub mod a2l;
pub mod arm;
pub mod board;
mod difference;
pub mod driver;
mod error;
mod features;
pub mod fmu;
pub mod footprint;
mod forces;
mod fragment;
mod inverse;
mod parameter;
mod precision;
mod source;
mod terms;
pub mod vectors;

pub use difference::Difference;
pub use error::ExportError;
pub use parameter::{CParameter, Shape};
pub use precision::Precision;
pub use source::{CExport, CSource};
