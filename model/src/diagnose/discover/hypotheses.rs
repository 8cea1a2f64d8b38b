//! Hypotheses about the cause of a term.

use super::{Claim, FoundTerm};
use crate::effect::term::{Argument, Form, Modulator};

/// A possible cause of a term. It is a hypothesis: the data show the term, not its cause.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Hypothesis {
    /// The cause.
    pub cause: &'static str,
    /// A test that would distinguish it from the others.
    pub test: &'static str,
}

impl FoundTerm {
    /// Possible causes of terms like this, the likeliest first.
    #[must_use]
    pub fn hypotheses(&self) -> Vec<Hypothesis> {
        let (modulator, argument, form) = self.term.kind();
        let fits = |(test, _): &&(Test, Hypothesis)| test(modulator, argument, form);
        let causes = HYPOTHESES.iter().filter(fits).map(|(_, hypothesis)| *hypothesis);
        let may_be_base = !matches!(self.claim, Claim::Effect { .. });
        let of_base = may_be_base && argument == Argument::Drive && modulator != Modulator::ForcePerDrive;
        of_base.then_some(COARSE_BASE).into_iter().chain(causes).collect()
    }
}

/// True for the terms that a hypothesis is about.
type Test = fn(Modulator, Argument, Form) -> bool;

const fn hypothesis(cause: &'static str, test: &'static str) -> Hypothesis {
    Hypothesis { cause, test }
}

fn scales_force(modulator: Modulator) -> bool {
    matches!(
        modulator,
        Modulator::Force
            | Modulator::ForceInExtension
            | Modulator::ForceInCompression
            | Modulator::DriveSignVelocity
    )
}

/// Cause of a term over the drive, unless a healthy run has shown that it is an effect.
const COARSE_BASE: Hypothesis = hypothesis(
    "no fault: the base follows the drive too coarsely, by its fuzzy sets or its polynomial",
    "the same runs with a base of more fuzzy sets (`mr-damper identify --sets`)",
);

/// Causes by what a term depends on. A term may have several.
const HYPOTHESES: &[(Test, Hypothesis)] = &[
    (
        |_, _, g| g == Form::Resonance,
        hypothesis(
            "the mount of the damper or of the load cell swings",
            "a blow on the mount with the damper at rest; a stiffer mount",
        ),
    ),
    (
        |m, q, g| scales_force(m) && q.counts_from_start() && matches!(g, Form::Step | Form::Staircase),
        hypothesis(
            "a sudden loss: a leak of the valve or a seal, or a fault of the coil",
            "the coil's resistance; a run at zero current",
        ),
    ),
    (
        |m, q, g| scales_force(m) && q.counts_from_start() && !matches!(g, Form::Step | Form::Staircase),
        hypothesis("the fluid warms, wears or settles", "a rest of some minutes, then the same run again"),
    ),
    (
        |m, q, _| m == Modulator::ForcePerDrive && q.counts_from_start(),
        hypothesis(
            "the driver's current drifts, or the coil warms at a constant voltage",
            "the current at the coil, measured by another sensor",
        ),
    ),
    (
        |m, q, _| matches!(m, Modulator::One | Modulator::SignVelocity) && q.counts_from_start(),
        hypothesis("seal friction or the load cell's zero changes", "the force at rest before and after"),
    ),
    (
        |_, q, g| matches!(q, Argument::Displacement | Argument::DisplacementSignVelocity) && g == Form::Sine,
        hypothesis(
            "a thread, tool marks or a periodic fault of the guide",
            "slow strokes at zero current; the wavelength on the rod",
        ),
    ),
    (
        |_, q, g| {
            matches!(
                q,
                Argument::Displacement | Argument::DisplacementMagnitude | Argument::DisplacementSignVelocity
            ) && matches!(g, Form::Bump | Form::Step | Form::Window | Form::HingeAbove | Form::HingeBelow)
        },
        hypothesis(
            "a scratch, a dent, or a stop of the cylinder at this place",
            "slow strokes across the place, at several currents",
        ),
    ),
    (
        |_, q, g| {
            matches!(q, Argument::Travel | Argument::TimeSinceReversal)
                && matches!(g, Form::Window | Form::Decay | Form::Tanh | Form::Step)
        },
        hypothesis(
            "play of the mount, or gas in the fluid, that is taken up after each reversal",
            "the same stroke with a preload; another mount",
        ),
    ),
    (
        |m, _, _| matches!(m, Modulator::ForceInExtension | Modulator::ForceInCompression),
        hypothesis("a check valve or cavitation in one direction", "more gas pressure"),
    ),
    (
        |m, q, _| {
            scales_force(m)
                && matches!(
                    q,
                    Argument::MeanSpeed | Argument::Speed | Argument::Velocity | Argument::Acceleration
                )
        },
        hypothesis(
            "aeration or shear thinning of the fluid in fast strokes",
            "fast strokes after a long rest; another gas pressure",
        ),
    ),
    (
        |_, q, g| q == Argument::Force && g != Form::Resonance,
        hypothesis(
            "a blow-off valve, or a load path that yields with the force",
            "slow strokes at large current",
        ),
    ),
    (
        |m, q, _| m == Modulator::ForcePerDrive && q == Argument::Drive,
        hypothesis(
            "the driver saturates or has an offset or a dead zone",
            "the current at the coil, measured by another sensor",
        ),
    ),
    (
        |_, q, _| matches!(q, Argument::DriveChange | Argument::TimeSinceDriveChange),
        hypothesis(
            "the field lags the current: eddy currents, or the time that the fluid needs",
            "steps of the current at a constant speed",
        ),
    ),
];
