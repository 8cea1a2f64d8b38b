//! The catalogue of cases: injected effects, their sizes, and the runs with them.
//!
//! A case has three runs of 30 s at 512 Hz (training, validation, test; fields `estimate`, `confirm`, `test`), each with its own motion,
//! current and noise. They start at 22, 34 and 46 °C, and a small heat capacity lets the damper warm by about 20 K during a run, so
//! thermal fade can be separated from drift. The road is rough enough for masses and lags, and its amplitude is large enough for end
//! stops. The current is an APRBS that is often near zero, where friction is visible next to the yield force. Runs have a velocity
//! channel, which the diagnosis uses only if asked ([`super::outcome::Instrumentation`]).
//!
//! | kind | truth | base structure fits |
//! |---|---|---|
//! | null, single, pair, outside | quasi-static valve with no effect, one, two, or one outside the library | yes |
//! | wrong base | Bouc-Wen valve, with no or one effect | no |
//! | wrong base (bristle) | bristle valve, with no or one effect | no |
//! | wrong base (thinning) | quasi-static valve with a fluid that shear thins, with no or one effect | no |
//! | paired | Bouc-Wen valve, with no or one effect, and a healthy run with the same excitation | no |
//!
//! The cases without an effect, except paired ones, also come with worse measuring instruments ([`super::instruments`]).
//!
//! The rig has a compliance (6 MN/m) in series with its Bouc-Wen and bristle valves, so each case of "wrong base" with them has a spring
//! in series. A fluid that shear thins is what the library calls a velocity saturation with a negative coefficient.

use super::instruments::Instrument;
use super::rates::library_id;
use mr_damper_model::Error;
use mr_damper_model::rig::inject::{EFFECTS, Effect, inject};
use mr_damper_model::rig::{Channels, Current, Displacement, Experiment, Pattern, Plant, Road, record};
use mr_damper_model::sample::Run;

/// Noise of the velocity transducer, m/s: 0.05 % of the fastest stroke.
const VELOCITY_NOISE_M_S: f64 = 2e-4;
/// Temperature at the start of the training, validation and test run, °C.
const START_C: [f64; 3] = [22.0, 34.0, 46.0];
/// Heat capacity of the damper, J/K: a fraction of a real damper's, so that it warms up within a run.
const HEAT_CAPACITY_J_K: f64 = 80.0;
/// Full stiffness of the end stops, N/m.
const END_STOP_N_M: f64 = 1e5;

/// The rig's effects that the library has, with their full size in the rig's unit; for the end stop, its stiffness in N/m.
///
/// Double the size is still physically plausible, even if the effect is then small (inertia, drift). The table gives the change of the
/// force, and the NMSE (thesis: ESR) of the base alone on the test run, with measured velocity and without filter, as the median of two
/// seeds. The NMSE for the healthy damper is 1.0e-4, or 1.6e-3 if the velocity is the backward difference, which is half a sample late.
///
/// | effect | dF/F at half, full, double (%) | NMSE at half, full, double (1e-3) |
/// |---|---|---|
/// | coil_lag | 6.5, 10.4, 13.5 | 4.4, 10.9, 17.6 |
/// | remanence | 4.6, 9.0, 17.4 | 1.7, 6.1, 20.8 |
/// | thermal_fade | 5.7, 12.2, 21.6 | 1.7, 10.5, 30.1 |
/// | gas_spring | 3.8, 7.2, 14.2 | 0.80, 2.6, 8.4 |
/// | inertia | 1.4, 3.0, 5.4 | 0.26, 0.91, 2.8 |
/// | friction | 7.0, 14.9, 31.0 | 0.15, 0.28, 0.52 |
/// | asymmetry | 3.9, 7.8, 15.6 | 1.8, 6.9, 26.1 |
/// | force_lag | 9.0, 16.6, 29.1 | 6.7, 20.8, 68.7 |
/// | series_spring | 8.1, 13.9, 22.0 | 5.0, 15.5, 36.2 |
/// | sensor_delay | 9.9, 18.8, 34.9 | 8.0, 28.0, 92.9 |
/// | deadzone | 15.1, 22.4, 27.7 | 16.5, 34.8, 55.4 |
/// | end_stop | 6.4, 7.2, 13.3 | 4.0, 5.6, 19.2 |
/// | load_cell_drift | 0.17, 0.32, 0.67 | 0.11, 0.11, 0.16 |
/// | position_dependence | 1.5, 3.3, 6.4 | 0.37, 1.2, 4.5 |
/// | velocity_saturation | 9.9, 21.3, 40.3 | 0.45, 2.0, 5.1 |
/// | anti_alias_mismatch | 9.8, 18.1, 33.9 | 8.0, 24.3, 83.5 |
pub(crate) fn sizes() -> Vec<(&'static str, f64)> {
    let full = |effect: &Effect| if effect.id == "end_stop" { END_STOP_N_M } else { effect.typical };
    let known = EFFECTS.iter().filter(|effect| library_id(effect.id).is_some());
    known.map(|effect| (effect.id, full(effect))).collect()
}

/// Effects outside the library.
pub(crate) const OUTSIDE: [(&str, f64); 4] =
    [("position_ripple", 0.15), ("force_loss", 0.15), ("mains_hum", 30.0), ("wear_step", 0.25)];

/// Pairs of effects of different classes.
const PAIRS: [[&str; 2]; 8] = [
    ["coil_lag", "gas_spring"],
    ["coil_lag", "asymmetry"],
    ["remanence", "friction"],
    ["thermal_fade", "coil_lag"],
    ["force_lag", "gas_spring"],
    ["series_spring", "asymmetry"],
    ["sensor_delay", "position_dependence"],
    ["end_stop", "thermal_fade"],
];

/// Kind of a case; see the table at the top of this file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Null,
    Single,
    Pair,
    Outside,
    WrongBase(Valve),
    Paired,
}

/// The valve of a case whose truth the fuzzy-tanh base does not fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Valve {
    BoucWen,
    Bristle,
    Thinning,
}

impl Kind {
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Null => "null",
            Self::Single => "single",
            Self::Pair => "pair",
            Self::Outside => "outside",
            Self::WrongBase(Valve::BoucWen) => "wrong base",
            Self::WrongBase(Valve::Bristle) => "wrong base (bristle)",
            Self::WrongBase(Valve::Thinning) => "wrong base (thinning)",
            Self::Paired => "paired",
        }
    }

    /// Effect, by the rig's id, that already the healthy damper has and that its force law lacks.
    pub(crate) const fn own_effect(self) -> Option<&'static str> {
        match self {
            Self::WrongBase(Valve::BoucWen | Valve::Bristle) => Some("series_spring"),
            Self::WrongBase(Valve::Thinning) => Some("velocity_saturation"),
            _ => None, // in paired mode, the healthy run has it, too
        }
    }

    /// The healthy damper.
    fn plant(self, start_c: f64) -> Plant {
        let valve = match self {
            Self::WrongBase(Valve::BoucWen) | Self::Paired => Plant::plain(),
            Self::WrongBase(Valve::Bristle) => Plant::bristle(),
            Self::WrongBase(Valve::Thinning) => Plant::shear_thinning(),
            _ => Plant::quasi_static(),
        };
        Plant { start_c, heat_capacity_j_k: HEAT_CAPACITY_J_K, ..valve }
    }
}

/// One row of the catalogue; its cases differ by their seed.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct CaseSpec {
    pub(crate) kind: Kind,
    /// Effects by the rig's ids, with their sizes.
    pub(crate) truth: Vec<(&'static str, f64)>,
    /// Size as a multiple of the full size.
    pub(crate) share: f64,
    /// Measuring instrument of the runs.
    pub(crate) instrument: Instrument,
}

/// Runs with a known truth.
#[derive(Debug, Clone)]
pub(crate) struct Case {
    pub(crate) kind: Kind,
    pub(crate) name: String,
    pub(crate) seed: u64,
    /// Effects by the rig's ids, with their sizes.
    pub(crate) truth: Vec<(&'static str, f64)>,
    pub(crate) estimate: Vec<Run>,
    pub(crate) confirm: Vec<Run>,
    pub(crate) test: Vec<Run>,
    /// In paired mode healthy runs with the excitation of `estimate`, `confirm` and `test`; otherwise empty.
    pub(crate) reference: Vec<Run>,
}

/// All case specifications, in the order of the table at the top of this file.
pub(crate) fn catalogue() -> Vec<CaseSpec> {
    let spec = |kind, truth: &[(&'static str, f64)], share: f64| CaseSpec {
        kind,
        truth: truth.iter().map(|(id, full)| (*id, share * full)).collect(),
        share,
        instrument: Instrument::Fine,
    };
    let mut specs = vec![spec(Kind::Null, &[], 1.0)];
    for share in [0.5, 1.0, 2.0] {
        specs.extend(sizes().into_iter().map(|effect| spec(Kind::Single, &[effect], share)));
    }
    specs.extend(PAIRS.map(|ids| spec(Kind::Pair, &ids.map(|id| (id, full_size(id))), 1.0)));
    specs.extend(OUTSIDE.map(|effect| spec(Kind::Outside, &[effect], 1.0)));
    let valves = [Valve::BoucWen, Valve::Bristle, Valve::Thinning].map(Kind::WrongBase);
    for kind in valves.iter().copied().chain([Kind::Paired]) {
        specs.push(spec(kind, &[], 1.0));
        specs.extend(sizes().into_iter().map(|effect| spec(kind, &[effect], 1.0)));
    }
    for kind in [Kind::Null].into_iter().chain(valves) {
        specs.extend(Instrument::WORSE.map(|instrument| CaseSpec { instrument, ..spec(kind, &[], 1.0) }));
    }
    specs
}

/// The case specification called `name`.
pub(crate) fn spec(name: &str) -> CaseSpec {
    catalogue().into_iter().find(|spec| spec.name() == name).unwrap_or_else(|| panic!("no case {name}"))
}

/// Full size of an effect of the library, in the rig's unit.
pub(crate) fn full_size(id: &str) -> f64 {
    sizes().into_iter().find(|(known, _)| *known == id).map_or(f64::NAN, |(_, size)| size)
}

impl CaseSpec {
    /// The name, for example `single coil_lag x0.5`.
    pub(crate) fn name(&self) -> String {
        let ids: Vec<&str> = self.truth.iter().map(|(id, _)| *id).collect();
        let truth = match (self.kind, ids.as_slice()) {
            (kind, []) if kind == Kind::Null => kind.name().to_owned(),
            (kind, []) => format!("{} null", kind.name()),
            (kind, ids) => format!("{} {} x{}", kind.name(), ids.join(" + "), self.share),
        };
        match self.instrument {
            Instrument::Fine => truth,
            worse => format!("{truth}, {}", worse.name()),
        }
    }

    /// The case with the seed `seed`.
    ///
    /// # Errors
    /// If the rig rejects an effect.
    pub(crate) fn case(&self, seed: u64) -> Result<Case, Error> {
        self.with(&self.truth, seed)
    }

    /// The same motions, currents and noise without an effect.
    ///
    /// # Errors
    /// As [`CaseSpec::case`].
    pub(crate) fn healthy(&self, seed: u64) -> Result<Case, Error> {
        self.with(&[], seed)
    }

    /// Runs of the healthy damper with other motions and currents than [`CaseSpec::case`].
    ///
    /// # Errors
    /// As [`CaseSpec::case`].
    pub(crate) fn healthy_runs(&self, seed: u64) -> Result<Vec<Run>, Error> {
        Ok(self.healthy(seed + 100_000)?.estimate)
    }

    fn with(&self, truth: &[(&'static str, f64)], seed: u64) -> Result<Case, Error> {
        let channels = Channels::default().with_velocity(VELOCITY_NOISE_M_S);
        let run = |which: usize, name: &str| -> Result<Run, Error> {
            let run = self.record(truth, which, which, channels, seed)?;
            Ok(Run { name: format!("{name} {seed} of {}", self.name()), ..run })
        };
        let healthy = |which: usize| -> Result<Run, Error> {
            let run = self.record(&[], which, 3 + which, channels, seed)?;
            Ok(Run { name: format!("reference {seed}-{which} of {}", self.name()), ..run })
        };
        let references = if self.kind == Kind::Paired { 3 } else { 0 };
        Ok(Case {
            kind: self.kind,
            name: self.name(),
            seed,
            truth: truth.to_vec(),
            estimate: vec![run(0, "estimate")?],
            confirm: vec![run(1, "confirm")?],
            test: vec![run(2, "test")?],
            reference: (0..references).map(healthy).collect::<Result<_, _>>()?,
        })
    }

    /// Change of the test run's force by the effects: standard deviation, as a share of the healthy force's.
    ///
    /// # Errors
    /// If the rig rejects an effect.
    pub(crate) fn change(&self, seed: u64) -> Result<f64, Error> {
        let force = |truth: &[(&'static str, f64)]| -> Result<Vec<f64>, Error> {
            let run = self.record(truth, 2, 2, Channels::PERFECT, seed)?;
            Ok(run.force_n.map(|trace| trace.values).unwrap_or_default())
        };
        let (healthy, changed) = (force(&[])?, force(&self.truth)?);
        let apart: Vec<f64> = changed.iter().zip(&healthy).map(|(a, b)| a - b).collect();
        Ok(deviation(&apart) / deviation(&healthy))
    }

    /// Run number `which` (0 training, 1 validation, 2 test) with sensor noise number `noise`.
    fn record(
        &self,
        truth: &[(&'static str, f64)],
        which: usize,
        noise: usize,
        mut channels: Channels,
        seed: u64,
    ) -> Result<Run, Error> {
        let plant = self.plant(truth, which, &mut channels)?;
        let mut template = experiment(&self.name());
        if self.instrument == Instrument::OneCurrent {
            template.current = Current::Constant { current_a: 1.2 };
        }
        let (experiment, _) = template.replicate(which as u32 + 1, seed, Pattern::New);
        let (_, seed) = template.replicate(noise as u32 + 1, seed, Pattern::New);
        Ok(self.instrument.apply(record(&experiment, &plant, &channels, seed), seed))
    }

    /// The damper of run number `which` with its channels, which have a velocity transducer.
    ///
    /// # Errors
    /// If the rig rejects an effect.
    pub(crate) fn damper(&self, which: usize) -> Result<(Plant, Channels), Error> {
        let mut channels = Channels::default().with_velocity(VELOCITY_NOISE_M_S);
        let plant = self.plant(&self.truth, which, &mut channels)?;
        Ok((plant, channels))
    }

    /// The damper of run number `which` with the effects `truth`, of which `channels` gets its part.
    fn plant(
        &self,
        truth: &[(&'static str, f64)],
        which: usize,
        channels: &mut Channels,
    ) -> Result<Plant, Error> {
        let healthy = self.kind.plant(START_C[which]);
        let mut plant = healthy;
        for &(id, size) in truth {
            match id {
                "end_stop" => {
                    // The road goes beyond the displacement at which the typical end stops begin.
                    let begin_m =
                        EFFECTS.iter().find(|effect| effect.id == id).map_or(f64::NAN, |e| e.typical);
                    inject(id, begin_m, &mut plant, channels)?;
                    plant.end_stop_n_m = size;
                }
                // In series with the compliance that the plant already has.
                "series_spring" => {
                    let own = 1.0 / healthy.series_stiffness_n_m;
                    inject(id, own + size, &mut plant, channels)?;
                }
                _ => inject(id, size, &mut plant, channels)?,
            }
        }
        Ok(plant)
    }
}

/// A road up to about 8 Hz with a span of 35 mm; standard deviations 0.14 m/s (velocity) and 6 m/s² (acceleration). The current is the
/// thesis' APRBS with twice its standard deviation.
fn experiment(name: &str) -> Experiment {
    let road = Road { level_hz: 3.0, band_hz: 8.0, span_m: Some(0.035), ..Road::SMOOTH_HIGHWAY };
    let current =
        Current::Aprbs { low_a: 0.0, high_a: 2.5, mean_a: 1.2, deviation_a: 1.0, hold_probability: 0.99 };
    Experiment::new(name, Displacement::Road(road), current, 30.0)
}

/// Standard deviation.
fn deviation(values: &[f64]) -> f64 {
    let count = values.len().max(1) as f64;
    let mean = values.iter().sum::<f64>() / count;
    (values.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / count).sqrt()
}
