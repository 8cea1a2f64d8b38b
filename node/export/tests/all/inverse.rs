//! The exported inverse controller against the service's, bit for bit.

use crate::back_to_back::assert_same;
use crate::cases::{Case, effects, forces, fuzzy_tanh, learned, terms, with};
use crate::compile::{compilers, parse, run_bytes, write};
use mr_damper_export::vectors::{
    Expected, ExpectedCommand, Readings, expected_commands, readings, with_requests,
};
use mr_damper_export::{CExport, CSource};
use mr_damper_model::effect::{Effect, EffectModel};
use mr_damper_model::inverse::{InverseController, Limits, Method};
use mr_damper_model::model::Model;
use mr_damper_model::pipeline::Settings;

/// Commands of a case: few in a quick run, or MR_DAMPER_EXPORT_SAMPLES.
fn count() -> usize {
    std::env::var("MR_DAMPER_EXPORT_SAMPLES").ok().and_then(|text| text.parse().ok()).unwrap_or(QUICK)
}

const QUICK: usize = 3_000;

fn is_quick() -> bool {
    count() <= QUICK
}

/// Fails at the first command that differs. Returns how many had a force, were limited by the range of the current, by its rate, by
/// passivity, and went to the safe current.
fn assert_commands(what: &str, all: &[Readings], service: &[ExpectedCommand], exported: &[u8]) -> [usize; 5] {
    let same = |a: f64, b: f64| a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan());
    let mut seen = [0; 5];
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
                let flags =
                    1 | (u32::from(command.is_achievable) << 1) | (u32::from(command.dissipative) << 2);
                seen[0] += usize::from(command.expected.is_finite());
                if let Some(kind) = [0, 1, 1, 2, 3, 4, 0].get(command.limited_by as usize) {
                    seen[*kind] += usize::from(*kind > 0);
                }
                theirs.iter().zip(&numbers).all(|(a, b)| same(*a, *b))
                    && flags == truths
                    && command.limited_by as u32 == limited_by
            }
        };
        let silent = ours.silent_a.is_none_or(|current_a| same(current_a, numbers[5]));
        assert!(
            fits && silent,
            "{what}, sample {k} ({:?}): service {ours:?}, exported {numbers:?}, limited by {limited_by}, {truths:03b}",
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
        let controller = InverseController::with_method(model, limits, method).ok()?;
        let parts = controller.parts().expect("not a learned inverse");
        let settings = Settings { limits, method, ..Settings::default() };
        let all = with_requests(readings(model, count, seed), parts.most_n, seed);
        let both = expected_commands(model, &settings, &all).expect("a pipeline");
        let (estimates, commands): (Vec<_>, Vec<_>) = both.into_iter().unzip();
        let source = CExport::new("damper", model).inverse(&parts).source().expect("it is exported");
        Some(Self { source, all, estimates, commands })
    }

    /// Compares what the exported code wrote; see [`assert_commands`].
    pub(crate) fn compare(&self, what: &str, found: &[u8]) -> [usize; 5] {
        let exported: Vec<_> = found.chunks_exact(80).map(parse).collect();
        assert_same(what, &self.all, &self.estimates, &exported);
        assert_commands(what, &self.all, &self.commands, found)
    }
}

/// Compares the inverse of `model` by `method` within `limits` on each compiler, at two levels of optimisation.
fn check(name: &str, model: &Model, method: Method, limits: Limits, seed: u64) -> Option<[usize; 5]> {
    let own = Prepared::of(model, method, limits, count(), seed)?;
    let dir = tempfile::tempdir().expect("a directory");
    write(dir.path(), &own.source);
    let mut seen = [0; 5];
    // A quick run takes one compiler for each case, in turn.
    let pairs: Vec<_> = compilers().into_iter().zip(["-O3", "-O0"]).collect();
    let pairs = if is_quick() { &pairs[seed as usize % pairs.len()..][..1] } else { &pairs };
    for (compiler, level) in pairs {
        let what = format!("{name}, {}, {compiler} {level}", method.name());
        seen = own.compare(&what, &run_bytes(dir.path(), &own.source, compiler, level, &own.all));
    }
    assert!(seen[0] > count() / 3, "{name}: only {} of {} commands have a force", seen[0], count());
    Some(seen)
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
    let mut seen = [0; 5];
    for (index, (name, model)) in effects().iter().enumerate() {
        let limits = if index % 2 == 0 { TIGHT } else { Limits::default() };
        let own = check(name, model, Method::Search, limits, 300 + index as u64);
        seen = std::array::from_fn(|k| seen[k] + own.map_or(0, |own| own[k]));
    }
    // The search, the limits and the safe current were all at work.
    assert!(seen.iter().all(|count| *count > 300), "{seen:?}");
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
