//! Fuzzy sets with identified centres and widths, on data with known truth.

use crate::identify_support::{Recipe, run, tanh_function};
use mr_damper_model::condition::{Conditioning, VelocitySource};
use mr_damper_model::force::{Dependence, ForceModel, FuzzySets, FuzzyTanh};
use mr_damper_model::identify::{
    Form, Identified, MembershipSource, ModelSpec, Options, Placement, Watch, identify,
};
use mr_damper_model::sample::{DriveKind, Run};

const KIND: DriveKind = DriveKind::CoilCurrent;
const CENTRES: [f64; 3] = [0.2, 0.9, 2.3];
const SIGMAS: [f64; 3] = [0.2, 0.3, 0.5];

/// Three sets with different widths and unevenly spaced centres.
fn truth() -> FuzzyTanh {
    let functions = [
        tanh_function(90.0, 500.0, 60.0, -0.6),
        tanh_function(500.0, 900.0, 40.0, -1.2),
        tanh_function(900.0, 1500.0, 30.0, 0.8),
    ];
    let sets = FuzzySets::with_widths(KIND, &CENTRES, &SIGMAS).expect("sets");
    FuzzyTanh::new(sets, &functions, 0.0).expect("a model")
}

fn roaming(t: f64) -> f64 {
    1.25 + 1.25 * (1.7 * t).sin()
}

fn runs(noise_n: f64) -> [Run; 2] {
    let recipe = Recipe { drive: roaming, duration_s: 20.0, noise_n, ..Recipe::default() };
    let made = |recipe| run(recipe, KIND, |x, v, i| truth().force_n(x, v, i));
    [
        made(Recipe { name: "a", seed: 1, offset_n: 30.0, ..recipe }),
        made(Recipe { name: "b", seed: 2, ..recipe }),
    ]
}

fn options(sets: usize) -> Options {
    let conditioning = Conditioning { velocity: VelocitySource::Measured, ..Conditioning::default() };
    Options {
        conditioning,
        choose_velocity: false,
        placement: Placement::Even(sets),
        restarts: 8,
        ..Options::default()
    }
}

fn found(
    model: &str,
    form: Form,
    runs: &[Run],
    options: &Options,
) -> Result<Identified, mr_damper_model::Error> {
    identify(ModelSpec::named(model, form)?, runs, options, &Watch::none())
}

#[test]
fn centres_and_widths_are_recovered() {
    let runs = runs(5.0);
    let fixed = found("fuzzy-tanh", Form::SemiActive, &runs, &options(3)).expect("identifies");
    let free = found("fuzzy-tanh", Form::FreeFuzzy, &runs, &options(3)).expect("identifies");
    let esr = |found: &Identified| found.free_run.expect("a simulation error").esr;
    assert!(esr(&free) < 0.1 * esr(&fixed), "{} {}", esr(&free), esr(&fixed));
    // Only the noise remains.
    let noise_n = 5.0 / 3.0_f64.sqrt();
    let rsse_n = free.free_run.expect("a simulation error").rsse_n;
    assert!((rsse_n / noise_n - 1.0).abs() < 0.02, "{rsse_n}");
    let memberships = free.memberships.as_ref().expect("sets");
    assert_eq!(memberships.source, MembershipSource::Identified);
    for (j, (centre, sigma)) in memberships.sets.centres().iter().zip(memberships.sets.sigmas()).enumerate() {
        assert!((centre - CENTRES[j]).abs() < 0.05, "{:?}", memberships.sets);
        assert!((sigma / SIGMAS[j] - 1.0).abs() < 0.12, "{:?}", memberships.sets);
    }
    let ForceModel::FuzzyTanh(model) = free.model.force else { panic!("asked for it") };
    assert_eq!(model.sets(), &memberships.sets);
    // Standard errors are listed by the names of the model file, and cover the truth.
    let parameter = |name: &str| free.parameters.iter().find(|p| p.name == name).expect("a known name");
    let centre = parameter("membership_centres_a[1]");
    assert!(
        centre.standard_error > 0.0 && (centre.value - 0.9).abs() < 5.0 * centre.standard_error,
        "{centre:?}"
    );
    assert!(parameter("membership_sigma_a[2]").standard_error > 0.0);
    assert_eq!(free.parameters.len(), 3 * 4 + 6);
}

#[test]
fn every_law_can_have_free_sets() {
    let runs = runs(0.0);
    for law in ["arctan", "kwok"] {
        let esr =
            |form| found(law, form, &runs, &options(3)).expect("identifies").free_run.expect("an error").esr;
        let (fixed, free) = (esr(Form::Fuzzy), esr(Form::FreeFuzzy));
        assert!(free < 0.5 * fixed, "{law}: {free} {fixed}");
    }
    let free = found("arctan", Form::FreeFuzzy, &runs, &options(3)).expect("identifies");
    let ForceModel::Law(model) = free.model.force else { panic!("asked for a law") };
    let Dependence::Fuzzy(sets) = model.dependence() else { panic!("with sets") };
    assert_eq!(Some(sets), free.memberships.as_ref().map(|m| &m.sets));
}

#[test]
fn sets_that_the_runs_do_not_determine_are_rejected() {
    let level = |drive| {
        let recipe = Recipe { drive, ..Recipe::default() };
        [run(recipe, KIND, |x, v, i| truth().force_n(x, v, i))]
    };
    let error = |runs: &[Run], options: &Options| {
        found("fuzzy-tanh", Form::FreeFuzzy, runs, options).expect_err("refused").to_string()
    };
    let from_runs = Options { placement: Placement::FromRuns, ..options(3) };
    let steps = level(|t| [0.0, 1.0, 2.0][(t / 0.5) as usize % 3]);
    let text = error(&steps, &from_runs);
    assert!(
        text.contains("3 levels of current_a, so 3 sets cannot be placed, which need more than 3 levels"),
        "{text}"
    );
    let text = error(&level(|_| 0.5), &from_runs);
    assert!(text.contains("one set over current_a"), "{text}");
    // Fewer sets than levels can be placed.
    let two = found("fuzzy-tanh", Form::FreeFuzzy, &steps, &options(2)).expect("identifies");
    assert_eq!(two.memberships.expect("sets").sets.len(), 2);
    let text = error(&runs(0.0), &options(17));
    assert!(text.contains("sets has 17 values") || text.contains("2 to 16"), "{text}");
    // A request to place sets for a model without sets is rejected, not ignored.
    let text = found("arx", Form::SemiActive, &runs(0.0), &options(3)).expect_err("refused").to_string();
    assert!(text.contains("arx (semi_active) has no fuzzy sets"), "{text}");
}
