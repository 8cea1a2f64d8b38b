//! The trait that the file of an effect implements: the properties of the effect and its step.

use super::run::{EffectState, Inside};
use super::term::Past;
use super::{Effect, MAX_EFFECT_PARAMETERS};
use crate::force::law::Scale;
use crate::force::{Inputs, Number};

/// Values of an effect's parameters, in the order of [`Properties::parameters`]; zeros beyond.
pub(super) type Values<R = f64> = [R; MAX_EFFECT_PARAMETERS];

/// An effect in one form. Nothing here has a default, so an effect without one of these does not compile.
pub(super) trait Definition {
    /// Everything that is constant.
    const PROPERTIES: Properties;

    /// One sample: steps the model inside with the inputs that the effect gives it, and returns the force with the effect. `None` if the
    /// model has no force.
    fn step<R: Number>(
        values: Values<R>,
        state: &mut EffectState<R>,
        inputs: &Inputs<R>,
        inside: &mut Inside<R>,
    ) -> Option<R>;

    /// Prepares the state before the first sample of a simulation that begins within a run. An effect that forgets within a second needs nothing.
    fn resume<R: Number>(_: &mut EffectState<R>, _: &Past) {}
}

/// The properties of an effect in one form.
#[derive(Debug, Clone, Copy)]
pub(super) struct Properties {
    /// Id, as in model files and reports. The forms of one effect share it.
    pub(super) id: &'static str,
    /// Name of the form, for an id that has more than one.
    pub(super) form: Option<&'static str>,
    /// Description in one line.
    pub(super) what: &'static str,
    /// The parameters. The first one is the amount that a diagnosis tests.
    pub(super) parameters: &'static [Parameter],
    /// Values that clearly change the force of a damper of 1 kN.
    pub(super) example: &'static [f64],
    /// The excitation that separates it from other effects.
    pub(super) separated_by: &'static str,
    /// Ids of effects with which it can be confused without that excitation.
    pub(super) confounders: &'static [&'static str],
    /// Channels that it needs in addition to displacement and force.
    pub(super) needs: &'static [Need],
    /// True if it changes with time or temperature at the same motion and drive. No structure of a base can then take its place.
    pub(super) follows_time: bool,
    /// Its place in the damper, which is its place in the order of application.
    pub(super) layer: Layer,
    /// How an inverse controller treats it.
    pub(super) inversion: Inversion,
    /// Stiffness of the force that it adds at rest over the whole stroke, N/m; zero for most effects.
    pub(super) static_stiffness_n_m: fn(Values) -> f64,
    /// The form with more parameters that a diagnosis tries after this one was named.
    pub(super) refinement: Option<Refinement>,
}

/// A form with more parameters.
#[derive(Debug, Clone, Copy)]
pub(super) struct Refinement {
    /// The form.
    pub(super) effect: Effect,
    /// Its values at which it equals the plain form with the given values.
    pub(super) values: fn(Values) -> Values,
}

/// Place of an effect in the damper, from the fluid outwards. The number orders the effects of one place: a lower one is nearer to the
/// fluid, and is applied first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Layer {
    /// Between current and field. The drive passes the coil first, so the coil is the outer one.
    Core(u8),
    /// Between drive and current.
    Coil(u8),
    /// The fluid in the gap.
    Gap(u8),
    /// In parallel with the gap.
    Parallel(u8),
    /// Between piston and rod, and between rod and load cell.
    Rod(u8),
    /// The measurement.
    Measurement(u8),
}

/// How an inverse controller treats an effect.
#[derive(Debug, Clone, Copy)]
pub(super) enum Inversion {
    /// Subtracts its force: it adds a force that does not depend on the drive, and changes no input.
    Subtract,
    /// Compensates it by lead: it is a first-order lag of the drive, with these time constants for rise and fall, s.
    Lead(fn(Values) -> [f64; 2]),
    /// Nothing: only a search over currents includes it.
    Search,
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

/// Unit of a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Unit {
    suffix: &'static str,
    symbol: Option<&'static str>,
}

impl Unit {
    /// No unit.
    pub const NONE: Self = Self::new("", "");
    /// The unit of the drive, A or V.
    pub const DRIVE: Self = Self { suffix: "_drive", symbol: None };
    /// Hertz.
    pub const HERTZ: Self = Self::new("_hz", "Hz");
    /// Second.
    pub const SECOND: Self = Self::new("_s", "s");
    /// Metre.
    pub const METRE: Self = Self::new("_m", "m");
    /// Kilogram.
    pub const KILOGRAM: Self = Self::new("_kg", "kg");
    /// Newton.
    pub const NEWTON: Self = Self::new("_n", "N");
    /// Metre per second.
    pub const METRE_PER_SECOND: Self = Self::new("_m_s", "m/s");
    /// Newton per metre.
    pub const NEWTON_PER_METRE: Self = Self::new("_n_m", "N/m");

    /// A unit with its suffix in names of parameters and its symbol.
    pub(super) const fn new(suffix: &'static str, symbol: &'static str) -> Self {
        Self { suffix, symbol: Some(symbol) }
    }

    /// The end of names of parameters with this unit.
    #[must_use]
    pub const fn suffix(self) -> &'static str {
        self.suffix
    }

    /// The symbol, empty without a unit; `None` for the unit of the drive, which depends on the model.
    #[must_use]
    pub const fn symbol(self) -> Option<&'static str> {
        self.symbol
    }
}

/// One parameter of an effect.
///
/// Range, probe and neutral value are multiples of a scale of the data, or in the parameter's unit if the scale is [`Scale::ONE`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameter {
    /// Name as in model files; ends in the unit.
    pub name: &'static str,
    /// Its unit. Parameters of different effects with the same name have the same unit.
    pub unit: Unit,
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
    pub(super) const fn absolute(name: &'static str, unit: Unit, range: [f64; 2], probe: f64) -> Self {
        Self::relative(name, unit, Scale::ONE, range, probe)
    }

    /// A parameter in scales of the data, neutral at zero.
    pub(super) const fn relative(
        name: &'static str,
        unit: Unit,
        scale: Scale,
        range: [f64; 2],
        probe: f64,
    ) -> Self {
        Self { name, unit, scale, range, neutral: 0.0, probe }
    }

    /// A shape parameter (see [`Parameter::is_shape`]), held at `held` while others are probed.
    pub(super) const fn shape(
        name: &'static str,
        unit: Unit,
        scale: Scale,
        range: [f64; 2],
        held: f64,
    ) -> Self {
        Self { name, unit, scale, range, neutral: held, probe: 0.0 }
    }

    /// The first parameter of an effect with this name, which gives its unit.
    #[must_use]
    pub fn named(name: &str) -> Option<&'static Self> {
        Effect::ALL.iter().flat_map(|effect| effect.parameters()).find(|parameter| parameter.name == name)
    }

    /// The name without the unit, in words.
    #[must_use]
    pub fn label(&self) -> String {
        self.name.strip_suffix(self.unit.suffix()).unwrap_or(self.name).replace('_', " ")
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

    /// Values allowed in a model: the physical range, extended to the neutral value. Only the sign is limited if the range is relative to
    /// the data, because a model does not know their scales, and if the parameter is a mass, a force or a stiffness, because a large
    /// machine has large ones.
    #[must_use]
    pub fn allowed(&self) -> [f64; 2] {
        let [low, high] = [self.range[0].min(self.neutral), self.range[1].max(self.neutral)];
        let of_any_size = [Unit::KILOGRAM, Unit::NEWTON, Unit::NEWTON_PER_METRE].contains(&self.unit);
        if self.scale == Scale::ONE && !of_any_size {
            return [low, high];
        }
        [if low < 0.0 { f64::NEG_INFINITY } else { 0.0 }, if high > 0.0 { f64::INFINITY } else { 0.0 }]
    }
}
