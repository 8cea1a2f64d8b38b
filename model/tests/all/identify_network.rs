//! Identification of the black-box models `wang-liao`, `narx`, `chen` and `boada`.

use crate::identify_support::{Recipe, run, truth};
use mr_damper_model::condition::{Conditioning, VelocitySource};
use mr_damper_model::error::Error;
use mr_damper_model::force::{
    ForceModel, FreeRun, Inputs, Network, NetworkScaling, NetworkStructure, Normalisation,
};
use mr_damper_model::identify::{Form, Identified, ModelSpec, Options, Progress, Watch, identify};
use mr_damper_model::sample::{DriveKind, Run};
use mr_damper_model::units::Second;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::sync::Mutex;
use std::sync::atomic::AtomicBool;

const KIND: DriveKind = DriveKind::CoilCurrent;

fn steps(t: f64) -> f64 {
    [0.0, 1.0, 0.4, 0.8, 0.2][(t / 0.25) as usize % 5]
}

fn recipe() -> Recipe<'static> {
    Recipe { drive: steps, duration_s: 8.0, noise_n: 3.0, ..Recipe::default() }
}

fn damper(recipe: Recipe) -> Run {
    let model = truth(KIND);
    run(recipe, KIND, |x, v, i| model.force_n(x, v, i))
}

/// A network is trained once per eight restarts, so 24 restarts are three trainings.
fn options() -> Options {
    let velocity = VelocitySource::Measured;
    Options {
        conditioning: Conditioning { velocity, ..Conditioning::default() },
        restarts: 24,
        ..Options::default()
    }
}

fn fitted(name: &str, form: Form, runs: &[Run]) -> Result<Identified, Error> {
    fitted_from(options().restarts, name, form, runs)
}

fn fitted_from(restarts: u32, name: &str, form: Form, runs: &[Run]) -> Result<Identified, Error> {
    let options = Options { restarts, ..options() };
    identify(ModelSpec::named(name, form)?, runs, &options, &Watch::none())
}

/// A run with the simulated force (free run) of a random network, plus 25 N.
fn network_run(structure: NetworkStructure) -> Run {
    let mut random = Pcg64Mcg::seed_from_u64(2);
    let mut weights: Vec<f64> =
        (0..structure.weights(true)).map(|_| 0.4 * (2.0 * random.random::<f64>() - 1.0)).collect();
    // Small weights of past force keep the network stable.
    let inputs = structure.inputs(true);
    for weight in
        &mut weights[(inputs - structure.force_lags()) * structure.hidden()..inputs * structure.hidden()]
    {
        *weight *= 0.5;
    }
    if structure.has_input_neurons() {
        let first = (inputs + 2) * structure.hidden() + 1;
        weights[first..first + inputs].fill(0.8);
    }
    let scaling = NetworkScaling {
        displacement_m: Normalisation { mean: 0.0, deviation: 0.006 },
        velocity_m_s: Normalisation { mean: 0.0, deviation: 0.06 },
        drive: Some((KIND, Normalisation { mean: 0.5, deviation: 0.4 })),
        force_deviation_n: 500.0,
    };
    let network = Network::new(structure, scaling, &weights, Second(1.0 / 500.0), 0.0).expect("a network");
    let (network, mut state) = (ForceModel::Network(network), FreeRun::default());
    let mut made = run(Recipe { noise_n: 0.0, ..recipe() }, KIND, |_, _, _| 0.0);
    let forces = made.force_n.as_mut().expect("made");
    for k in 0..forces.len() {
        let inputs = Inputs {
            dt_s: (k > 0).then_some(1.0 / 500.0),
            displacement_m: made.displacement_m.values[k],
            velocity_m_s: made.velocity_m_s.as_ref().expect("made").values[k],
            acceleration_m_s2: f64::NAN,
            drive: made.drive.as_ref().expect("made").1.values[k],
            case_temp_c: f64::NAN,
        };
        forces.values[k] = 25.0 + network.free_run(&mut state, &inputs).unwrap_or(0.0);
    }
    made
}

#[test]
fn the_output_of_a_network_is_recovered() {
    for structure in NetworkStructure::ALL {
        let made = network_run(structure);
        // Three trainings may all end in a local minimum.
        let found = fitted_from(64, structure.name(), Form::SemiActive, &[made]).expect("identifies");
        let esr = found.free_run.expect("a simulation error").esr;
        assert!(esr < 2e-3, "{structure:?}: {esr}");
        assert_eq!(found.warnings, Vec::<String>::new());
        assert_eq!(found.model.force.name(), structure.name());
    }
}

#[test]
fn a_damper_is_learned_in_simulation_and_each_run_has_its_offset() {
    let make = |name, offset_n, seed| damper(Recipe { name, offset_n, seed, ..recipe() });
    let runs = [make("a", 45.0, 1), make("b", -20.0, 2)];
    for name in ["wang-liao", "narx", "chen", "boada"] {
        let found = fitted(name, Form::SemiActive, &runs).expect("identifies");
        let esr = found.free_run.expect("a simulation error").esr;
        assert!(esr < 0.05, "{name}: {esr}");
        assert_eq!(found.one_step.is_some(), name != "boada");
        let apart = found.runs[0].force_offset_n - found.runs[1].force_offset_n;
        assert!((apart - 65.0).abs() < 15.0, "{name}: {apart}");
        // The passive form does not see the drive, so its error is larger.
        let passive = fitted(name, Form::Passive, &runs).expect("identifies");
        assert_eq!(passive.model.force.drive(), None);
        assert!(passive.free_run.expect("a simulation error").esr > 2.0 * esr, "{name}");
    }
}

#[test]
fn threads_do_not_change_the_model() {
    let runs = [damper(recipe())];
    for name in ["wang-liao", "narx", "chen", "boada"] {
        let spec = ModelSpec::named(name, Form::SemiActive).expect("a model");
        let with = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            let options = Options { restarts: 16, ..options() };
            pool.install(|| identify(spec, &runs, &options, &Watch::none()).expect("identifies"))
        };
        assert_eq!(with(1), with(2), "{name}");
    }
}

#[test]
fn runs_that_cannot_be_learned_are_rejected_with_the_reason() {
    let whole = damper(recipe());
    let short = damper(Recipe { duration_s: 0.02, ..recipe() });
    let mut constant = whole.clone();
    constant.drive.as_mut().expect("made").1.values.fill(0.7);
    let mut still = whole.clone();
    still.force_n.as_mut().expect("made").values.fill(12.0);
    let mut fast = damper(Recipe { name: "fast", rate_hz: 1000.0, ..recipe() });
    for name in ["wang-liao", "narx", "chen", "boada"] {
        let text = |runs: &[Run]| fitted(name, Form::SemiActive, runs).expect_err("refused").to_string();
        let said = text(std::slice::from_ref(&short));
        assert!(said.contains("too few") && said.contains("add runs"), "{said}");
        let said = text(std::slice::from_ref(&constant));
        assert!(said.contains("current_a is 0.7 throughout") && said.contains("passive form"), "{said}");
        let said = text(std::slice::from_ref(&still));
        assert!(said.contains("never varies"), "{said}");
        let said = text(&[Run { drive: None, ..whole.clone() }]);
        assert!(said.contains("has no current_a or command_v"), "{said}");
    }
    fast.name = "fast".to_owned();
    let said = fitted("chen", Form::Passive, &[whole, fast]).expect_err("two rates").to_string();
    assert!(said.contains("the chen model is valid at one rate only"), "{said}");
}

#[test]
fn progress_is_reported_and_training_can_be_cancelled() {
    let runs = [damper(recipe())];
    for name in ["wang-liao", "narx", "chen", "boada"] {
        let spec = ModelSpec::named(name, Form::Passive).expect("a model");
        let seen = Mutex::new(Vec::new());
        let cancel = AtomicBool::new(false);
        let progress = |progress| {
            seen.lock().expect("no panic").push(progress);
            // Cancel as soon as the first restart is done.
            if matches!(progress, Progress::Restart { .. }) {
                cancel.store(true, std::sync::atomic::Ordering::Relaxed);
            }
        };
        let watch = Watch { cancel: Some(&cancel), progress: Some(&progress) };
        assert_eq!(identify(spec, &runs, &options(), &watch).err(), Some(Error::Cancelled), "{name}");
        let seen = seen.into_inner().expect("no panic");
        assert!(matches!(seen.get(1), Some(Progress::Restart { done: 1, .. })), "{name}: {seen:?}");
    }
}
