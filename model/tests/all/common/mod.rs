//! Test input for the pipeline: smooth motion, a stepping current, and a force close to the thesis models.

#![allow(dead_code, reason = "each test binary uses a part of it")]

#[path = "../../../benches/learned/mod.rs"]
mod learned;

pub(crate) use learned::with_learned;
use mr_damper_model::Error;
use mr_damper_model::condition::{ApplyTo, Conditioning, VelocitySource};
use mr_damper_model::force::{
    ForceModel, FuzzySets, Lazy, LazyMetric, LazyPoint, MAX_POINTS, MaxwellSlip, Membership, SlipFunction,
    SlipGrid,
};
use mr_damper_model::inverse::Method;
use mr_damper_model::model::{Envelope, Model};
use mr_damper_model::model_file::{ModelFile, Provenance};
use mr_damper_model::pipeline::{
    Estimate, Event, Models, Pipeline, PipelineSetup, Residual, Settings, UseForce,
};
use mr_damper_model::preset;
use mr_damper_model::sample::{Channel, Drive, DriveKind, Reading, Sample, Stamp};
use mr_damper_model::units::{Ampere, Metre, Newton};
use std::ops::Range;

/// Sample period of the thesis, ns.
pub(crate) const PERIOD_NS: i64 = 1_953_125;

pub(crate) fn preset(name: &str) -> Model {
    preset::load(name).expect("a known preset")
}

/// A Maxwell-slip model whose damping and bristle forces grow with the current, with the envelope of a preset.
pub(crate) fn maxwell_slip() -> Model {
    let function = |level: f64| SlipFunction {
        damping_slopes_n_s_m: [900.0, 1_000.0, 1_500.0, 2_500.0, 2_500.0, 1_500.0, 1_000.0, 900.0]
            .map(|slope| slope * (1.0 + 0.5 * level)),
        bristle_forces_n: [30.0, 50.0, 40.0, 20.0, 10.0].map(|force_n| force_n * (1.0 + 3.0 * level)),
        stiffness_n_m: 500.0,
        set_offset_n: 0.0,
    };
    let membership = Membership { drive: DriveKind::CoilCurrent, sigma: 0.45 };
    let sets = FuzzySets::new(membership, &[0.0, 0.9, 1.8, 2.5]).expect("sets");
    let grid = SlipGrid::new([0.01, 0.03, 0.1], [5e-4, 1e-3, 2e-3, 4e-3, 8e-3]).expect("a grid");
    let functions = [0.0, 0.9, 1.6, 2.0].map(function);
    let model = MaxwellSlip::new(grid, Some(sets), &functions, 20.0).expect("a model");
    Model { force: ForceModel::MaxwellSlip(model), ..preset(preset::BEST_FUZZY_TANH) }
}

/// Force of the damper that [`lazy`] remembers, N, without the session's offset.
pub(crate) fn remembered_n(displacement_m: f64, velocity_m_s: f64, current_a: f64) -> f64 {
    (300.0 + 400.0 * current_a) * (10.0 * velocity_m_s).tanh()
        + 3000.0 * displacement_m
        + 800.0 * velocity_m_s
}

/// A `boada` model of a full memory, with the envelope of a preset.
pub(crate) fn lazy() -> Model {
    // Golden-ratio sequence: an even cover of displacement, velocity and current.
    let share = |k: usize, step: f64| 2.0 * (k as f64 * step).fract() - 1.0;
    let point = |k: usize| {
        let (displacement_m, velocity_m_s) = (0.012 * share(k, 0.819_172_513), 0.2 * share(k, 0.671_043_607));
        let drive = 1.25 * (1.0 + share(k, 0.549_700_477));
        let force_n = remembered_n(displacement_m, velocity_m_s, drive);
        LazyPoint { displacement_m, velocity_m_s, drive, force_n }
    };
    let metric = LazyMetric {
        displacement_scale_m: 0.03,
        velocity_scale_m_s: 0.05,
        drive_scale: Some((DriveKind::CoilCurrent, 0.8)),
    };
    let points: Vec<LazyPoint> = (0..MAX_POINTS).map(point).collect();
    let model = Lazy::new(metric, [5, 12], &points, 15.0).expect("a model");
    let conditioning = Conditioning {
        apply_to: ApplyTo::None,
        velocity: VelocitySource::Backward,
        ..Conditioning::default()
    };
    let envelope = Envelope {
        displacement_m: Some([-0.012, 0.012]),
        velocity_m_s: Some([-0.2, 0.2]),
        drive: Some([0.0, 2.5]),
        force_n: Some([-2000.0, 2000.0]),
        ..Envelope::default()
    };
    Model { force: ForceModel::Lazy(model), conditioning, envelope, ..preset(preset::BEST_FUZZY_TANH) }
}

/// `model` with what `method` needs.
pub(crate) fn for_method(model: Model, method: Method) -> Model {
    method.learned().map_or(model, |kind| with_learned(model, kind))
}

/// The thesis' best fuzzy-tanh model with its best ARX model.
pub(crate) fn both() -> Models {
    Models::alone(preset(preset::BEST_FUZZY_TANH))
        .with_seeded(preset(preset::BEST_ARX))
        .expect("both want a current")
}

/// `model` with a fixed uncertainty table for tests, the same for every model.
pub(crate) fn calibrated(model: Model) -> Model {
    const TABLE: &str = "
[expected.uncertainty.free_run]
speed_edges_m_s = [0.05, 0.1]
drive_edges = [1.0]
std_dev_n = [[10.0, 12.0], [15.0, 17.0], [20.0, 22.0]]
half_band_n = [[20.0, 24.0], [30.0, 34.0], [40.0, 44.0]]
[expected.uncertainty.free_run.drive_held]
age_s = [0.002, 0.1, 0.3]
added_std_dev_n = [0.0, 20.0, 40.0]
added_half_band_n = [0.0, 40.0, 80.0]
[expected.uncertainty.one_step]
speed_edges_m_s = [0.1]
drive_edges = []
std_dev_n = [[1.0], [1.5]]
half_band_n = [[2.0], [3.0]]
[expected.uncertainty.one_step.drive_held]
age_s = [0.002, 0.3]
added_std_dev_n = [0.0, 0.5]
added_half_band_n = [0.0, 1.0]
[expected.uncertainty.one_step.coasting]
time_s = [0.001953125, 0.01, 0.25]
std_dev_factor = [1.0, 3.0, 8.0]
half_band_factor = [1.0, 3.0, 8.0]
[provenance]";
    let written = ModelFile { model, provenance: Provenance::default() }.to_toml().expect("writes");
    ModelFile::from_toml(&written.replacen("[provenance]", TABLE, 1)).expect("reads").model
}

fn motion(k: i64) -> (f64, f64, f64) {
    let t = k as f64 / 512.0;
    let x = 0.008 * (9.0 * t).sin() + 0.002 * (31.0 * t).sin();
    let v = 0.072 * (9.0 * t).cos() + 0.062 * (31.0 * t).cos();
    let i = [0.4, 1.2, 2.1, 0.8][(t / 0.2) as usize % 4];
    (x, v, i)
}

/// The measured force at sample `k`, N: close to the models' force, but not the output of any of them.
pub(crate) fn force_n(k: i64) -> f64 {
    let (x, v, i) = motion(k);
    (150.0 + 300.0 * i) * (12.0 * (v - 2.0 * x)).tanh() + 700.0 * v
}

/// Drive, force and displacement of sample `k`.
pub(crate) fn samples(k: i64, epoch_ns: i64) -> [Sample; 3] {
    let stamp = Stamp::from_nanos(epoch_ns + k * PERIOD_NS);
    let (x, _, i) = motion(k);
    [
        Reading::Drive(Drive::CoilCurrent(Ampere(i))),
        Reading::Force(Newton(force_n(k))),
        Reading::Displacement(Metre(x)),
    ]
    .map(|reading| Sample { stamp, received: stamp, reading })
}

/// A pipeline with its input settings and recorded events.
pub(crate) struct Harness {
    pub(crate) pipeline: Pipeline,
    pub(crate) events: Vec<Event>,
    pub(crate) epoch_ns: i64,
    pub(crate) period_ns: i64,
    pub(crate) delay_ns: i64,
    pub(crate) measured_n: Vec<f64>,
    pub(crate) without_drive: bool,
    pub(crate) constant_current: bool,
}

impl Harness {
    /// [`both`] models of the thesis.
    pub(crate) fn thesis() -> Self {
        Self::new(Settings::default())
    }

    pub(crate) fn new(settings: Settings) -> Self {
        Self::of(both(), settings)
    }

    pub(crate) fn of(models: Models, settings: Settings) -> Self {
        Self {
            pipeline: Pipeline::new(models, settings).expect("presets run"),
            events: Vec::new(),
            epoch_ns: 0,
            period_ns: PERIOD_NS,
            delay_ns: 0,
            measured_n: Vec::new(),
            without_drive: false,
            constant_current: false,
        }
    }

    /// Sets the measured force of the first `count` samples to the model's simulation (free run) plus `bias_n`, so that the model error is
    /// known exactly.
    pub(crate) fn measure_free_run_plus(&mut self, bias_n: f64, count: i64) {
        let mut other = Self::new(Settings { use_measured_force: UseForce::Never, ..Settings::default() });
        other.constant_current = self.constant_current;
        other.run(0..count, |_| false);
        self.measured_n = other
            .estimates()
            .map(|e| e.force.get())
            .map(|f| if f.is_finite() { f + bias_n } else { 0.0 })
            .collect();
    }

    /// The simulation (free run) over the samples that were fed, N.
    pub(crate) fn free_run_n(&self) -> Vec<f64> {
        let mut other = Self::new(Settings { use_measured_force: UseForce::Never, ..Settings::default() });
        other.constant_current = self.constant_current;
        other.run(0..self.estimates().count() as i64, |_| false);
        other.estimates().map(|e| e.force.get()).collect()
    }

    /// Feeds samples; `force` decides for each sample if it has a measured force.
    pub(crate) fn run(&mut self, range: Range<i64>, force: impl Fn(i64) -> bool) {
        for k in range {
            for mut sample in samples(k, 0) {
                match &mut sample.reading {
                    Reading::Force(_) if !force(k) => continue,
                    Reading::Drive(_) if self.without_drive => continue,
                    Reading::Drive(drive) if self.constant_current => {
                        *drive = Drive::CoilCurrent(Ampere(1.2))
                    }
                    Reading::Force(f) => f.0 = self.measured_n.get(k as usize).copied().unwrap_or(f.0),
                    _ => {}
                }
                sample.stamp = Stamp::from_nanos(self.epoch_ns + k * self.period_ns);
                sample.received = sample.stamp.shifted(self.delay_ns);
                self.feed(&sample);
            }
        }
    }

    pub(crate) fn feed_reading(&mut self, k: i64, reading: Reading) {
        let stamp = Stamp::from_nanos(self.epoch_ns + k * self.period_ns);
        self.feed(&Sample { stamp, received: stamp, reading });
    }

    /// Feeds a reading that arrives at sample `k` with a stamp `ahead_ns` nanoseconds later.
    pub(crate) fn feed_ahead(&mut self, k: i64, ahead_ns: i64, reading: Reading) {
        let received = Stamp::from_nanos(self.epoch_ns + k * self.period_ns);
        self.feed(&Sample { stamp: received.shifted(ahead_ns), received, reading });
    }

    fn feed(&mut self, sample: &Sample) {
        let events = &mut self.events;
        self.pipeline.step(sample, &mut |event| events.push(event));
    }

    /// Uses other models and settings from the next sample on; an error if they do not fit together.
    pub(crate) fn take(&mut self, models: Models, settings: Settings) -> Result<(), Error> {
        let setup = PipelineSetup::new(models, settings)?;
        let events = &mut self.events;
        self.pipeline.take(setup, &mut |event| events.push(event));
        Ok(())
    }

    pub(crate) fn tick(&mut self, ms: i64) {
        let events = &mut self.events;
        self.pipeline
            .tick(Stamp::from_nanos(self.epoch_ns + ms * 1_000_000), &mut |event| events.push(event));
    }

    pub(crate) fn estimates(&self) -> impl Iterator<Item = &Estimate> {
        self.events.iter().filter_map(|event| match event {
            Event::Estimate(estimate) => Some(estimate),
            _ => None,
        })
    }

    pub(crate) fn residuals(&self) -> impl Iterator<Item = &Residual> {
        self.events.iter().filter_map(|event| match event {
            Event::Residual(residual) => Some(residual),
            _ => None,
        })
    }

    /// Changes of mode, one per line.
    pub(crate) fn transitions(&self) -> String {
        let line = |event: &Event| match event {
            Event::Transition(t) => {
                let change = format!("{} -> {}", t.from.name(), t.to.name());
                let ms = (t.stamp.nanos() - self.epoch_ns) as f64 / 1e6;
                Some(format!("{ms:4.0} ms  {change:<18} {}", t.cause.text()))
            }
            _ => None,
        };
        self.events.iter().filter_map(line).collect::<Vec<_>>().join("\n")
    }

    /// Refused samples, one per line.
    pub(crate) fn refusals(&self) -> String {
        let line = |event: &Event| match event {
            Event::Refusal(refusal) => {
                let channel: Channel = refusal.sample.reading.channel();
                Some(format!("{}: {}", channel.name(), refusal.why.text()))
            }
            _ => None,
        };
        self.events.iter().filter_map(line).collect::<Vec<_>>().join("\n")
    }
}
