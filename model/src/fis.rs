//! Reads and writes MATLAB's `.fis` text of a Sugeno fuzzy system.
//!
//! ```text
//! [System]                                  [Output1]
//! Name='damper'                             Name='force'
//! Type='sugeno'                             Range=[-3.9 3.9]
//! NumInputs=1                               NumMFs=2
//! NumOutputs=1                              MF1='out1mf1':'linear',[0.2 -0.1]
//! NumRules=2                                MF2='out1mf2':'linear',[0.3 0.4]
//! AndMethod='prod'
//! DefuzzMethod='wtaver'                     [Rules]
//!                                           1, 1 (1) : 1
//! [Input1]                                  2, 2 (1) : 1
//! Name='velocity'
//! Range=[-3 3]
//! NumMFs=2
//! MF1='slow':'gaussmf',[1.5 -3]             linear: a slope for each input, the constant; constant
//! MF2='fast':'gaussmf',[1.5 3]
//! ```
//!
//! | membership | numbers | [`TskSet`] |
//! |---|---|---|
//! | gaussmf | sigma, centre | `Gaussian` |
//! | gauss2mf | sigma, centre, sigma, centre | `TwoSidedGaussian` |
//! | gbellmf | a, b, c of 1 / (1 + abs((u - c)/a)^(2 b)) | `Bell` |
//! | trimf | foot, peak, foot | `Triangle` or `Trapezoid` |
//! | trapmf | foot, shoulder, shoulder, foot | `Trapezoid` |
//!
//! The formulas depend on the square or absolute value of a width, so a negative width is read as a positive one.
//! The memberships of one input have one shape; triangles beside trapezoids are read as trapezoids, and Gaussians beside
//! two-sided ones as two-sided.
//!
//! A file that a [`Tsk`] cannot represent is refused: other shapes, operators, weights or connectives, and
//! rules that do not cover each combination of memberships exactly once. Spaces, blank lines, `%` and `#`
//! comments, both kinds of quotes, commas or blanks between numbers, and any order of rules are accepted.
//!
//! The format has no units and no normalisation, so [`Scaling`] holds them separately. Numbers are written
//! with as many digits as are needed to read the same number back; MATLAB itself writes 15.
//!
//! The outermost triangles of a model are shoulders, but `trimf` falls to zero on both sides. Within the range of an
//! input, the surface of a file and of its model are equal:
//!
//! - `trimf` is read as triangles if both have the same weights in the range, otherwise as trapezoids, which have no
//!   shoulders.
//! - Triangles are written as `trimf` on the same condition, otherwise as `trapmf` with shoulders that reach far out.
//! - A file is refused if none of an input's triangles or trapezoids is above zero in a part of its range: no rule fires
//!   there, and MATLAB returns the middle of the output's range with a warning.
//!
//! Outside the range, a model continues with the rules of [`TskInput::weights`], and MATLAB warns.

mod piecewise;
mod read;
#[cfg(test)]
mod tests;

use crate::error::Error;
use crate::force::{Order, OutputScale, Shape, Signal, Tsk, TskInput, TskKind, TskSet};
use crate::model::Envelope;
use crate::sample::DriveKind;
use std::fmt::Write;

/// A Sugeno system on a full grid, as stored in a file.
#[derive(Debug, Clone, PartialEq)]
pub struct Fis {
    /// Name of the system.
    pub name: String,
    /// Its inputs, in order.
    pub inputs: Vec<FisInput>,
    /// Name of the output.
    pub output_name: String,
    /// Range of the output.
    pub output_range: [f64; 2],
    /// Order of the conclusions.
    pub order: Order,
    /// The conclusions, rule by rule; the set of the first input varies slowest.
    pub conclusions: Vec<f64>,
}

/// One input of a system.
#[derive(Debug, Clone, PartialEq)]
pub struct FisInput {
    /// Name of the input.
    pub name: String,
    /// Range of the input.
    pub range: [f64; 2],
    /// Its membership functions.
    pub sets: Vec<TskSet>,
}

/// Data that the format does not hold: signals, units and normalisation.
#[derive(Debug, Clone, PartialEq)]
pub struct Scaling {
    /// Signal, mean and standard deviation of each input, in the signal's unit; mean 0 and deviation 1 when
    /// the system takes plain SI values.
    pub inputs: Vec<(Signal, f64, f64)>,
    /// Scale that undoes the normalisation of the output.
    pub output: OutputScale,
    /// Force offset of the session, N.
    pub force_offset_n: f64,
}

impl FisInput {
    /// The signal whose name the input's name begins with, in upper or lower case, e.g. `Velocity (m/s)`. The
    /// names are displacement, velocity, acceleration, current and voltage.
    #[must_use]
    pub fn signal(&self) -> Option<Signal> {
        let name = self.name.to_lowercase();
        SIGNALS.into_iter().find(|signal| name.starts_with(name_of(*signal)))
    }
}

/// The signals that an input can be.
const SIGNALS: [Signal; 5] = [
    Signal::Displacement,
    Signal::Velocity,
    Signal::Acceleration,
    Signal::Drive(DriveKind::CoilCurrent),
    Signal::Drive(DriveKind::CommandVoltage),
];

/// Name of a signal in files.
const fn name_of(signal: Signal) -> &'static str {
    match signal {
        Signal::Drive(DriveKind::CoilCurrent) => "current",
        Signal::Drive(DriveKind::CommandVoltage) => "voltage",
        other => other.name(),
    }
}

/// The range of `signal` in `envelope`; `None` for acceleration, whose range is not recorded.
const fn range_in(envelope: &mut Envelope, signal: Signal) -> Option<&mut Option<[f64; 2]>> {
    match signal {
        Signal::Displacement => Some(&mut envelope.displacement_m),
        Signal::Velocity => Some(&mut envelope.velocity_m_s),
        Signal::Drive(_) => Some(&mut envelope.drive),
        Signal::Force => Some(&mut envelope.force_n),
        Signal::Acceleration => None,
    }
}

impl Scaling {
    /// The scaling of a model.
    #[must_use]
    pub fn of(model: &Tsk) -> Self {
        let one = |input: &TskInput| (input.signal(), input.mean(), input.std_dev());
        Self {
            inputs: model.inputs().iter().map(one).collect(),
            output: model.output(),
            force_offset_n: model.force_offset_n(),
        }
    }
}

impl Fis {
    /// Parses the text of a file.
    ///
    /// # Errors
    /// [`Error::Fis`] with the line and what is wrong there.
    pub fn parse(text: &str) -> Result<Self, Error> {
        read::parse(text)
    }

    /// The system of `model`. The range of an input is the range of its sets' centres, because the model
    /// stores no other; [`Fis::with_ranges`] takes the ranges from an envelope.
    #[must_use]
    pub fn of(model: &Tsk, name: &str) -> Self {
        let input = |input: &TskInput| {
            let tops = || input.sets().map(|set| set.top());
            let [low, high] =
                [tops().fold(f64::INFINITY, f64::min), tops().fold(f64::NEG_INFINITY, f64::max)];
            // A range has a width, also around a single set.
            let width = low.abs().max(1.0);
            let range = if low < high { [low, high] } else { [low - width, high + width] };
            FisInput { name: name_of(input.signal()).to_owned(), range, sets: input.sets().collect() }
        };
        Self {
            name: name.to_owned(),
            inputs: model.inputs().iter().map(input).collect(),
            output_name: "force".to_owned(),
            output_range: [-4.0, 4.0],
            order: model.order(),
            conclusions: model.conclusions().to_vec(),
        }
    }

    /// The model that this system and `scaling` define.
    ///
    /// # Errors
    /// [`Error::Length`] if `scaling` has a different number of inputs; the errors of [`TskInput::new`] and
    /// [`Tsk::new`].
    pub fn model(&self, kind: TskKind, scaling: &Scaling) -> Result<Tsk, Error> {
        if scaling.inputs.len() != self.inputs.len() {
            return Err(Error::Length {
                name: "scaling.inputs".to_owned(),
                found: scaling.inputs.len(),
                expected: format!("{} (one for each input of the system)", self.inputs.len()),
            });
        }
        let inputs = self
            .inputs
            .iter()
            .zip(&scaling.inputs)
            .map(|(input, (signal, mean, std_dev))| TskInput::new(*signal, *mean, *std_dev, &input.sets))
            .collect::<Result<Vec<_>, Error>>()?;
        Tsk::new(kind, &inputs, self.order, &self.conclusions, scaling.output, scaling.force_offset_n)
    }

    /// The ranges of the inputs and of the output, in SI units.
    #[must_use]
    pub fn envelope(&self, scaling: &Scaling) -> Envelope {
        let mut envelope = Envelope::default();
        for (input, (signal, mean, std_dev)) in self.inputs.iter().zip(&scaling.inputs) {
            if let Some(range) = range_in(&mut envelope, *signal) {
                *range = Some(input.range.map(|u| mean + std_dev * u));
            }
        }
        let OutputScale { mean_n, std_dev_n } = scaling.output;
        envelope.force_n = Some(self.output_range.map(|f| mean_n + std_dev_n * f));
        envelope
    }

    /// The system with the ranges of `envelope`. A range that is not known or has no width stays.
    #[must_use]
    pub fn with_ranges(mut self, envelope: &Envelope, scaling: &Scaling) -> Self {
        let mut envelope = *envelope;
        let mut take = |range: &mut [f64; 2], (signal, mean, std_dev): (Signal, f64, f64)| {
            let known = range_in(&mut envelope, signal).and_then(|range| *range);
            *range = match known.map(|known| known.map(|x| (x - mean) / std_dev)) {
                Some([low, high]) if low < high => [low, high],
                _ => *range,
            };
        };
        for (input, scale) in self.inputs.iter_mut().zip(&scaling.inputs) {
            take(&mut input.range, *scale);
        }
        let OutputScale { mean_n, std_dev_n } = scaling.output;
        take(&mut self.output_range, (Signal::Force, mean_n, std_dev_n));
        self
    }

    /// The text of the file.
    #[must_use]
    pub fn to_text(&self) -> String {
        let mut text = String::new();
        // Writing to a string cannot fail.
        let _ = self.write(&mut text);
        text
    }

    fn write(&self, text: &mut String) -> std::fmt::Result {
        let counts: Vec<usize> = self.inputs.iter().map(|input| input.sets.len()).collect();
        let rules: usize = counts.iter().product();
        writeln!(text, "[System]\nName='{}'\nType='sugeno'\nVersion=2.0", plain(&self.name))?;
        writeln!(text, "NumInputs={}\nNumOutputs=1\nNumRules={rules}", counts.len())?;
        writeln!(text, "AndMethod='prod'\nOrMethod='probor'\nImpMethod='prod'\nAggMethod='sum'")?;
        writeln!(text, "DefuzzMethod='wtaver'")?;
        for (j, input) in self.inputs.iter().enumerate() {
            let number = j + 1;
            writeln!(text, "\n[Input{number}]\nName='{}'\n{}", plain(&input.name), range(input.range))?;
            writeln!(text, "NumMFs={}", input.sets.len())?;
            let triangles = input.sets.iter().any(|set| set.shape() == Shape::Triangle);
            let sets = if triangles && !piecewise::as_shoulders(&input.sets, input.range) {
                piecewise::with_shoulders(&input.sets, input.range)
            } else {
                input.sets.clone()
            };
            for (k, set) in sets.iter().enumerate() {
                let (shape, numbers) = function_of(set);
                writeln!(text, "MF{}='in{number}mf{0}':'{shape}',{}", k + 1, list(&numbers))?;
            }
        }
        writeln!(text, "\n[Output1]\nName='{}'\n{}", plain(&self.output_name), range(self.output_range))?;
        writeln!(text, "NumMFs={rules}")?;
        let shape = match self.order {
            Order::Constant => "constant",
            Order::First => "linear",
        };
        for (k, numbers) in self.conclusions.chunks(self.order.width(counts.len())).enumerate() {
            writeln!(text, "MF{}='out1mf{0}':'{shape}',{}", k + 1, list(numbers))?;
        }
        writeln!(text, "\n[Rules]")?;
        for rule in 0..rules {
            let sets: Vec<String> =
                sets_of(rule, &counts).into_iter().map(|set| (set + 1).to_string()).collect();
            writeln!(text, "{}, {} (1) : 1", sets.join(" "), rule + 1)?;
        }
        Ok(())
    }
}

/// Name and numbers of a membership function in a file.
fn function_of(set: &TskSet) -> (&'static str, Vec<f64>) {
    match *set {
        TskSet::Gaussian { centre, sigma } => ("gaussmf", vec![sigma, centre]),
        TskSet::Triangle { left, peak, right } => ("trimf", vec![left, peak, right]),
        TskSet::Bell { half_width, exponent, centre } => ("gbellmf", vec![half_width, exponent, centre]),
        TskSet::Trapezoid { left_foot, left_shoulder, right_shoulder, right_foot } => {
            ("trapmf", vec![left_foot, left_shoulder, right_shoulder, right_foot])
        }
        TskSet::TwoSidedGaussian { left_sigma, left_centre, right_sigma, right_centre } => {
            ("gauss2mf", vec![left_sigma, left_centre, right_sigma, right_centre])
        }
    }
}

/// The set of each input in a rule; the last input's set varies fastest.
fn sets_of(rule: usize, counts: &[usize]) -> Vec<usize> {
    let mut rest = rule;
    let mut sets: Vec<usize> = counts
        .iter()
        .rev()
        .map(|count| {
            let set = rest % count;
            rest /= count;
            set
        })
        .collect();
    sets.reverse();
    sets
}

/// A name without characters that would end it in a file.
fn plain(name: &str) -> String {
    name.replace(['\n', '\'', '"'], "_")
}

fn range(range: [f64; 2]) -> String {
    format!("Range={}", list(&range))
}

fn list(numbers: &[f64]) -> String {
    // The shortest text that reads back as the same number.
    let texts: Vec<String> = numbers.iter().map(|number| format!("{number:?}")).collect();
    format!("[{}]", texts.join(" "))
}
