//! Discovery of terms on measured runs.

use crate::diagnosis::outcome::CONDITIONING;
use crate::measured::folder;
use mr_damper_model::diagnose::{EffectSet, Runs, Settings, close};
use mr_damper_model::effect::term::{Argument, Form, Modulator, Term};
use mr_damper_model::force::{ForceLaw, Form as LawForm};
use mr_damper_model::identify::{
    Dataset, DatasetOptions, ModelSpec, Options, Structure, Watch, identify_datasets,
};
use mr_damper_model::sample::{Run, Stamp, Trace};

/// The part of `run` from one time to another, s.
fn part(run: &Run, from_s: f64, to_s: f64) -> Run {
    let [from, to] = [from_s, to_s].map(|time_s| Stamp::from_seconds(time_s).expect("a time"));
    let part = |trace: &Trace| {
        let inside = |stamp: &Stamp| (from..to).contains(stamp);
        let (stamps, values) =
            trace.stamps.iter().zip(&trace.values).filter(|(stamp, _)| inside(stamp)).unzip();
        Trace { stamps, values }
    };
    Run {
        displacement_m: part(&run.displacement_m),
        force_n: run.force_n.as_ref().map(part),
        ..Run::default()
    }
}

/// The axis has a moving mass of 95.1 kg and a Coulomb friction of 20.4 N, as the authors of the benchmark EMPS (A. Janot, M. Gautier, M. Brunot, 2019) identified them.
#[test]
#[ignore = "needs the measured runs (MR_DAMPER_DATA)"]
fn mass_and_friction_of_a_positioning_axis_are_found_without_the_library() {
    let [run] = &folder("emps")[..] else { panic!("one run") };
    let rows = |from_s, to_s| {
        let run = part(run, from_s, to_s);
        vec![Dataset::from_run(&run, &CONDITIONING, &DatasetOptions::default()).expect("rows")]
    };
    let [estimate, confirm, test] = [rows(0.0, 12.5), rows(12.5, 16.5), rows(16.5, 30.0)];
    let options = Options { conditioning: CONDITIONING, choose_velocity: false, ..Options::default() };
    let spec = ModelSpec::new(Structure::Law(ForceLaw::Linear), LawForm::Passive).expect("a passive law");
    let base = identify_datasets(spec, &estimate, &options, &Watch::none()).expect("a base").model;
    let runs = Runs { estimate: &estimate, confirm: &confirm, test: &test, ..Runs::default() };
    let settings = Settings { effects: EffectSet::NONE, block_s: Some(1.0), ..Settings::default() };
    let found = close(&base, &runs, &settings, &Watch::none(), &|_| {}).expect("a result");
    let amount = |modulator: Modulator| {
        let is = |term: &&Term| term.kind() == (modulator, Argument::Displacement, Form::Constant);
        let mut terms = found.discovery.terms.iter().map(|found| &found.term);
        terms.find(is).map_or_else(|| panic!("{:?}", found.discovery), Term::amount)
    };
    let (mass_kg, friction_n) = (amount(Modulator::Acceleration), amount(Modulator::SignVelocity));
    assert!((mass_kg / 95.1 - 1.0).abs() < 0.02, "{mass_kg}");
    assert!((friction_n / 20.4 - 1.0).abs() < 0.05, "{friction_n}");
}
