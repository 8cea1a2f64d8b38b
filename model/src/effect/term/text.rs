//! A term in words: its equation, a sentence, and its numbers with their units.

use super::{Argument, Form, FormParameter, Modulator, SHARP, Term};
use crate::effect::Unit;
use crate::units::rounded;

/// A number of a term.
#[derive(Debug, Clone, PartialEq)]
pub struct TermNumber {
    /// Its name: `amount`, or a parameter of the form.
    pub name: &'static str,
    /// Its value, in `unit`.
    pub value: f64,
    /// Its unit; empty for a share of the force.
    pub unit: String,
}

impl Term {
    /// The amount, then the parameters of the form; `drive` is the unit of the drive.
    #[must_use]
    pub fn numbers(&self, drive: &str) -> Vec<TermNumber> {
        let (_, argument, form) = self.kind();
        let amount = TermNumber { name: "amount", value: self.amount(), unit: amount_unit(self, drive) };
        let parameters = form.parameters().iter().zip(self.parameters());
        let of_form = |(parameter, value): (&FormParameter, &f64)| TermNumber {
            name: parameter.name,
            value: *value,
            unit: symbol_of(parameter.unit(argument), drive),
        };
        std::iter::once(amount).chain(parameters.map(of_form)).collect()
    }

    /// The unit of c g(q); `drive` is the unit of the drive.
    #[must_use]
    pub fn curve_unit(&self, drive: &str) -> String {
        match self.kind().0 {
            Modulator::Drive | Modulator::DriveSignVelocity => format!("N/{drive}"),
            modulator => symbol_of(modulator.unit_of_curve(), drive),
        }
    }

    /// The unit of the argument; `drive` is the unit of the drive.
    #[must_use]
    pub fn argument_unit(&self, drive: &str) -> String {
        symbol_of(self.kind().1.unit(), drive)
    }

    /// The equation with its numbers and units; `drive` is the unit of the drive.
    #[must_use]
    pub fn equation(&self, drive: &str) -> String {
        let (modulator, argument, _) = self.kind();
        let c = signed(self.amount());
        let unit = amount_unit(self, drive);
        if let Some((power, of)) = self.power() {
            return format!("F' = F {c} {unit} {power},  {}: {}", symbol(of), of.words());
        }
        let g = curve(self, drive);
        let by = match (g.is_empty(), unit.is_empty()) {
            (true, true) => c,
            (true, false) => format!("{c} {unit}"),
            (false, true) => format!("{c} {g}"),
            (false, false) => format!("{c} {unit} {g}"),
        };
        let q = symbol(argument);
        let equation = match modulator {
            Modulator::One => format!("F' = F {by}"),
            Modulator::Force => format!("F' = F (1 {by})"),
            Modulator::ForceInExtension => format!("F' = F (1 {by}) in extension"),
            Modulator::ForceInCompression => format!("F' = F (1 {by}) in compression"),
            Modulator::SignVelocity => format!("F' = F {by} sgn v"),
            Modulator::Velocity => format!("F' = F {by} v"),
            Modulator::Displacement => format!("F' = F {by} x"),
            Modulator::Acceleration => format!("F' = F {by} a"),
            Modulator::Drive => format!("F' = F {by} i"),
            Modulator::DriveSignVelocity => format!("F' = F {by} i sgn v"),
            Modulator::ForcePerDrive => format!("i' = i {by}"),
            Modulator::ForcePerVelocity => format!("v' = v {by}"),
        };
        if g.is_empty() { equation } else { format!("{equation},  {q}: {}", argument.words()) }
    }

    /// A power of displacement or velocity, with its argument, if the term is the amount times this.
    const fn power(&self) -> Option<(&'static str, Argument)> {
        use Argument as Q;
        match self.kind() {
            (Modulator::Displacement, Q::Displacement, Form::Linear) => Some(("x²", Q::Displacement)),
            (Modulator::Displacement, Q::DisplacementMagnitude, Form::Linear) => {
                Some(("|x| x", Q::Displacement))
            }
            (Modulator::Displacement, Q::Displacement | Q::DisplacementMagnitude, Form::Quadratic) => {
                Some(("x³", Q::Displacement))
            }
            (Modulator::Velocity, Q::Velocity, Form::Linear) => Some(("v²", Q::Velocity)),
            (Modulator::Velocity, Q::Speed, Form::Linear) => Some(("|v| v", Q::Velocity)),
            (Modulator::Velocity, Q::Velocity | Q::Speed, Form::Quadratic) => Some(("v³", Q::Velocity)),
            _ => None,
        }
    }

    /// A sentence that says what the term does.
    #[must_use]
    pub fn sentence(&self, drive: &str) -> String {
        let (modulator, argument, form) = self.kind();
        let amount = self.amount();
        let size = format!("{} {}", short(amount.abs()), amount_unit(self, drive));
        let size = size.trim_end();
        let percent = |per: &str| format!("{} %{per}", short(100.0 * amount.abs()));
        let per = match form.powers_of_argument() {
            0 => String::new(),
            1 => format!("/{}", bracketed(&symbol_of(argument.unit(), drive))),
            _ => format!("/{}²", bracketed(&symbol_of(argument.unit(), drive))),
        };
        let (falls, less) = if amount < 0.0 { ("falls", "less") } else { ("rises", "more") };
        let what = match modulator {
            Modulator::One => format!("a force of {} {} is added", short(amount), amount_unit(self, drive)),
            Modulator::Force => format!("the force {falls} by {}", percent(&per)),
            Modulator::ForceInExtension => format!("the force in extension {falls} by {}", percent(&per)),
            Modulator::ForceInCompression => format!("the force in compression {falls} by {}", percent(&per)),
            Modulator::SignVelocity => format!("the friction is {size} {less}"),
            Modulator::Velocity => format!("the damping is {size} {less}"),
            Modulator::Displacement => format!("the stiffness is {size} {less}"),
            Modulator::Acceleration => format!("the moving mass is {size} {less}"),
            Modulator::Drive | Modulator::DriveSignVelocity => {
                format!("the force that grows with the drive is {size} {less}")
            }
            Modulator::ForcePerDrive => format!("the drive that acts is {size} {less} than the measured one"),
            Modulator::ForcePerVelocity => {
                format!("the velocity that acts is {size} {less} than the measured one")
            }
        };
        let text = format!("{what}{}", place(self, drive));
        let mut letters = text.chars();
        letters.next().map_or_else(String::new, |first| {
            first.to_uppercase().collect::<String>() + letters.as_str() + "."
        })
    }
}

/// Where and how the curve of `term` acts.
fn place(term: &Term, drive: &str) -> String {
    let (_, argument, form) = term.kind();
    let name = argument.words();
    let value = |j: usize| parameter(term, j, drive);
    match form {
        Form::Constant => String::new(),
        Form::Linear => format!(", times the {name}"),
        Form::Quadratic if argument == Argument::DisplacementMagnitude => {
            format!(", times the square of the {}", Argument::Displacement.words())
        }
        Form::Quadratic => format!(", times the square of the {name}"),
        Form::Step => format!(" where the {name} is above {}, and stays there", value(0)),
        Form::HingeAbove => format!(", times the part of the {name} above {}", value(0)),
        Form::HingeBelow => format!(", times the part of the {name} below {}", value(0)),
        Form::Ramp => format!(" while the {name} grows by {} from {} on", value(1), value(0)),
        Form::Decay => format!(" where the {name} is zero, and dies away over {}", value(0)),
        Form::Growth => format!(", times exp of the {name} over {}, less one", value(0)),
        Form::Tanh => format!(" where the {name} is well above {}, and the other way below zero", value(0)),
        Form::Bump => format!(" where the {name} is near {}, within {}", value(0), value(1)),
        Form::Window => format!(" while the {name} is below {} in size", value(0)),
        Form::Deadband => format!(", times the part of the {name} beyond {} in size", value(0)),
        Form::Sine => format!(" at the peaks of a wave over the {name} with a wavelength of {}", value(1)),
        Form::Staircase => format!(" at each further {} of the {name}", value(0)),
        Form::Resonance => {
            format!(", times the {name} behind a resonance at {} with the damping {}", value(0), value(1))
        }
    }
}

/// g(q) with its numbers.
fn curve(term: &Term, drive: &str) -> String {
    let (_, argument, form) = term.kind();
    let (q, unit) = (symbol(argument), symbol_of(argument.unit(), drive));
    let number = |j: usize| parameter(term, j, drive);
    let [low, high] = term.confirmed_in();
    let away = || match term.parameters().first() {
        Some(at) if *at < 0.0 => format!("{q} + {}", format!("{} {unit}", short(-at)).trim_end()),
        _ => format!("{q} - {}", number(0)),
    };
    match form {
        Form::Constant => String::new(),
        Form::Linear => q.to_owned(),
        Form::Quadratic => format!("{q}²"),
        Form::Step if term.parameters()[1] < SHARP * (high - low) => format!("H({})", away()),
        Form::Step => format!("(1 + tanh(({}) / {})) / 2", away(), number(1)),
        Form::HingeAbove => format!("max(0, {})", away()),
        Form::HingeBelow => format!("max(0, {} - {q})", number(0)),
        Form::Ramp => format!("min(1, max(0, ({}) / {}))", away(), number(1)),
        Form::Decay if matches!(argument, Argument::Speed | Argument::DisplacementMagnitude) => {
            format!("exp(-{q} / {})", number(0))
        }
        Form::Decay => format!("exp(-|{q}| / {})", number(0)),
        Form::Growth => format!("(exp({q} / {}) - 1)", number(0)),
        Form::Tanh => format!("tanh({q} / {})", number(0)),
        Form::Bump => format!("exp(-(({}) / {})²)", away(), number(1)),
        Form::Window => format!("[|{q}| < {}]", number(0)),
        Form::Deadband => format!("({q} beyond ± {})", number(0)),
        Form::Sine => format!("sin(2 pi ({}) / {})", away(), number(1)),
        Form::Staircase => format!("floor({q} / {})", number(0)),
        Form::Resonance => format!("y({q}; {}, {})", number(0), number(1)),
    }
}

/// The value and unit of a parameter of the form.
fn parameter(term: &Term, index: usize, drive: &str) -> String {
    let (_, argument, form) = term.kind();
    let both = form.parameters().iter().zip(term.parameters()).nth(index);
    let text = |(parameter, value): (&FormParameter, &f64)| {
        format!("{} {}", short(*value), symbol_of(parameter.unit(argument), drive)).trim_end().to_owned()
    };
    both.map_or_else(String::new, text)
}

/// The unit of a term's amount: of the curve, by the power of the argument that the form has.
fn amount_unit(term: &Term, drive: &str) -> String {
    let (_, argument, form) = term.kind();
    let curve = term.curve_unit(drive);
    let of = bracketed(&symbol_of(argument.unit(), drive));
    match form.powers_of_argument() {
        0 => curve,
        power => {
            let top = if curve.is_empty() { "1" } else { &curve };
            // N/m by m² is N/m³, and N s/m by (m/s)² is N/(m/s)³.
            let (top, own) = match (of.as_str(), top.strip_suffix("/m"), top.strip_suffix(" s/m")) {
                ("m", Some(top), _) | ("(m/s)", _, Some(top)) => (top, 1),
                _ => (top, 0),
            };
            let power = match power + own {
                3 => "³",
                2 => "²",
                _ => "",
            };
            format!("{top}/{of}{power}")
        }
    }
}

/// A unit as a divisor.
fn bracketed(unit: &str) -> String {
    if unit.contains(['/', ' ']) { format!("({unit})") } else { unit.to_owned() }
}

fn symbol_of(unit: Unit, drive: &str) -> String {
    unit.symbol().unwrap_or(drive).to_owned()
}

const fn symbol(argument: Argument) -> &'static str {
    match argument {
        Argument::Displacement => "x",
        Argument::DisplacementMagnitude => "|x|",
        Argument::DisplacementSignVelocity => "x sgn v",
        Argument::Velocity => "v",
        Argument::Speed => "|v|",
        Argument::Acceleration => "a",
        Argument::Drive => "i",
        Argument::Force => "F",
        Argument::Time => "t",
        Argument::Path => "s",
        Argument::Energy => "E",
        Argument::TemperatureRise => "dT",
        Argument::Travel => "d",
        Argument::TimeSinceReversal => "t_r",
        Argument::TimeSinceDriveChange => "t_i",
        Argument::DriveChange => "di",
        Argument::MeanSpeed => "w",
    }
}

impl Argument {
    /// Its name in words.
    #[must_use]
    pub const fn words(self) -> &'static str {
        match self {
            Self::Displacement => "displacement",
            Self::DisplacementMagnitude => "magnitude of the displacement",
            Self::DisplacementSignVelocity => "displacement times the sign of the velocity",
            Self::Velocity => "velocity",
            Self::Speed => "speed",
            Self::Acceleration => "acceleration",
            Self::Drive => "drive",
            Self::Force => "force",
            Self::Time => "time since the start",
            Self::Path => "path since the start",
            Self::Energy => "energy taken up since the start",
            Self::TemperatureRise => "rise of the case temperature since the start",
            Self::Travel => "travel since the last reversal",
            Self::TimeSinceReversal => "time since the last reversal",
            Self::TimeSinceDriveChange => "time since the last change of the drive",
            Self::DriveChange => "drive minus its lag of 50 ms",
            Self::MeanSpeed => "mean speed over 1 s",
        }
    }
}

/// Four significant digits, from a million on with a power of ten.
fn short(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return format!("{value}");
    }
    if value.abs() >= 1e6 {
        return format!("{:e}", rounded(value, 4));
    }
    #[allow(clippy::disallowed_methods, reason = "a text for people")]
    let places = (3 - value.abs().log10().floor() as i32).clamp(0, 9) as usize;
    let text = format!("{value:.places$}");
    match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
        false => text,
    }
}

fn signed(value: f64) -> String {
    if value < 0.0 { format!("- {}", short(-value)) } else { format!("+ {}", short(value)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn term(modulator: Modulator, argument: Argument, form: Form, amount: f64, parameters: &[f64]) -> Term {
        Term::new((modulator, argument, form), amount, parameters, [0.0, 30.0]).expect("a term")
    }

    #[test]
    fn equations_and_sentences_have_numbers_and_units() {
        let loss = term(Modulator::Force, Argument::Time, Form::Step, -0.126, &[11.5, 0.05]);
        assert_eq!(loss.equation("A"), "F' = F (1 - 0.126 H(t - 11.5 s)),  t: time since the start");
        assert_eq!(
            loss.sentence("A"),
            "The force falls by 12.6 % where the time since the start is above 11.5 s, and stays there."
        );
        let map = term(Modulator::ForcePerDrive, Argument::Drive, Form::HingeAbove, -0.8, &[1.5]);
        assert_eq!(map.equation("V"), "i' = i - 0.8 V/V max(0, i - 1.5 V),  i: drive");
        assert_eq!(
            map.sentence("V"),
            "The drive that acts is 0.8 V/V less than the measured one, times the part of the drive above 1.5 V."
        );
        let drag = term(Modulator::SignVelocity, Argument::Speed, Form::Quadratic, 700.0, &[]);
        assert_eq!(drag.equation("A"), "F' = F + 700 N/(m/s)² |v|² sgn v,  |v|: speed");
        let cubic = (Modulator::Displacement, Argument::DisplacementMagnitude, Form::Quadratic);
        let hardening = term(cubic.0, cubic.1, cubic.2, 9.9674e7, &[]);
        assert_eq!(hardening.equation("A"), "F' = F + 9.967e7 N/m³ x³,  x: displacement");
        assert_eq!(
            hardening.sentence("A"),
            "The stiffness is 9.967e7 N/m³ more, times the square of the displacement."
        );
        let sharp = term(Modulator::SignVelocity, Argument::Speed, Form::Decay, 20.0, &[0.005]);
        assert_eq!(sharp.equation("A"), "F' = F + 20 N exp(-|v| / 0.005 m/s) sgn v,  |v|: speed");
        let turbulent = term(Modulator::Velocity, Argument::Speed, Form::Linear, 250.0, &[]);
        assert_eq!(turbulent.equation("A"), "F' = F + 250 N/(m/s)² |v| v,  v: velocity");
        let thread = term(Modulator::Force, Argument::Displacement, Form::Sine, 0.15, &[-0.015, 0.005]);
        assert_eq!(
            thread.equation("A"),
            "F' = F (1 + 0.15 sin(2 pi (x + 0.015 m) / 0.005 m)),  x: displacement"
        );
        assert_eq!(
            thread.sentence("A"),
            "The force rises by 15 % at the peaks of a wave over the displacement with a wavelength of 0.005 m."
        );
    }

    #[test]
    fn every_term_can_be_said() {
        for modulator in Modulator::ALL {
            for argument in
                Argument::ALL.into_iter().filter(|q| !(modulator.acts_on_input() && *q == Argument::Force))
            {
                for form in Form::ALL {
                    let parameters = vec![2.0; form.parameters().len()];
                    let one = term(modulator, argument, form, -3.25, &parameters);
                    let (equation, sentence) = (one.equation("A"), one.sentence("A"));
                    assert!(equation.contains("3.25") && !equation.contains("  +"), "{equation}");
                    assert!(
                        sentence.ends_with('.') && sentence.starts_with(char::is_uppercase),
                        "{sentence}"
                    );
                    assert!(!sentence.contains("NaN") && !equation.contains("NaN"), "{equation} {sentence}");
                    assert_eq!(one.numbers("A").len(), one.values().len());
                }
            }
        }
    }
}
