//! The exported inverse controller against the service's, bit for bit.

use crate::back_to_back::{assert_same, is_quick, samples};
use crate::cases::{Case, effects, forces, fuzzy_tanh, learned, terms, with};
use crate::compile::{compilers, parse, run_bytes, write};
use mr_damper_export::vectors::{
    Expected, ExpectedCommand, Readings, expected_commands, readings, with_late_stamps, with_requests,
};
use mr_damper_export::{CExport, CSource};
use mr_damper_model::condition::{ApplyTo, Conditioning, VelocitySource};
use mr_damper_model::effect::{Effect, EffectModel};
use mr_damper_model::force::Normalisation;
use mr_damper_model::inverse::{
    CurrentCommand, FuzzyAxis, InverseController, InverseFuzzy, InverseModel, InverseNetwork, InverseScaling,
    LimitedBy, Limits, Method,
};
use mr_damper_model::model::Model;
use mr_damper_model::pipeline::Settings;
use mr_damper_model::units::Second;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Commands of a case.
fn count() -> usize {
    samples(3_000)
}

/// Numbers of commands.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Seen {
    /// With a force.
    pub(crate) forces: usize,
    /// Limited by the range of the current.
    range: usize,
    /// Limited by the rate of the current.
    rate: usize,
    /// Limited by passivity.
    passivity: usize,
    /// Towards the safe current.
    safe: usize,
    /// That the method gave, as the demand was within the damper's range.
    pub(crate) learned: usize,
    /// That the search gave in the place of a learned inverse.
    substituted: usize,
}

impl Seen {
    fn add(&mut self, command: &CurrentCommand) {
        self.forces += usize::from(command.expected.is_finite());
        match command.limited_by {
            LimitedBy::CurrentMax | LimitedBy::CurrentMin => self.range += 1,
            LimitedBy::Rate => self.rate += 1,
            LimitedBy::Passivity => self.passivity += 1,
            LimitedBy::Safe => self.safe += 1,
            LimitedBy::None | LimitedBy::NoInverse => {}
        }
        let [least, most] = command.achievable.map(|force| force.get());
        let is_inside = least < command.requested.get() && command.requested.get() < most;
        let is_free = command.limited_by == LimitedBy::None;
        self.learned += usize::from(is_inside && is_free && !command.substituted);
        self.substituted += usize::from(command.substituted);
    }

    /// The commands of both.
    fn and(self, other: Self) -> Self {
        Self {
            forces: self.forces + other.forces,
            range: self.range + other.range,
            rate: self.rate + other.rate,
            passivity: self.passivity + other.passivity,
            safe: self.safe + other.safe,
            learned: self.learned + other.learned,
            substituted: self.substituted + other.substituted,
        }
    }
}

/// Fails at the first command that differs. Returns what was seen.
fn assert_commands(what: &str, all: &[Readings], service: &[ExpectedCommand], exported: &[u8]) -> Seen {
    let same = |a: f64, b: f64| a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan());
    let mut seen = Seen::default();
    for (k, (ours, bytes)) in service.iter().zip(exported.chunks_exact(80)).enumerate() {
        let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes"));
        let number = |at: usize| f64::from_le_bytes(bytes[at..at + 8].try_into().expect("eight bytes"));
        let (limited_by, truths) = (word(24), word(28));
        let numbers: Vec<f64> = (0..6).map(|n| number(32 + 8 * n)).collect();
        let fits = match &ours.command {
            None => truths & 1 == 0,
            Some(command) => {
                let [low, high] = command.achievable.map(|force| force.get());
                let theirs =
                    [command.current.get(), command.requested.get(), command.expected.get(), low, high];
                let flags = 1
                    | (u32::from(command.is_achievable) << 1)
                    | (u32::from(command.dissipative) << 2)
                    | (u32::from(command.substituted) << 3);
                seen.add(command);
                theirs.iter().zip(&numbers).all(|(a, b)| same(*a, *b))
                    && flags == truths
                    && command.limited_by as u32 == limited_by
            }
        };
        let silent = ours.silent_a.is_none_or(|current_a| same(current_a, numbers[5]));
        assert!(
            fits && silent,
            "{what}, sample {k} ({:?}): service {ours:?}, exported {numbers:?}, limited by {limited_by}, {truths:04b}",
            all[k]
        );
    }
    seen
}

/// An export with its inverse, readings, and the service's results for them.
pub(crate) struct Prepared {
    pub(crate) source: CSource,
    pub(crate) all: Vec<Readings>,
    estimates: Vec<Expected>,
    commands: Vec<ExpectedCommand>,
}

impl Prepared {
    /// `None` for a model without an inverse by `method`.
    pub(crate) fn of(model: &Model, method: Method, limits: Limits, count: usize, seed: u64) -> Option<Self> {
        let export = CExport::new("damper", model);
        Self::on(readings(model, count, seed), &export, model, method, limits, seed)
    }

    /// The same for these readings, to which it adds requests, and for an export of `model` without an inverse, to which it adds one.
    fn on(
        all: Vec<Readings>,
        export: &CExport<'_>,
        model: &Model,
        method: Method,
        limits: Limits,
        seed: u64,
    ) -> Option<Self> {
        let controller = InverseController::with_method(model, limits, method).ok()?;
        let parts = controller.parts().expect("it has an inverse");
        let settings = Settings { limits, method, ..Settings::default() };
        let all = with_requests(all, parts.most_n, seed);
        let both = expected_commands(model, &settings, &all).expect("a pipeline");
        let (estimates, commands): (Vec<_>, Vec<_>) = both.into_iter().unzip();
        let source = export.clone().inverse(&parts).source().expect("it is exported");
        Some(Self { source, all, estimates, commands })
    }

    /// Compares what the exported code wrote; see [`assert_commands`].
    pub(crate) fn compare(&self, what: &str, found: &[u8]) -> Seen {
        let exported: Vec<_> = found.chunks_exact(80).map(parse).collect();
        assert_same(what, &self.all, &self.estimates, &exported);
        assert_commands(what, &self.all, &self.commands, found)
    }
}

/// Compares the inverse of `model` by `method` within `limits` on each compiler, at two levels of optimisation.
fn check(name: &str, model: &Model, method: Method, limits: Limits, seed: u64) -> Option<Seen> {
    let own = Prepared::of(model, method, limits, count(), seed)?;
    Some(compare(&format!("{name}, {}", method.name()), &own, seed))
}

/// Compares a prepared export.
fn compare(name: &str, own: &Prepared, seed: u64) -> Seen {
    let dir = tempfile::tempdir().expect("a directory");
    write(dir.path(), &own.source);
    let mut seen = Seen::default();
    // A quick run takes one compiler for each case, in turn.
    let pairs: Vec<_> = compilers().into_iter().zip(["-O3", "-O0"]).collect();
    let pairs = if is_quick() { &pairs[seed as usize % pairs.len()..][..1] } else { &pairs };
    for (compiler, level) in pairs {
        let what = format!("{name}, {compiler} {level}");
        seen = own.compare(&what, &run_bytes(dir.path(), &own.source, compiler, level, &own.all));
    }
    assert!(seen.forces > count() / 3, "{name}: only {} of {} commands have a force", seen.forces, count());
    seen
}

pub(crate) const TIGHT: Limits = Limits {
    current_max_a: 1.6,
    rate_max_a_s: 40.0,
    safe_a: 0.3,
    safe_after_s: 0.05,
    hold_m_s: 4e-3,
    lead_s: 3e-3,
    feedback_s: 15e-3,
    feedback_gain: 1.2,
};

#[test]
fn every_effect_has_the_services_commands() {
    let mut seen = Seen::default();
    for (index, (name, model)) in effects().iter().enumerate() {
        let limits = if index % 2 == 0 { TIGHT } else { Limits::default() };
        let own = check(name, model, Method::Search, limits, 300 + index as u64);
        seen = own.map_or(seen, |own| seen.and(own));
    }
    // The search, the limits and the safe current were all at work.
    let Seen { forces, range, rate, passivity, safe, substituted, .. } = seen;
    assert!([forces, range, rate, passivity, safe].iter().all(|count| *count > 300), "{seen:?}");
    assert_eq!(substituted, 0, "only learned inverses are substituted");
}

#[test]
fn every_force_model_has_the_services_commands() {
    let all: Vec<Case> = [forces(), learned()].concat();
    let mut inverted = 0;
    for (index, (name, model)) in all.iter().enumerate() {
        let own = check(name, model, Method::Search, TIGHT, 400 + index as u64);
        inverted += usize::from(own.is_some());
    }
    // A model without a current has no inverse.
    assert!(inverted > all.len() / 3, "{inverted} of {}", all.len());
}

#[test]
fn terms_have_the_services_commands() {
    let lag = Effect::CoilLag.example();
    for (index, (name, model)) in terms().iter().enumerate().step_by(5) {
        let list: Vec<EffectModel> =
            [lag].into_iter().chain(model.effects.of_damper().as_slice().iter().copied()).collect();
        let effects = mr_damper_model::effect::Effects::new(&list).expect("they fit");
        let both = Model { effects: effects.with_terms(*model.effects.terms()), ..*model };
        assert!(check(name, &both, Method::Search, TIGHT, 500 + index as u64).is_some(), "{name}");
    }
}

#[test]
fn surrogates_have_the_services_commands() {
    let lists: [&[Effect]; 4] = [
        &[],
        &[Effect::GasSpring, Effect::Friction],
        &[Effect::CoilLag, Effect::GasSpring],
        &[Effect::CoilLagRiseFall],
    ];
    let mut compared = 0;
    for method in [Method::Polynomial, Method::Fuzzy] {
        for (index, list) in lists.iter().enumerate() {
            let list: Vec<EffectModel> = list.iter().map(|effect| effect.example()).collect();
            let name = format!("fuzzy-tanh with {} effects", list.len());
            let own = check(&name, &with(fuzzy_tanh(), &list), method, TIGHT, 600 + index as u64);
            assert!(own.is_some(), "{name}");
        }
        for (index, (name, model)) in forces().iter().enumerate() {
            let model = with(*model, &[Effect::GasSpring.example()]);
            let own = check(name, &model, method, Limits::default(), 700 + index as u64);
            compared += usize::from(own.is_some());
        }
    }
    assert!(compared > 10, "{compared} models have a surrogate");
}

/// `model` with a learned inverse for `method`, which holds at `period_s` if it is a network; unchanged for another method. Its weights are
/// drawn, and scaled so that most currents lie between 0 and 2 A.
pub(crate) fn with_learned(model: Model, method: Method, period_s: f64) -> Model {
    let Some(kind) = method.learned() else { return model };
    let mut random = Pcg64Mcg::seed_from_u64(method as u64);
    let mut draw = |most: f64| most * (2.0 * random.random::<f64>() - 1.0);
    let inverse = if let Some(structure) = kind.network() {
        let of = |mean, deviation| Normalisation { mean, deviation };
        let scaling = InverseScaling {
            displacement_m: of(1e-3, 0.01),
            velocity_m_s: of(-0.02, 0.15),
            force_n: of(20.0, 600.0),
            current_a: of(0.9, 0.6),
        };
        let (hidden, inputs) = (structure.hidden() as f64, structure.inputs(true) as f64);
        let count = structure.weights(true);
        let of_output = count - 1 - structure.hidden()..count;
        let most = |k: usize| if of_output.contains(&k) { 2.0 / hidden.sqrt() } else { 2.0 / inputs.sqrt() };
        let weights: Vec<f64> = (0..count).map(|k| draw(most(k))).collect();
        let network = InverseNetwork::new(structure, scaling, &weights, Second(period_s));
        InverseModel::Network(network.expect("a network"))
    } else {
        let mut axis = |mean, std_dev| FuzzyAxis {
            mean,
            std_dev,
            centres: [-1.0, 0.0, 1.0].map(|centre| centre + draw(0.2)),
            sigmas: [0.6; 3].map(|sigma| sigma + draw(0.2)),
        };
        let axes = [axis(-0.02, 0.15), axis(0.1, 8.0), axis(20.0, 600.0)];
        let conclusions = std::array::from_fn(|_| [0.3, 0.1, 0.3, 1.0].map(&mut draw));
        InverseModel::Fuzzy(InverseFuzzy::new(axes, &conclusions, 0.9, 0.6).expect("rules"))
    };
    Model { inverse: Some(inverse), rate_hz: 1.0 / period_s, ..model }
}

/// `all` with a gap of 0.15 s after every 25 samples, after which a learned inverse does not know the past samples.
fn with_gaps(mut all: Vec<Readings>) -> Vec<Readings> {
    for (index, reading) in all.iter_mut().enumerate() {
        reading.time_ns += (index / 25) as i64 * 150_000_000;
    }
    all
}

const LEARNED: [Method; 3] = [Method::Chen, Method::WangLiao, Method::WangHu];

#[test]
fn learned_inverses_have_the_services_commands() {
    use Effect::{CoilLag, CoilLagRiseFall, GasSpring, LoadCellDrift, SensorDelay, SeriesSpring};
    let lists: [&[Effect]; 6] = [
        &[],
        &[CoilLag],
        &[GasSpring],
        &[CoilLagRiseFall, GasSpring, LoadCellDrift],
        &[SeriesSpring, SensorDelay],
        &[CoilLag, SeriesSpring, GasSpring],
    ];
    for (kind, method) in LEARNED.into_iter().enumerate() {
        let mut all = Seen::default();
        for (index, list) in lists.iter().enumerate() {
            let list: Vec<EffectModel> = list.iter().map(|effect| effect.example()).collect();
            let titles: Vec<String> = list.iter().map(|effect| effect.effect().title()).collect();
            let name = format!("fuzzy-tanh with [{}]", titles.join(", "));
            let period_s = [1e-3, 1.0 / 512.0, 2e-3][(index + kind) % 3];
            // Without a filter the velocity is known soon after a gap.
            let apply_to = if index % 2 == 0 { ApplyTo::None } else { fuzzy_tanh().conditioning.apply_to };
            let conditioning =
                Conditioning { apply_to, velocity: VelocitySource::Backward, ..fuzzy_tanh().conditioning };
            let model = Model { conditioning, ..with(fuzzy_tanh(), &list) };
            let model = with_learned(model, method, period_s);
            let limits = if index / 2 % 2 == 0 { TIGHT } else { Limits::default() };
            let seed = 800 + (3 * index + kind) as u64;
            let export = CExport::new("damper", &model);
            let own = Prepared::on(
                with_gaps(readings(&model, count(), seed)),
                &export,
                &model,
                method,
                limits,
                seed,
            );
            let name = format!("{name}, {}", method.name());
            let own = own.unwrap_or_else(|| panic!("{name}: no inverse"));
            let seen = compare(&name, &own, seed);
            all = all.and(seen);
        }
        println!("{}: {all:?}", method.name());
        let Seen { range, safe, learned, substituted, .. } = all;
        assert!([range, safe, learned, substituted].iter().all(|count| *count > 100), "{all:?}");
    }
}

#[test]
fn learned_inverses_of_other_force_models_have_the_services_commands() {
    let (mut compared, mut folded, mut linear) = (0, 0, 0);
    for (index, (name, model)) in forces().iter().enumerate() {
        let method = LEARNED[index % 3];
        let model = with_learned(with(*model, &[Effect::GasSpring.example()]), method, 1e-3);
        let Ok(controller) = InverseController::with_method(&model, TIGHT, method) else { continue };
        let parts = controller.parts().expect("it has an inverse");
        (folded, linear) = (folded + usize::from(parts.folded), linear + usize::from(parts.linear));
        let seen = check(name, &model, method, TIGHT, 900 + index as u64);
        compared += usize::from(seen.is_some_and(|seen| seen.learned > 0));
    }
    assert!(compared > 10 && folded > 0 && linear > 0, "{compared} models, {folded} folded, {linear} linear");
}

/// A network holds within a quarter of its sample period.
#[test]
fn a_learned_network_follows_a_rate_within_a_quarter_of_its_own() {
    for (method, share, follows) in [
        (Method::Chen, 1.3, true),
        (Method::WangLiao, 0.82, true),
        (Method::Chen, 1.4, false),
        (Method::WangLiao, 0.75, false),
    ] {
        let model = with_learned(fuzzy_tanh(), method, 1e-3);
        let all = readings(&model, count(), 950);
        let other = with_learned(fuzzy_tanh(), method, share * 1e-3);
        let export = CExport::new("damper", &other);
        let own = Prepared::on(all, &export, &other, method, TIGHT, 950).expect("an inverse");
        let seen = compare(&format!("{} at {share} of its rate", method.name()), &own, 950);
        if follows {
            assert!(seen.learned > 100, "{share}: {seen:?}");
        } else {
            assert!(seen.learned == 0 && seen.substituted > 100, "{share}: {seen:?}");
        }
    }
}

#[test]
fn commands_on_corrected_stamps_are_the_services() {
    for (index, method) in Method::ALL.into_iter().enumerate() {
        let seed = 960 + index as u64;
        let model = with_learned(with(fuzzy_tanh(), &[Effect::CoilLag.example()]), method, 1e-3);
        let all = with_late_stamps(readings(&model, count(), seed), seed);
        let export = CExport::new("damper", &model).corrected_stamps();
        let own = Prepared::on(all, &export, &model, method, TIGHT, seed).expect("an inverse");
        compare(&format!("{} on corrected stamps", method.name()), &own, seed);
    }
}
