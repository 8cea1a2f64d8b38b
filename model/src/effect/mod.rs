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
//! form = "rise_fall"           # where a form has a name
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
//! | load cell | effects of the load cell come after all others; without them the model gives the damper's force |
//! | offset | the session's force offset does not come from the damper, so effects that scale the force leave it out |
//! | one-step-ahead | a model fed with measured force has the effects in its input, so with effects it is only simulated (free run) |
//!
//! # One entry for each effect
//! The list in `effects!` below is the only place that names all effects. A line there is a file of this directory with its forms, and each
//! form is a type with the trait `Definition`: the constants in `Properties`, and the step. Neither has defaults, so an effect without
//! one of its properties does not compile. A further form takes the properties that it does not change from the first one.
//! Everything else that depends on the effect reads the properties:
//!
//! | property | read by |
//! |---|---|
//! | id, form, parameters (name, unit, physical range, neutral value, probe) | model files, diagnosis, reports, messages |
//! | description, excitation that separates it, confounders | diagnosis, reports |
//! | channels that it needs | pipeline, scores, diagnosis |
//! | dependence on time or temperature | diagnosis |
//! | layer in the damper | order in which a diagnosis applies effects; pipeline and inverse controller, which separate force and reading |
//! | inversion, static stiffness | inverse controller |
//! | refinement | diagnosis |
//! | example | tests and examples |
//!
//! A parameter's range is relative to the data's scales where dampers differ by orders of magnitude. Its probe is the step at which its
//! score is computed ([`Effect::probe`]).
//!
//! # Adding an effect
//! 1. Add one file to this directory, say `cavitation.rs`, which starts with the equation, its symbols and its source:
//!
//! ```ignore
//! use super::{Definition, EffectState, Inside, Inversion, Layer, Parameter, Properties, Unit, Values};
//! use crate::force::{Inputs, Number};
//!
//! pub(super) struct Cavitation;
//!
//! impl Definition for Cavitation {
//!     const PROPERTIES: Properties = Properties {
//!         id: "cavitation",                       // as in model files
//!         form: None,                             // a name, where another effect has the same id
//!         what: "the force in extension is limited",
//!         parameters: &[Parameter::absolute("suction_n", Unit::NEWTON, [0.0, 500.0], 5.0)],
//!         example: &[100.0],
//!         separated_by: "fast strokes in both directions",
//!         confounders: &["asymmetry"],
//!         needs: &[],
//!         follows_time: false,
//!         layer: Layer::Gap(3),
//!         inversion: Inversion::Search,
//!         static_stiffness_n_m: |_| 0.0,
//!         refinement: None,
//!     };
//!
//!     #[inline]
//!     fn step<R: Number>(
//!         [suction_n, ..]: Values<R>,
//!         _: &mut EffectState<R>,
//!         inputs: &Inputs<R>,
//!         inside: &mut Inside<R>,
//!     ) -> Option<R> {
//!         let force_n = inside.run(inputs)?;      // with changed inputs, if the effect acts on them
//!         Some(force_n.max(-suction_n))
//!     }
//! }
//! ```
//!
//! 2. Add the line `cavitation: Cavitation;` to the list.
//! 3. Declare the effect in the virtual rig (`rig/inject.rs`) under the same id; a test fails without this step. An effect that is not an
//!    added force may also need an equation in `rig/plant.rs` or `rig/channel.rs`. The example `diagnosis_rates` then counts how often a
//!    diagnosis finds it.
//!
//! State goes into `state`: two first-order lags, three numbers and a delay line; `state.force_inside` and `state.drive` give the time
//! since the last valid sample. The step is written for any number type `R`, so that a diagnosis has its derivatives: a comparison uses the
//! values (`model/src/force/jet.rs`). Model file, pipeline, diagnosis, inverse controller, reports and the tests for all effects then include it.

#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

mod definition;
mod parts;
mod run;
pub mod term;

pub use definition::{Need, Parameter, Unit};
pub use run::{Augmented, AugmentedState, EffectModel, Effects};
pub(crate) use run::{AugmentedOnJets, JetState, Solved};

pub(crate) use definition::Layer;

use crate::force::law::Scale;
use crate::force::{Inputs, Number};
use definition::{Definition, Inversion, Properties, Refinement, Values};
use parts::Lag;
use run::{EffectState, Inside};
use term::Past;

/// Largest number of effects around one model.
pub const MAX_EFFECTS: usize = 3;
/// Largest number of parameters of an effect.
pub const MAX_EFFECT_PARAMETERS: usize = 2;
/// Longest delay between channels that an effect can model, s.
pub const MAX_DELAY_S: f64 = 10e-3;

/// Reference temperature of the models, °C: the case temperature at which no effect changes the force. It is used where no temperature is
/// known.
pub const REFERENCE_TEMP_C: f64 = 25.0;

/// Declares the files of effects and [`Effect`] with all forms. A line is `file: Form, Form;`.
///
/// The step is a `match`, so that it is dispatched statically and can be inlined.
macro_rules! effects {
    ($($file:ident: $($form:ident),+;)+) => {
        $(mod $file;)+

        /// A physical effect, in one of its forms.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
        pub enum Effect {
            $($(
                #[doc = concat!("See `model/src/effect/", stringify!($file), ".rs`.")]
                $form,
            )+)+
        }

        impl Effect {
            /// All effects, in the order used in every list; forms of one id are next to each other.
            pub const ALL: [Self; [$($(stringify!($form)),+),+].len()] = [$($(Self::$form),+),+];

            const fn properties(self) -> &'static Properties {
                match self {
                    $($(Self::$form => &<$file::$form as Definition>::PROPERTIES,)+)+
                }
            }

            /// One sample with these values; see [`Definition::step`].
            #[inline]
            fn step<R: Number>(
                self,
                values: Values<R>,
                state: &mut EffectState<R>,
                inputs: &Inputs<R>,
                inside: &mut Inside<R>,
            ) -> Option<R> {
                match self {
                    $($(Self::$form => <$file::$form as Definition>::step(values, state, inputs, inside),)+)+
                }
            }

            /// See [`Definition::resume`].
            fn resume<R: Number>(self, state: &mut EffectState<R>, past: &Past) {
                match self {
                    $($(Self::$form => <$file::$form as Definition>::resume(state, past),)+)+
                }
            }
        }
    };
}

effects! {
    coil_lag: CoilLag, CoilLagRiseFall;
    remanence: Remanence;
    thermal_fade: ThermalFade;
    gas_spring: GasSpring;
    inertia: Inertia;
    friction: Friction, FrictionOwnScale;
    asymmetry: Asymmetry;
    force_lag: ForceLag;
    series_spring: SeriesSpring;
    sensor_delay: SensorDelay;
    deadzone: Deadzone;
    end_stop: EndStop;
    load_cell_drift: LoadCellDrift;
    position_dependence: PositionDependence;
    velocity_saturation: VelocitySaturation;
    anti_alias_mismatch: AntiAliasMismatch;
}

impl Effect {
    /// The id, as in model files and reports. The forms of one effect share it.
    #[must_use]
    pub const fn id(self) -> &'static str {
        self.properties().id
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
        self.properties().form
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
    pub fn refined(self) -> Option<Self> {
        self.properties().refinement.map(|refinement| refinement.effect)
    }

    /// Description in one line.
    #[must_use]
    pub const fn what(self) -> &'static str {
        self.properties().what
    }

    /// Its parameters, in the order used in every list of values.
    #[must_use]
    pub const fn parameters(self) -> &'static [Parameter] {
        self.properties().parameters
    }

    /// The excitation that separates it from other effects.
    #[must_use]
    pub const fn separated_by(self) -> &'static str {
        self.properties().separated_by
    }

    /// Ids of effects with which it can be confused if the excitation does not separate them.
    #[must_use]
    pub const fn confounders(self) -> &'static [&'static str] {
        self.properties().confounders
    }

    /// Channels that it needs in addition to displacement and force.
    #[must_use]
    pub const fn needs(self) -> &'static [Need] {
        self.properties().needs
    }

    /// True if it changes with time or temperature at the same motion and drive.
    pub(crate) const fn follows_time(self) -> bool {
        self.properties().follows_time
    }

    /// True if it adds a force that does not depend on the drive, and does not change the inputs.
    #[must_use]
    pub const fn only_adds(self) -> bool {
        matches!(self.properties().inversion, Inversion::Subtract)
    }

    /// True if it is a first-order lag of the drive, which an inverse controller compensates.
    #[must_use]
    pub const fn lags_drive(self) -> bool {
        matches!(self.properties().inversion, Inversion::Lead(_))
    }

    /// Its place in the damper.
    pub(crate) const fn layer(self) -> Layer {
        self.properties().layer
    }

    /// The effect with values that clearly change the force of a damper of 1 kN, for tests and examples.
    #[must_use]
    pub fn example(self) -> EffectModel {
        let mut values = Values::default();
        for (value, example) in values.iter_mut().zip(self.properties().example) {
            *value = *example;
        }
        EffectModel::unchecked(self, values)
    }

    /// The effect with parameter `index` one probe from neutral and the others neutral, where its score is computed. `size` returns the
    /// size of a scale in the data.
    #[must_use]
    pub fn probe(self, index: usize, size: impl Fn(Scale) -> f64) -> EffectModel {
        self.stepped(Some(index), size)
    }

    fn stepped(self, index: Option<usize>, size: impl Fn(Scale) -> f64) -> EffectModel {
        let mut values = Values::default();
        for (j, (value, parameter)) in values.iter_mut().zip(self.parameters()).enumerate() {
            let step = if index == Some(j) { parameter.probe } else { 0.0 };
            *value = (parameter.neutral + step) * size(parameter.scale);
        }
        EffectModel::unchecked(self, values)
    }
}

#[cfg(test)]
mod tests;
