//! Tests of the design: the limits of any run, the refusals, and all effects of the library.

use super::plan::{course, peaks};
use super::segment::{candidates, shuffle};
use super::*;
use crate::effect::{Effect, EffectModel, Effects};
use crate::error::DiagnosisError;
use crate::preset;
use crate::rig::signal::RATE_HZ;
use proptest::prelude::*;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;

/// Settings of a quick design.
const QUICK: Settings = Settings { noise_n: Some(3.0), candidates: 30, seed: 0 };
const LIMITS: Limits = Limits {
    stroke_m: 0.02,
    speed_m_s: 0.4,
    acceleration_m_s2: 10.0,
    drive: Some([0.0, 2.0]),
    duration_s: 6.0,
    rate_hz: 256.0,
};

fn fuzzy() -> Model {
    preset::load(preset::BEST_FUZZY_TANH).expect("a preset")
}

fn ask(text: &str) -> Question {
    Question::parse(text).expect("known effects")
}

fn quick(model: &Model, question: &str, limits: &Limits) -> Result<Design, Error> {
    design(model, &ask(question), limits, &QUICK, &Watch::none())
}

fn refusal(model: &Model, question: &str, limits: &Limits) -> String {
    quick(model, question, limits).expect_err("refused").to_string()
}

proptest! {
    #[test]
    fn no_run_exceeds_a_limit_and_each_begins_and_ends_at_rest(
        stroke_m in 1e-4..0.2_f64,
        speed_m_s in 1e-3..3.0_f64,
        acceleration_m_s2 in 1e-2..200.0_f64,
        low in -2.0..1.0_f64,
        above in 0.1..3.0_f64,
        duration_s in 2.0..40.0_f64,
        rate_hz in 50.0..1000.0_f64,
        parts in 1_usize..4,
        seed in any::<u64>(),
    ) {
        let drive = Some([low, low + above]);
        let limits = Limits { stroke_m, speed_m_s, acceleration_m_s2, drive, duration_s, rate_hz };
        limits.check().expect("limits in range");
        let mut plan = candidates(&limits, 1.5, 60, seed);
        shuffle(&mut plan, &mut Pcg64Mcg::seed_from_u64(seed));
        plan.truncate(8);
        let run = course(&plan, (1.5 * rate_hz) as usize, parts, &limits);
        prop_assert_eq!(run.displacement_m.len(), limits.samples());
        prop_assert_eq!(run.drive.len(), limits.samples());
        let [most, fastest, sharpest] = peaks(&run.displacement_m, rate_hz);
        prop_assert!(most <= stroke_m, "{} m", most);
        prop_assert!(fastest <= speed_m_s, "{} m/s", fastest);
        prop_assert!(sharpest <= acceleration_m_s2, "{} m/s²", sharpest);
        prop_assert!(run.drive.iter().all(|drive| (low..=low + above).contains(drive)));
        let last = run.displacement_m.len() - 1;
        let rest = [0, 1, last - 1, last].map(|k| run.displacement_m[k]);
        prop_assert!(rest.iter().all(|x| x.abs() < 1e-15), "{:?}", rest);
    }
}

#[test]
fn a_road_keeps_the_limits() {
    for limits in [LIMITS, Limits { speed_m_s: 0.01, ..LIMITS }, Limits { stroke_m: 1e-4, ..LIMITS }] {
        let [most, fastest, sharpest] = peaks(&road::course(&limits, 3).displacement_m, RATE_HZ);
        assert!(most <= limits.stroke_m * 1.000_001 && fastest <= limits.speed_m_s * 1.000_001);
        assert!(sharpest <= limits.acceleration_m_s2 * 1.000_001);
    }
}

#[test]
fn a_designed_run_separates_a_mass_from_a_spring_better_than_a_road_or_well_enough() {
    let found = quick(&fuzzy(), "inertia|gas_spring", &LIMITS).expect("they can be separated");
    assert_eq!(found.pairs.len(), 2);
    let least = found.least().expect("two pairs");
    assert!(least.is_checked && least.designed.is_enough(), "{least:?}");
    // The search has few candidates here.
    let most = least.road.discrimination.min(6.0);
    assert!(least.designed.discrimination >= most, "{least:?}");
    let again = quick(&fuzzy(), "inertia|gas_spring", &LIMITS).expect("as before");
    assert_eq!(found, again, "the seed decides");
}

#[test]
fn every_effect_of_the_library_gives_a_run_or_a_refusal_that_names_it() {
    let ids = Effect::ids();
    for (k, id) in ids.iter().enumerate() {
        for question in [format!("{id}|{}", ids[(k + 1) % ids.len()]), (*id).to_owned()] {
            match quick(&fuzzy(), &question, &Limits { duration_s: 3.0, ..LIMITS }) {
                Ok(found) => {
                    assert!(found.pairs.iter().any(|pair| pair.designed.is_enough()), "{question}");
                    assert!(
                        found.pairs.iter().all(|pair| pair.designed.distance_n.is_finite()),
                        "{question}"
                    );
                }
                Err(Error::Design(DesignError::NotSeparable { truth, .. })) => {
                    assert!(question.contains(truth), "{question}: {truth}");
                }
                Err(error) => panic!("{question}: {error}"),
            }
        }
    }
}

#[test]
fn an_effect_that_the_model_has_is_taken_out_and_its_size_is_known() {
    let mut model = fuzzy();
    let friction = EffectModel::new(Effect::Friction, &[80.0]).expect("a size in range");
    model.effects = Effects::new(&[friction]).expect("one effect");
    let found = quick(&model, "friction|gas_spring", &LIMITS).expect("they can be separated");
    for pair in &found.pairs {
        assert_eq!(pair.size_is_known, pair.truth.effect() == Effect::Friction);
        assert!(!pair.size_is_known || pair.truth == friction);
    }
}

#[test]
fn what_cannot_be_designed_is_refused_with_the_reason() {
    let model = fuzzy();
    let passive = preset::load("thesis/arx-passive/rp-icps").expect("a preset");
    let without = Limits { drive: None, ..LIMITS };
    let said = refusal(&passive, "friction|gas_spring", &without);
    assert!(said.contains("no run can be designed for the arx model"), "{said}");
    let said = refusal(&passive, "friction", &LIMITS);
    assert!(said.contains("has no drive, but limits of a drive were given"), "{said}");
    let said = refusal(&model, "friction", &without);
    assert!(said.contains("no limits of it were given"), "{said}");
    let said = refusal(&model, "friction", &Limits { stroke_m: 0.0, ..LIMITS });
    assert!(said.starts_with("stroke_m is 0, but must be"), "{said}");
    let said = refusal(&model, "friction", &Limits { duration_s: 1.0, ..LIMITS });
    assert!(said.starts_with("duration_s is 1, but must be 2 to 600 s"), "{said}");
    let said = refusal(&model, "friction", &Limits { drive: Some([2.0, 0.0]), ..LIMITS });
    assert!(said.contains("larger than the smallest drive"), "{said}");
    let error = Question::parse("friction|stiction").expect_err("not in the library");
    assert!(matches!(error, Error::Diagnosis(DiagnosisError::UnknownEffect { .. })));
    assert!(matches!(Question::parse(" , "), Err(Error::Design(DesignError::NoRival { .. }))));
}

#[test]
fn two_effects_that_the_noise_hides_are_refused_with_the_limit_that_helps() {
    let loud = Settings { noise_n: Some(100.0), ..QUICK };
    let slow = Limits { speed_m_s: 0.01, acceleration_m_s2: 0.5, ..LIMITS };
    let error =
        design(&fuzzy(), &ask("inertia|gas_spring"), &slow, &loud, &Watch::none()).expect_err("refused");
    let said = error.to_string();
    assert!(said.starts_with("no run of 6 s within these limits separates"), "{said}");
    assert!(said.contains("are needed at a noise of 100.00 N (as given)"), "{said}");
}

#[test]
fn extreme_limits_give_a_run_or_a_refusal() {
    let narrow = Limits { stroke_m: 1e-6, speed_m_s: 1e-6, acceleration_m_s2: 1e-6, ..LIMITS };
    let wide = Limits { stroke_m: 10.0, speed_m_s: 100.0, acceleration_m_s2: 1e5, ..LIMITS };
    let still = Limits { acceleration_m_s2: 1e-6, speed_m_s: 100.0, ..LIMITS };
    for limits in [narrow, wide, still, Limits { duration_s: 2.0, ..LIMITS }] {
        if let Err(error) = quick(&fuzzy(), "friction|gas_spring", &limits) {
            assert!(matches!(error, Error::Design(_) | Error::Identify(_)), "{error}");
        }
    }
}

#[test]
fn a_raised_flag_cancels_the_work() {
    let cancel = std::sync::atomic::AtomicBool::new(true);
    let watch = Watch { cancel: Some(&cancel), progress: None };
    assert_eq!(design(&fuzzy(), &ask("friction|inertia"), &LIMITS, &QUICK, &watch), Err(Error::Cancelled));
}
