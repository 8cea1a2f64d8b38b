//! Identification of the LPV model on data with known truth.

use crate::identify_support::{Recipe, fed_run, run, truth};
use mr_damper_model::condition::{Conditioning, VelocitySource};
use mr_damper_model::evaluate::evaluate;
use mr_damper_model::force::{
    Dependence, ForceModel, FreeRun, FuzzySets, Inputs, LPV_REGRESSORS, Lpv, Membership,
};
use mr_damper_model::identify::{Form, Identified, ModelSpec, Options, Placement, Watch, identify};
use mr_damper_model::pipeline::Settings;
use mr_damper_model::sample::{DriveKind, Run};
use mr_damper_model::units::Second;

const KIND: DriveKind = DriveKind::CoilCurrent;
/// Half width of the noise that drives the truth.
const NOISE_N: f64 = 0.5;

fn options() -> Options {
    let conditioning = Conditioning { velocity: VelocitySource::Measured, ..Conditioning::default() };
    Options { conditioning, degree: 1, ..Options::default() }
}

fn identified(form: Form, runs: &[Run], options: &Options) -> Result<Identified, mr_damper_model::Error> {
    identify(ModelSpec::named("lpv", form)?, runs, options, &Watch::none())
}

fn lpv(found: &Identified) -> Lpv {
    match found.model.force {
        ForceModel::Lpv(lpv) => lpv,
        _ => panic!("asked for LPV"),
    }
}

fn sets() -> FuzzySets {
    FuzzySets::new(Membership { drive: KIND, sigma: 0.4 }, &[0.0, 1.0]).expect("sets")
}

/// Gain and poles grow with the drive: as a polynomial, or from the first fuzzy set to the second.
fn the_truth(form: Form) -> Lpv {
    let low = [1.1, -0.3, 0.05, 3000.0, -5000.0, 2600.0, 250.0, 120.0, -60.0];
    let high = [1.3, -0.5, 0.1, 6000.0, -9000.0, 4000.0, 600.0, 200.0, -90.0];
    let slope: [f64; LPV_REGRESSORS] = std::array::from_fn(|j| high[j] - low[j]);
    let (dependence, second) = match form {
        Form::Fuzzy => (Dependence::Fuzzy(sets()), high),
        _ => (Dependence::Polynomial { drive: KIND, degree: 1 }, slope),
    };
    Lpv::new(dependence, &[low, second].concat(), Second(1.0 / 500.0), 0.0).expect("a model")
}

/// A run with the force of `model`; see [`fed_run`].
fn made_by(model: &Lpv, noise_n: f64, recipe: Recipe) -> Run {
    fed_run(noise_n, recipe, KIND, |history| model.predict_n(history))
}

fn roaming(t: f64) -> f64 {
    0.5 + 0.5 * (3.1 * t).sin()
}

#[test]
fn coefficients_and_offsets_are_recovered() {
    for form in [Form::SemiActive, Form::Fuzzy] {
        let model = the_truth(form);
        let recipe = Recipe { drive: roaming, duration_s: 30.0, ..Recipe::default() };
        let runs = [
            made_by(&model, NOISE_N, Recipe { name: "a", offset_n: 60.0, seed: 1, ..recipe }),
            made_by(&model, NOISE_N, Recipe { name: "b", offset_n: -20.0, seed: 2, ..recipe }),
        ];
        let placement = match form {
            Form::Fuzzy => Placement::Given { centres: vec![0.0, 1.0], sigma: Some(0.4) },
            _ => Placement::FromRuns,
        };
        let found = identified(form, &runs, &Options { placement, ..options() }).expect("identifies");
        assert_eq!(found.rank, Some(2 * LPV_REGRESSORS));
        assert!(found.warnings.is_empty(), "{:?}", found.warnings);
        for drive in [0.1, 0.5, 0.9] {
            let frozen = |model: &Lpv| model.frozen(drive).expect("finite");
            let (a, b) = (frozen(&lpv(&found)), frozen(&model));
            for (a, b) in a.force_lags().iter().zip(b.force_lags()) {
                assert!((a - b).abs() < 0.06, "{form:?} {a} {b}");
            }
        }
        // Lags of displacement and velocity can compensate each other, so their joint effect is checked on a held-out run (its offset is
        // the mean of the other offsets).
        let fresh = made_by(&model, 0.0, Recipe { name: "c", offset_n: 20.0, seed: 3, ..recipe });
        let scored = evaluate(found.model, &fresh, Settings::default(), |_| true).expect("scores");
        assert!(scored.free_run.expect("a simulation error").esr < 2e-3, "{form:?} {:?}", scored.free_run);
        // White noise drives the truth; the one-step-ahead error can only be this noise.
        let noise_n = NOISE_N / 3.0_f64.sqrt();
        let one_step = found.one_step.expect("a one-step predictor").rsse_n;
        assert!(one_step <= noise_n * 1.01 && one_step > noise_n * 0.97, "{one_step}");
        assert!(found.persistence.expect("figures").rsse_n > one_step);
        for (run, offset_n) in found.runs.iter().zip([60.0, -20.0]) {
            assert!((run.force_offset_n - offset_n).abs() < 3.0, "{run:?}");
        }
    }
}

#[test]
fn at_constant_drive_it_equals_the_frozen_arx() {
    for form in [Form::SemiActive, Form::Fuzzy] {
        let model = the_truth(form).with_force_offset_n(33.0);
        let arx = ForceModel::Arx(model.frozen(0.7).expect("finite"));
        let (model, mut a, mut b) = (ForceModel::Lpv(model), FreeRun::default(), FreeRun::default());
        for k in 0..400 {
            let t = f64::from(k) * 0.002;
            let inputs = Inputs {
                dt_s: Some(0.002),
                displacement_m: 0.01 * (9.0 * t).sin(),
                velocity_m_s: 0.09 * (9.0 * t).cos(),
                acceleration_m_s2: f64::NAN,
                drive: 0.7,
                case_temp_c: f64::NAN,
            };
            match (model.free_run(&mut a, &inputs), arx.free_run(&mut b, &inputs)) {
                (Some(ours), Some(theirs)) => assert!((ours - theirs).abs() < 1e-9, "{k} {ours} {theirs}"),
                (None, None) => assert!(k < 4),
                other => panic!("only one of the two models has a force: {other:?}"),
            }
        }
    }
}

#[test]
fn runs_without_enough_information_are_rejected_or_give_a_warning() {
    let recipe = Recipe { drive: roaming, ..Recipe::default() };
    let made = |recipe| run(recipe, KIND, |x, v, i| truth(KIND).force_n(x, v, i));
    let error = |form, run: Run, options: &Options| {
        identified(form, &[run], options).expect_err("refused").to_string()
    };
    let held = error(Form::SemiActive, made(Recipe { drive: |_| 0.5, ..recipe }), &options());
    assert!(held.contains("current_a is 0.5 throughout"), "{held}");
    let blind = error(Form::SemiActive, Run { drive: None, ..made(recipe) }, &options());
    assert!(blind.contains("has no current_a or command_v"), "{blind}");
    let short = error(Form::SemiActive, made(Recipe { duration_s: 0.3, ..recipe }), &options());
    assert!(short.contains("too few for the 18 coefficients of lpv"), "{short}");
    let passive = ModelSpec::named("lpv", Form::Passive).expect_err("that is arx").to_string();
    assert!(passive.contains("no passive form"), "{passive}");
    // Two levels determine a straight line at most.
    let two = made(Recipe { drive: |t| if t < 4.0 { 0.2 } else { 0.9 }, ..recipe });
    let found =
        identified(Form::SemiActive, &[two], &Options { degree: 2, ..options() }).expect("identifies");
    assert_eq!(lpv(&found).dependence().copies(), 2);
    assert!(found.warnings[0].contains("2 levels of current_a"), "{:?}", found.warnings);
    // Poles outside the unit circle at one end of the drive range give a warning.
    let wild = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 300.0, 0.0, 0.0];
    let wilder = [0.02, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let dependence = Dependence::Polynomial { drive: KIND, degree: 1 };
    let unstable = Lpv::new(dependence, &[wild, wilder].concat(), Second(0.002), 0.0).expect("a model");
    let driven = made_by(&unstable, 1.0, Recipe { drive: |t| 0.1 * (3.0 * t).sin() - 0.02, ..recipe });
    let found = identified(Form::SemiActive, &[driven], &options()).expect("identifies");
    assert!(found.warnings.iter().any(|w| w.contains("simulation diverges")), "{:?}", found.warnings);
}
