//! Experiments by name: displacement, current, duration and number of replicates.
//!
//! There are the eight experiments of the thesis (Table 3.2), the ten of the first paper (Table II), and a sine, a chirp and the plain
//! road.
//!
//! Table 3.2 gives signals, replicates, durations, maximum frequencies and spans, which are used unchanged. It does not give the share
//! of a road's power at low frequencies ([`Road::level_hz`]): this is set for each experiment so that the force has the standard
//! deviation of the thesis' runs, see [`super::Plant`]. The first paper gives signals, replicates, a band (0.5 to 14.5 Hz), a range
//! (40 mm) and currents up to 4 A; the rest is chosen here. The plant is calibrated up to 2.5 A and extrapolates above.
//!
//! Experiments 6 to 10 of the first paper have seven replicates and a constant current whose value is not printed. This allows two
//! readings: seven runs at one current, or one run at each of seven currents. The second is the default, because the second paper
//! counts its own seven "replicates" in this way (one for each current step), and because the other experiments of the first paper
//! step through seven currents. With a current of their own (`simulate --current 1.2`) all replicates have the same one.
//!
//! Source: `[thesis]` and `[thesis-paper1]` in the bibliography (node/docs/guide/bibliography.md), table 3.2 of the thesis and table II
//! of the first paper.

use super::current::Current;
use super::second_order::SecondOrder;
use super::signal::{Displacement, RATE_HZ, Road};
use super::wave::Wave;
use crate::Error;

/// A planned run.
#[derive(Debug, Clone, PartialEq)]
pub struct Experiment {
    /// Name; for an experiment of the thesis or paper, the name in its table.
    pub name: String,
    /// Displacement of the actuator; with a servo, its set point.
    pub displacement: Displacement,
    /// Current command.
    pub current: Current,
    /// Duration in seconds.
    pub duration_s: f64,
    /// Currents of the replicates in turn, A, in place of the constant `current`; empty if all replicates have the same.
    pub replicate_currents_a: Vec<f64>,
    /// Number of replicates in the source.
    pub replicates: u32,
    /// Dynamics of the actuator behind its set point; `None` if the actuator follows `displacement` exactly.
    pub servo: Option<SecondOrder>,
    /// Seed of the excitation; `None` to use the seed of the run. Runs with the same pattern and different seeds are replicates, which
    /// differ only in sensor noise.
    pub pattern: Option<u64>,
}

/// One row of Table 3.2: name, current, replicates, duration (s), maximum frequency (Hz), span (m). The last value, the frequency below
/// which the road spectrum is level (Hz), is chosen here.
type Row = (&'static str, fn() -> Current, u32, f64, f64, f64, f64);

const THESIS: [Row; 8] = [
    ("RP-ICPS", || Current::ICPS, 11, 30.0, 5.5, 0.026_416, 2.0),
    ("RP-APRBS", || Current::APRBS, 11, 30.0, 4.5, 0.027_432, 3.0),
    ("RP-PRBS", || Current::PRBS, 11, 30.0, 4.2, 0.029_718, 1.5),
    ("RP-APRBS-L", || Current::APRBS, 3, 600.0, 4.5, 0.027_432, 4.0),
    ("RP-ICPS-L", || Current::ICPS, 4, 600.0, 5.5, 0.025_908, 3.0),
    ("RP1-CS", Current::stepped, 1, 210.0, 5.5, 0.033_528, 1.35),
    ("RP2-CS", Current::stepped, 1, 210.0, 4.5, 0.033_274, 1.65),
    ("RP3-CS", Current::stepped, 1, 210.0, 4.5, 0.036_068, 1.5),
];

/// One row of Table II of the first paper: name, displacement, current, replicates.
type PaperRow = (&'static str, Displacement, fn() -> Current, u32);

const PAPER1: [PaperRow; 10] = [
    ("paper1-1", AM, paper_steps, 11),
    ("paper1-2", TPNVS, paper_steps, 11),
    ("paper1-3", SFS, paper_steps, 7),
    ("paper1-4", FM, || PAPER_ICPS, 10),
    ("paper1-5", PAPER_ROAD, || PAPER_APRBS, 11),
    ("paper1-6", SFS, || PAPER_CONSTANT, 7),
    ("paper1-7", AM, || PAPER_CONSTANT, 7),
    ("paper1-8", TPNVS, || PAPER_CONSTANT, 7),
    ("paper1-9", FM, || PAPER_CONSTANT, 7),
    ("paper1-10", PAPER_ROAD, || PAPER_CONSTANT, 7),
];

/// Seven levels, up to the first paper's 4 A.
const PAPER_LEVELS_A: [f64; 7] = [0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0];

/// The levels with equal duration.
fn paper_steps() -> Current {
    Current::Stepped { levels_a: PAPER_LEVELS_A.to_vec() }
}

const PAPER_ICPS: Current = Current::Icps { low_a: 0.0, high_a: 4.0, hold_s: 0.2 };
const PAPER_APRBS: Current =
    Current::Aprbs { low_a: 0.0, high_a: 4.0, mean_a: 2.0, deviation_a: 0.8, hold_probability: 0.99 };
const PAPER_CONSTANT: Current = Current::Constant { current_a: PAPER_LEVELS_A[0] };
const AM: Displacement = Displacement::Wave(Wave::AmplitudeModulated {
    amplitude_m: 0.02,
    depth: 0.8,
    carrier_hz: 2.0,
    modulation_hz: 0.2,
});
const FM: Displacement = Displacement::Wave(Wave::FrequencyModulated {
    amplitude_m: 0.004,
    carrier_hz: 7.5,
    deviation_hz: 7.0,
    modulation_hz: 0.1,
});
const SFS: Displacement =
    Displacement::Wave(Wave::SteppedFrequency { amplitude_m: 0.0025, low_hz: 0.5, high_hz: 14.5, steps: 8 });
const TPNVS: Displacement =
    Displacement::Wave(Wave::Slopes { amplitude_m: 0.015, slowest_m_s: 0.03, fastest_m_s: 0.24, slopes: 8 });
/// Amplitudes up to 0.5 in, as stated in the second paper for the same bench.
const PAPER_ROAD: Displacement = Displacement::Road(Road {
    f_min_hz: 0.5,
    f_max_hz: 14.5,
    level_hz: 2.0,
    span_m: Some(0.0254),
    ..Road::SMOOTH_HIGHWAY
});

impl Experiment {
    /// Names that [`Experiment::thesis`] knows, in the order of Table 3.2.
    pub fn names() -> impl Iterator<Item = &'static str> {
        THESIS.iter().map(|row| row.0)
    }

    /// Names that [`Experiment::paper1`] knows, in the order of its Table II.
    pub fn paper1_names() -> impl Iterator<Item = &'static str> {
        PAPER1.iter().map(|row| row.0)
    }

    /// The thesis' experiment called `name`; `None` if the name is not known.
    #[must_use]
    pub fn thesis(name: &str) -> Option<Self> {
        let &(name, current, replicates, duration_s, band_hz, span_m, level_hz) =
            THESIS.iter().find(|row| row.0.eq_ignore_ascii_case(name))?;
        let road = Road { level_hz, band_hz, span_m: Some(span_m), ..Road::SMOOTH_HIGHWAY };
        let plan = Self::new(name, Displacement::Road(road), current(), duration_s);
        Some(Self { replicates, ..plan })
    }

    /// The first paper's experiment called `name` (`paper1-1` to `paper1-10`); `None` if the name is not known. Experiments with a
    /// stepped current take 210 s, the others 30 s.
    #[must_use]
    pub fn paper1(name: &str) -> Option<Self> {
        let &(name, displacement, current, replicates) =
            PAPER1.iter().find(|row| row.0.eq_ignore_ascii_case(name))?;
        let current = current();
        let duration_s = if matches!(current, Current::Stepped { .. }) { 210.0 } else { 30.0 };
        let constant = matches!(current, Current::Constant { .. });
        let replicate_currents_a = if constant { PAPER_LEVELS_A.to_vec() } else { Vec::new() };
        Some(Self { replicates, replicate_currents_a, ..Self::new(name, displacement, current, duration_s) })
    }

    /// One run of `duration_s` seconds with an ideal actuator.
    #[must_use]
    pub fn new(name: &str, displacement: Displacement, current: Current, duration_s: f64) -> Self {
        let name = name.to_owned();
        let replicate_currents_a = Vec::new();
        Self {
            name,
            displacement,
            current,
            duration_s,
            replicate_currents_a,
            replicates: 1,
            servo: None,
            pattern: None,
        }
    }

    /// A sine with a constant current, for maps of force over velocity.
    #[must_use]
    pub fn sine(amplitude_m: f64, frequency_hz: f64, current_a: f64, duration_s: f64) -> Self {
        let name = format!("sine {frequency_hz} Hz {current_a} A");
        let displacement = Displacement::Sine { amplitude_m, frequency_hz };
        Self::new(&name, displacement, Current::Constant { current_a }, duration_s)
    }

    /// A chirp over the whole run with a constant current.
    #[must_use]
    pub fn chirp(amplitude_m: f64, from_hz: f64, to_hz: f64, current_a: f64, duration_s: f64) -> Self {
        let displacement = Displacement::Wave(Wave::Chirp { amplitude_m, from_hz, to_hz });
        Self::new("chirp", displacement, Current::Constant { current_a }, duration_s)
    }

    /// The plain road (smooth highway at 25 mph, standard spectrum, not scaled) with a constant current.
    #[must_use]
    pub fn road(current_a: f64, duration_s: f64) -> Self {
        let displacement = Displacement::Road(Road::SMOOTH_HIGHWAY);
        Self::new("road", displacement, Current::Constant { current_a }, duration_s)
    }

    /// This experiment with another duration in seconds. The levels of a stepped current share it equally.
    #[must_use]
    pub fn with_duration_s(self, duration_s: f64) -> Self {
        Self { duration_s, ..self }
    }

    /// This experiment with the same constant current in A in all replicates; unchanged if its current is not constant.
    #[must_use]
    pub fn with_constant_current_a(mut self, current_a: f64) -> Self {
        if let Current::Constant { current_a: own } = &mut self.current {
            *own = current_a;
            self.replicate_currents_a.clear();
        }
        self
    }

    /// This experiment with its excitation fixed by the seed `pattern`; see [`Experiment::pattern`].
    #[must_use]
    pub fn with_pattern(self, pattern: u64) -> Self {
        Self { pattern: Some(pattern), ..self }
    }

    /// This experiment with an actuator that follows its set point with the dynamics of `servo`. The roll-off of a road, which represents
    /// the gain of the servo if there is none, is removed.
    #[must_use]
    pub fn with_servo(mut self, servo: SecondOrder) -> Self {
        if let Displacement::Road(road) = &mut self.displacement {
            road.servo_hz = f64::INFINITY;
        }
        Self { servo: Some(servo), ..self }
    }

    /// Number of samples; zero for a duration that is not a positive number.
    #[must_use]
    pub fn samples(&self) -> usize {
        // The cast turns negative values and NaN into zero.
        (self.duration_s * RATE_HZ).round() as usize
    }

    /// Checks the duration (0.1 s to 1 day), amplitudes and frequencies, a constant current (0 to 5 A) and the servo.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] names the field.
    pub fn check(&self) -> Result<(), Error> {
        Error::check("duration_s", self.duration_s, "0.1 to 86400 s", |t| (0.1..=86_400.0).contains(&t))?;
        match self.displacement {
            Displacement::Wave(wave) => wave.check()?,
            Displacement::Sine { amplitude_m, frequency_hz } => {
                let same = Wave::Chirp { amplitude_m, from_hz: frequency_hz, to_hz: frequency_hz };
                same.check()?;
            }
            Displacement::Road(_) => {}
        }
        let constant =
            if let Current::Constant { current_a } = self.current { Some(current_a) } else { None };
        for current_a in constant.iter().chain(&self.replicate_currents_a) {
            Error::check("current_a", *current_a, "0 to 5 A", |i| (0.0..=5.0).contains(&i))?;
        }
        self.servo.map_or(Ok(()), |servo| servo.check())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_is_an_experiment() {
        for (names, find, count) in [
            (Experiment::names().collect::<Vec<_>>(), Experiment::thesis as fn(&str) -> Option<_>, 8),
            (Experiment::paper1_names().collect(), Experiment::paper1, 10),
        ] {
            assert_eq!(names.len(), count);
            for name in names {
                let found = find(name);
                assert_eq!(found.as_ref().map(|e| e.name.as_str()), Some(name));
                assert_eq!(found.map(|e| e.check()), Some(Ok(())), "{name}");
                assert_eq!(find(&name.to_uppercase()), find(&name.to_lowercase()), "{name}");
            }
        }
        assert_eq!(Experiment::thesis("RP-XYZ"), None);
        assert_eq!(Experiment::paper1("paper1-11"), None);
    }

    #[test]
    fn replicates_match_the_tables() {
        let of = |names: Vec<&str>, find: fn(&str) -> Option<Experiment>| -> Vec<u32> {
            names.into_iter().filter_map(find).map(|e| e.replicates).collect()
        };
        let thesis = of(Experiment::names().collect(), Experiment::thesis);
        assert_eq!(thesis, [11, 11, 11, 3, 4, 1, 1, 1]);
        assert_eq!(thesis.iter().sum::<u32>(), 43);
        let paper = of(Experiment::paper1_names().collect(), Experiment::paper1);
        assert_eq!(paper, [11, 11, 7, 10, 11, 7, 7, 7, 7, 7]);
    }

    #[test]
    fn durations_can_be_overridden() {
        let samples = |duration| Experiment::thesis("RP3-CS").map(|e| e.with_duration_s(duration).samples());
        assert_eq!(samples(7.0), Some(7 * 512));
        assert_eq!(samples(-1.0), Some(0));
        assert_eq!(samples(f64::NAN), Some(0));
    }

    #[test]
    fn invalid_experiments_are_rejected_with_the_field_name() {
        let refused = |e: Experiment| e.check().err().map(|e| e.to_string()).unwrap_or_default();
        assert!(refused(Experiment::road(1.0, -1.0)).starts_with("duration_s"));
        assert!(refused(Experiment::road(9.0, 1.0)).starts_with("current_a"));
        assert!(refused(Experiment::sine(0.0, 1.0, 0.0, 1.0)).starts_with("amplitude_m"));
        assert!(refused(Experiment::chirp(0.01, 1.0, 1e6, 0.0, 1.0)).starts_with("to_hz"));
    }
}
