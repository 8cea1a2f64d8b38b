//! Physical effects that a force model lacks, one file each, and how they are put around it.
//!
//! ```text
//!   x, v, a, i, T ──→ effect 3 ──→ effect 2 ──→ effect 1 ──→ model
//!            F'   ←── effect 3 ←── effect 2 ←── effect 1 ←── F
//! ```
//!
//! An effect stands around a model, or around a model with effects: it makes something of the inputs on their way in
//! (the coil's lag makes another current), of the force on its way out (friction adds some), or of both (a spring in
//! series asks for the force at which rod and piston agree). [`Augmented`] is a model with up to [`MAX_EFFECTS`] of
//! them; it runs as a model does, is `Copy` and steps without an allocation, so that a model that has been told of
//! an effect can be swapped in live. A `Model` (see [`crate::model`]) and a model file carry the same list:
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
//! | absent | with its parameter at [`Parameter::neutral`] an effect is not there, to 1e-12 of the force |
//! | steps | lags are exact for inputs that run straight from sample to sample; a changing rate is no special case |
//! | gap | `dt_s == None` starts every effect anew; so does a step that is not positive |
//! | not known | an input that is not finite gives no force, changes no memory, and its time is made up for |
//! | offset | the session's force offset is no force of the damper: what scales force leaves it out |
//! | one step ahead | a model that feeds on measured force has the effects in its input; with effects it only runs free |
//!
//! # What a diagnosis finds here
//! For each of [`Effect::ALL`]: what it is in a line, its parameters with their physical range (in the data's own
//! scales where dampers differ by orders of magnitude), the step at which its score is taken
//! ([`Effect::probe`]), the excitation that tells it apart, what it is confounded with, and the channels it needs.
//!
//! # An effect of one's own
//! One file more in this directory, say `cavitation.rs`, which opens with its equation, and holds
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
//!     let force_n = inside.run(inputs)?;      // with other inputs, if the effect is on them
//!     Some(force_n.max(-suction_n))
//! }
//! ```
//!
//! then one line each in [`Effect`], [`Effect::ALL`], `Effect::about` and `EffectModel::step` (the compiler asks
//! for all but the second, a test for that). What it remembers goes into `state`: two first-order lags, three
//! numbers, a delay line; `state.force_inside` and `state.drive` say how long ago the last good sample was. File, model file, diagnosis,
//! pipeline and the tests that hold for every effect then know it.

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

/// The most effects around one model.
pub const MAX_EFFECTS: usize = 3;
/// The most parameters that an effect has.
pub const MAX_EFFECT_PARAMETERS: usize = 2;
/// The longest delay between channels that an effect can make, s.
pub const MAX_DELAY_S: f64 = 10e-3;

/// A physical effect, in one of its forms.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Effect {
    /// Lag of the coil, one time constant.
    CoilLag,
    /// Lag of the coil, one time constant up and another down.
    CoilLagRiseFall,
    /// Remanence of the core.
    Remanence,
    /// Weaker when warm.
    ThermalFade,
    /// Stiffness of the gas.
    GasSpring,
    /// Mass that moves along.
    Inertia,
    /// Coulomb friction.
    Friction,
    /// Unlike in extension and compression.
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
    /// Force that grows along the stroke.
    PositionDependence,
    /// Force that bends at high speed.
    VelocitySaturation,
    /// Low-pass of the force channel.
    AntiAliasMismatch,
}

/// All that is fixed about an effect; its file holds it.
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
    /// The case's temperature.
    CaseTemperature,
}

impl Need {
    /// What it is, in words.
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
/// Ranges, probes and neutral values are multiples of a scale of the data, or numbers in the parameter's unit where
/// the scale is [`Scale::ONE`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameter {
    /// Name as in model files, with its unit.
    pub name: &'static str,
    /// What the numbers below are multiples of: powers of the largest force, displacement, velocity.
    pub scale: Scale,
    /// Range in which it is physically plausible.
    pub range: [f64; 2],
    /// Value at which the effect is absent. Of a shape parameter (see [`Parameter::is_shape`]) the value at which it
    /// is held while the others are probed.
    pub neutral: f64,
    /// Small step from neutral at which a score is taken; zero for a shape parameter.
    pub probe: f64,
}

impl Parameter {
    /// One in its own unit, neutral at zero.
    const fn absolute(name: &'static str, range: [f64; 2], probe: f64) -> Self {
        Self::relative(name, Scale::ONE, range, probe)
    }

    /// One in scales of the data, neutral at zero.
    const fn relative(name: &'static str, scale: Scale, range: [f64; 2], probe: f64) -> Self {
        Self { name, scale, range, neutral: 0.0, probe }
    }

    /// One that says where or how, not how much.
    const fn shape(name: &'static str, scale: Scale, range: [f64; 2], held: f64) -> Self {
        Self { name, scale, range, neutral: held, probe: 0.0 }
    }

    /// True for a parameter that says where or how, not how much: no value of it takes the effect away.
    #[must_use]
    pub const fn is_shape(&self) -> bool {
        self.probe == 0.0
    }

    /// The physical range in the parameter's unit, where its scale has this size in the data.
    #[must_use]
    pub const fn range_at(&self, size: f64) -> [f64; 2] {
        [self.range[0] * size, self.range[1] * size]
    }

    /// What a model may hold: the physical range widened to the neutral value; of a range that is relative to the
    /// data, which a model does not know, only the sign.
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
    /// All effects, in the order in which lists of them stand; forms of one id side by side.
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

    /// The id, as in model files and diagnoses; the forms of one effect share it.
    #[must_use]
    pub const fn id(self) -> &'static str {
        self.about().id
    }

    /// The ids of the library, each once, in the order of [`Effect::ALL`].
    #[must_use]
    pub fn ids() -> Vec<&'static str> {
        let mut ids = Self::ALL.map(Self::id).to_vec();
        ids.dedup();
        ids
    }

    /// Which form of the effect this is, where there is more than one.
    #[must_use]
    pub const fn form(self) -> Option<&'static str> {
        self.about().form
    }

    /// The id, and the form where there is more than one: `coil_lag (rise_fall)`.
    #[must_use]
    pub fn title(self) -> String {
        self.form().map_or_else(|| self.id().to_owned(), |form| format!("{} ({form})", self.id()))
    }

    /// The effect of this id and form.
    #[must_use]
    pub fn named(id: &str, form: Option<&str>) -> Option<Self> {
        Self::ALL.into_iter().find(|effect| effect.id() == id && effect.form() == form)
    }

    /// The finer form of it that a diagnosis tries once this one is named.
    #[must_use]
    pub const fn refined(self) -> Option<Self> {
        match self {
            Self::CoilLag => Some(Self::CoilLagRiseFall),
            _ => None,
        }
    }

    /// What it is, in a line.
    #[must_use]
    pub const fn what(self) -> &'static str {
        self.about().what
    }

    /// Its parameters, in the order in which every list of them stands.
    #[must_use]
    pub const fn parameters(self) -> &'static [Parameter] {
        self.about().parameters
    }

    /// The excitation that tells it apart.
    #[must_use]
    pub const fn separated_by(self) -> &'static str {
        self.about().separated_by
    }

    /// Ids of effects that look alike where the excitation does not separate them.
    #[must_use]
    pub const fn confounders(self) -> &'static [&'static str] {
        self.about().confounders
    }

    /// Channels that it needs beside displacement and force.
    #[must_use]
    pub const fn needs(self) -> &'static [Need] {
        self.about().needs
    }

    /// True when it adds a force that the drive has no part in, and hands its inputs on as they are.
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

    /// The effect absent, where `size` tells how large a scale is in the data: the base of a score.
    #[must_use]
    pub fn neutral(self, size: impl Fn(Scale) -> f64) -> EffectModel {
        self.stepped(None, size)
    }

    /// The effect with its parameter `index` one probe from neutral, the others neutral: where a score is taken.
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
