//! Physical effects that a force model may lack, one file each, and how they are added around it.
//!
//! ```text
//!   x, v, a, i, T ──→ effect 3 ──→ effect 2 ──→ effect 1 ──→ model
//!            F'   ←── effect 3 ←── effect 2 ←── effect 1 ←── F
//! ```
//!
//! An effect wraps a model, or a model that has effects already. It changes the inputs (the coil lag changes the current), the
//! force (friction adds to it), or both (a series spring solves for the force at which rod and piston agree). [`Augmented`] is a model
//! with up to [`MAX_EFFECTS`] of them. It runs like a model, is `Copy` and steps without allocating, so an augmented model can replace
//! the running one live. A `Model` (see [`crate::model`]) and a model file contain the same list:
//!
//! ```toml
//! [[effects]]                  # in order of application: the first one is nearest to the model
//! id = "coil_lag"
//! form = "rise_fall"           # where an id has more than one form
//! tau_rise_s = 0.005
//! tau_fall_s = 0.019
//! ```
//!
//! | rule | |
//! |---|---|
//! | absent | with its parameter at [`Parameter::neutral`] an effect changes the force by at most 1e-12 of it |
//! | steps | lags are exact for inputs that are linear between samples, at any rate and at a changing rate |
//! | gap | `dt_s == None` restarts every effect; so does a step that is not positive |
//! | not finite | an input that is not finite gives no force and changes no state; the next step covers its time |
//! | offset | the session's force offset does not come from the damper, so effects that scale the force leave it out |
//! | one-step-ahead | a model fed with measured force has the effects in its input, so with effects it is only simulated (free run) |
//!
//! # Metadata for the diagnosis
//! Each effect in [`Effect::ALL`] has a one-line description, and for each parameter a physical range. The range is relative to the
//! data's scales where dampers differ by orders of magnitude. Further it has the step at which its score is computed
//! ([`Effect::probe`]), the excitation that separates it from others, its confounders, and the channels it needs.
//!
//! # Adding an effect
//! Add one file to this directory, say `cavitation.rs`, which starts with the equation and contains
//!
//! ```ignore
//! pub(super) const ABOUT: About = About {
//!     id: "cavitation",                       // as in model files
//!     form: None,                             // a name, where another effect has the same id
//!     what: "...",
//!     parameters: &[Parameter::absolute("suction_n", [0.0, 500.0], 5.0)],
//!     separated_by: "...",
//!     confounders: &["asymmetry"],
//!     needs: &[],
//! };
//!
//! pub(super) fn step(suction_n: f64, state: &mut EffectState, inputs: &Inputs, inside: &mut Inside) -> Option<f64> {
//!     let force_n = inside.run(inputs)?;      // with changed inputs, if the effect acts on them
//!     Some(force_n.max(-suction_n))
//! }
//! ```
//!
//! Then add one line each to [`Effect`], [`Effect::ALL`], `Effect::about` and `EffectModel::step`. If one is missing, the code does not
//! compile, or for [`Effect::ALL`] a test fails. State goes into `state`: two first-order lags, three numbers and a delay line;
//! `state.force_inside` and `state.drive` give the time since the last valid sample. Model file, diagnosis, pipeline and the
//! tests for all effects then include it.

mod anti_alias_mismatch;
mod asymmetry;
mod coil_lag;
mod deadzone;
mod end_stop;
mod force_lag;
mod friction;
mod gas_spring;
mod inertia;
mod load_cell_drift;
mod parts;
mod position_dependence;
mod remanence;
mod run;
mod sensor_delay;
mod series_spring;
mod thermal_fade;
mod velocity_saturation;

pub use run::{Augmented, AugmentedState, EffectModel, Effects};

use crate::force::law::Scale;
use parts::Lag;
use run::{EffectState, Inside};

/// Largest number of effects around one model.
pub const MAX_EFFECTS: usize = 3;
/// Largest number of parameters of an effect.
pub const MAX_EFFECT_PARAMETERS: usize = 2;
/// Longest delay between channels that an effect can model, s.
pub const MAX_DELAY_S: f64 = 10e-3;

/// A physical effect, in one of its forms.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Effect {
    /// Lag of the coil, one time constant.
    CoilLag,
    /// Lag of the coil, with one time constant for rise and one for fall.
    CoilLagRiseFall,
    /// Remanence of the core.
    Remanence,
    /// Force that falls with the case temperature.
    ThermalFade,
    /// Stiffness of the gas.
    GasSpring,
    /// Mass that moves with the rod.
    Inertia,
    /// Coulomb friction.
    Friction,
    /// Different force in extension and compression.
    Asymmetry,
    /// First-order lag of the force.
    ForceLag,
    /// Spring in series with the damper.
    SeriesSpring,
    /// Delay between force and displacement.
    SensorDelay,
    /// Free play.
    Deadzone,
    /// Bumper near the ends of the stroke.
    EndStop,
    /// Drift of the load cell.
    LoadCellDrift,
    /// Force that changes along the stroke.
    PositionDependence,
    /// Force that is not linear in velocity at high speed.
    VelocitySaturation,
    /// Low-pass of the force channel.
    AntiAliasMismatch,
}

/// The constants of an effect, defined in its file.
#[derive(Debug, Clone, Copy)]
struct About {
    id: &'static str,
    form: Option<&'static str>,
    what: &'static str,
    parameters: &'static [Parameter],
    separated_by: &'static str,
    confounders: &'static [&'static str],
    needs: &'static [Need],
}

/// A channel that not every run has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Need {
    /// The drive.
    Drive,
    /// The case temperature.
    CaseTemperature,
}

impl Need {
    /// Name of the channel.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Drive => "drive",
            Self::CaseTemperature => "case_temp_c",
        }
    }
}

/// One parameter of an effect.
///
/// Range, probe and neutral value are multiples of a scale of the data, or in the parameter's unit if the scale is [`Scale::ONE`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameter {
    /// Name as in model files; ends in the unit.
    pub name: &'static str,
    /// Unit of the numbers below: powers of the largest force, displacement and velocity.
    pub scale: Scale,
    /// Range of physically plausible values.
    pub range: [f64; 2],
    /// Value at which the effect is absent. For a shape parameter (see [`Parameter::is_shape`]): the value at which it is held while
    /// the others are probed.
    pub neutral: f64,
    /// Small step from neutral at which a score is computed; zero for a shape parameter.
    pub probe: f64,
}

impl Parameter {
    /// A parameter in its own unit, neutral at zero.
    const fn absolute(name: &'static str, range: [f64; 2], probe: f64) -> Self {
        Self::relative(name, Scale::ONE, range, probe)
    }

    /// A parameter in scales of the data, neutral at zero.
    const fn relative(name: &'static str, scale: Scale, range: [f64; 2], probe: f64) -> Self {
        Self { name, scale, range, neutral: 0.0, probe }
    }

    /// A shape parameter (see [`Parameter::is_shape`]), held at `held` while others are probed.
    const fn shape(name: &'static str, scale: Scale, range: [f64; 2], held: f64) -> Self {
        Self { name, scale, range, neutral: held, probe: 0.0 }
    }

    /// True for a parameter that sets where or how the effect acts, not how strong it is: the effect is present at any value of it.
    #[must_use]
    pub const fn is_shape(&self) -> bool {
        self.probe == 0.0
    }

    /// The physical range in the parameter's unit, if its scale has the size `size` in the data.
    #[must_use]
    pub const fn range_at(&self, size: f64) -> [f64; 2] {
        [self.range[0] * size, self.range[1] * size]
    }

    /// Values allowed in a model: the physical range, extended to the neutral value. A range relative to the data limits only the sign,
    /// because a model does not know the data's scales.
    #[must_use]
    pub fn allowed(&self) -> [f64; 2] {
        let [low, high] = [self.range[0].min(self.neutral), self.range[1].max(self.neutral)];
        if self.scale == Scale::ONE {
            return [low, high];
        }
        [if low < 0.0 { f64::NEG_INFINITY } else { 0.0 }, if high > 0.0 { f64::INFINITY } else { 0.0 }]
    }
}

impl Effect {
    /// All effects, in the order used in every list; forms of one id are next to each other.
    pub const ALL: [Self; 17] = [
        Self::CoilLag,
        Self::CoilLagRiseFall,
        Self::Remanence,
        Self::ThermalFade,
        Self::GasSpring,
        Self::Inertia,
        Self::Friction,
        Self::Asymmetry,
        Self::ForceLag,
        Self::SeriesSpring,
        Self::SensorDelay,
        Self::Deadzone,
        Self::EndStop,
        Self::LoadCellDrift,
        Self::PositionDependence,
        Self::VelocitySaturation,
        Self::AntiAliasMismatch,
    ];

    const fn about(self) -> &'static About {
        match self {
            Self::CoilLag => &coil_lag::ONE_TAU,
            Self::CoilLagRiseFall => &coil_lag::RISE_FALL,
            Self::Remanence => &remanence::ABOUT,
            Self::ThermalFade => &thermal_fade::ABOUT,
            Self::GasSpring => &gas_spring::ABOUT,
            Self::Inertia => &inertia::ABOUT,
            Self::Friction => &friction::ABOUT,
            Self::Asymmetry => &asymmetry::ABOUT,
            Self::ForceLag => &force_lag::ABOUT,
            Self::SeriesSpring => &series_spring::ABOUT,
            Self::SensorDelay => &sensor_delay::ABOUT,
            Self::Deadzone => &deadzone::ABOUT,
            Self::EndStop => &end_stop::ABOUT,
            Self::LoadCellDrift => &load_cell_drift::ABOUT,
            Self::PositionDependence => &position_dependence::ABOUT,
            Self::VelocitySaturation => &velocity_saturation::ABOUT,
            Self::AntiAliasMismatch => &anti_alias_mismatch::ABOUT,
        }
    }

    /// The id, as in model files and reports. The forms of one effect share it.
    #[must_use]
    pub const fn id(self) -> &'static str {
        self.about().id
    }

    /// All ids, each once, in the order of [`Effect::ALL`].
    #[must_use]
    pub fn ids() -> Vec<&'static str> {
        let mut ids = Self::ALL.map(Self::id).to_vec();
        ids.dedup();
        ids
    }

    /// The form, for an effect with more than one.
    #[must_use]
    pub const fn form(self) -> Option<&'static str> {
        self.about().form
    }

    /// The id, with the form if there is more than one: `coil_lag (rise_fall)`.
    #[must_use]
    pub fn title(self) -> String {
        self.form().map_or_else(|| self.id().to_owned(), |form| format!("{} ({form})", self.id()))
    }

    /// The effect with this id and form.
    #[must_use]
    pub fn named(id: &str, form: Option<&str>) -> Option<Self> {
        Self::ALL.into_iter().find(|effect| effect.id() == id && effect.form() == form)
    }

    /// The refined form that a diagnosis tries after this one was named.
    #[must_use]
    pub const fn refined(self) -> Option<Self> {
        match self {
            Self::CoilLag => Some(Self::CoilLagRiseFall),
            _ => None,
        }
    }

    /// Description in one line.
    #[must_use]
    pub const fn what(self) -> &'static str {
        self.about().what
    }

    /// Its parameters, in the order used in every list of values.
    #[must_use]
    pub const fn parameters(self) -> &'static [Parameter] {
        self.about().parameters
    }

    /// The excitation that separates it from other effects.
    #[must_use]
    pub const fn separated_by(self) -> &'static str {
        self.about().separated_by
    }

    /// Ids of effects with which it can be confused if the excitation does not separate them.
    #[must_use]
    pub const fn confounders(self) -> &'static [&'static str] {
        self.about().confounders
    }

    /// Channels that it needs in addition to displacement and force.
    #[must_use]
    pub const fn needs(self) -> &'static [Need] {
        self.about().needs
    }

    /// True if it adds a force that does not depend on the drive, and does not change the inputs.
    #[must_use]
    pub const fn only_adds(self) -> bool {
        matches!(
            self,
            Self::GasSpring
                | Self::Inertia
                | Self::Friction
                | Self::EndStop
                | Self::LoadCellDrift
                | Self::VelocitySaturation
        )
    }

    /// The effect with all parameters neutral. `size` returns the size of a scale in the data.
    #[must_use]
    pub fn neutral(self, size: impl Fn(Scale) -> f64) -> EffectModel {
        self.stepped(None, size)
    }

    /// The effect with parameter `index` one probe from neutral and the others neutral, where its score is computed. `size` returns the
    /// size of a scale in the data.
    #[must_use]
    pub fn probe(self, index: usize, size: impl Fn(Scale) -> f64) -> EffectModel {
        self.stepped(Some(index), size)
    }

    fn stepped(self, index: Option<usize>, size: impl Fn(Scale) -> f64) -> EffectModel {
        let mut values = [0.0; MAX_EFFECT_PARAMETERS];
        for (j, (value, parameter)) in values.iter_mut().zip(self.parameters()).enumerate() {
            let step = if index == Some(j) { parameter.probe } else { 0.0 };
            *value = (parameter.neutral + step) * size(parameter.scale);
        }
        EffectModel::unchecked(self, values)
    }
}

#[cfg(test)]
mod tests;
