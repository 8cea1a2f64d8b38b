//! Models to be exported: each force model and dependence, each conditioning, each effect, and combinations.

use mr_damper_model::condition::{ApplyTo, Conditioning, VelocitySource};
use mr_damper_model::effect::term::{Argument, Form, Modulator, Term, Terms};
use mr_damper_model::effect::{Effect, EffectModel, Effects};
use mr_damper_model::force::{
    Arx, Dependence, ForceLaw, ForceModel, FuzzySets, LawModel, Lazy, LazyMetric, LazyPoint, Lpv,
    MaxwellSlip, Membership, Network, NetworkScaling, NetworkStructure, Normalisation, Order, OutputScale,
    Signal, SlipFunction, SlipGrid, Tsk, TskInput, TskKind, TskSet,
};
use mr_damper_model::model::{Envelope, Model};
use mr_damper_model::preset;
use mr_damper_model::sample::DriveKind;
use mr_damper_model::units::Second;

/// A model with a name for messages.
pub(crate) type Case = (String, Model);

pub(crate) fn fuzzy_tanh() -> Model {
    preset::load(preset::BEST_FUZZY_TANH).expect("a preset")
}

fn sets() -> FuzzySets {
    let membership = Membership { drive: DriveKind::CoilCurrent, sigma: 0.5 };
    FuzzySets::new(membership, &[0.0, 1.0, 2.5]).expect("sets")
}

/// Parameters of a damper of about 1 kN, in the order of the law.
fn law_parameters(law: ForceLaw) -> &'static [f64] {
    match law {
        ForceLaw::Sp => &[300.0, 800.0, 40.0, 0.1, -0.05],
        ForceLaw::BoucWen => &[900.0, 8000.0, 1200.0, 300.0, 40_000.0, 60_000.0, 2.0, 40_000.0, 200.0],
        ForceLaw::Kwok => &[700.0, 900.0, 400.0, 30.0, 0.4],
        ForceLaw::Li => &[400.0, 60.0, 0.02, 700.0, 300.0, 380.0, 55.0, -0.02, 720.0, 310.0],
        ForceLaw::CesmeciEngin => &[800.0, 500.0, 35.0, 0.02, 0.4],
        ForceLaw::Choi => &[
            20.0, 3000.0, 100.0, -4000.0, 50.0, 2500.0, 10.0, -20.0, 2900.0, -90.0, -3900.0, 40.0, 2400.0,
            9.0,
        ],
        ForceLaw::Arctan => &[420.0, 750.0, 25.0, 0.2, -0.08],
        ForceLaw::Linear => &[1500.0, 2500.0],
    }
}

fn law(law: ForceLaw, dependence: Dependence) -> ForceModel {
    let p = law_parameters(law);
    let coefficients: Vec<f64> = (0..dependence.copies())
        .flat_map(|copy| p.iter().map(move |value| value * [1.0, 0.3, 0.02, 0.001][copy.min(3)]))
        .collect();
    // Sets have full parameters each, a little different.
    let coefficients = match dependence {
        Dependence::Fuzzy(_) => (0..dependence.copies())
            .flat_map(|copy| p.iter().map(move |v| v * (1.0 + 0.3 * copy as f64)))
            .collect(),
        _ => coefficients,
    };
    ForceModel::Law(LawModel::new(law, dependence, &coefficients, 12.5).expect("a law"))
}

/// With the same filters and ranges as the thesis' model.
fn of(force: ForceModel) -> Model {
    Model { force, ..fuzzy_tanh() }
}

/// Every force model that has C code, in each of its forms.
pub(crate) fn forces() -> Vec<Case> {
    let mut all: Vec<Case> = preset::names()
        .iter()
        .filter_map(|name| Some((name.to_string(), preset::load(name).ok()?)))
        .filter(|(_, model)| {
            matches!(model.force, ForceModel::FuzzyTanh(_) | ForceModel::Arx(_) | ForceModel::Law(_))
        })
        .step_by(5)
        .collect();
    all.extend(laws());
    all.extend(lagged());
    all
}

/// Each law without a drive, with polynomials of the current, and with fuzzy sets over it.
fn laws() -> Vec<Case> {
    let mut all = Vec::new();
    for kind in ForceLaw::ALL {
        for dependence in [
            Dependence::None,
            Dependence::Polynomial { drive: DriveKind::CoilCurrent, degree: 2 },
            Dependence::Fuzzy(sets()),
        ] {
            all.push((format!("{} {}", kind.name(), dependence.name()), of(law(kind, dependence))));
        }
    }
    all
}

/// ARX and LPV models.
fn lagged() -> Vec<Case> {
    let mut all = Vec::new();
    let (force, x, v) = ([1.5, -0.7, 0.1], [900.0, -700.0, 40.0], [500.0, 120.0, -90.0]);
    let drive = Some((DriveKind::CoilCurrent, [60.0, -20.0, 5.0]));
    for drive in [None, drive] {
        let arx = Arx::new(force, x, v, drive, Second(0.001), 8.0).expect("a model");
        let late = Arx::delayed(force, x, v, drive, Second(0.001), 8.0).expect("a model");
        all.push((format!("arx {}", drive.is_some()), of(ForceModel::Arx(arx))));
        all.push((format!("arx-delayed {}", drive.is_some()), of(ForceModel::Arx(late))));
    }
    for dependence in
        [Dependence::Polynomial { drive: DriveKind::CommandVoltage, degree: 2 }, Dependence::Fuzzy(sets())]
    {
        let one: Vec<f64> = [force, x, v].concat();
        let coefficients: Vec<f64> = (0..dependence.copies())
            .flat_map(|copy| one.iter().map(move |value| if copy == 0 { *value } else { 0.01 * value }))
            .collect();
        let lpv = Lpv::new(dependence, &coefficients, Second(0.001), 8.0).expect("a model");
        all.push((format!("lpv {}", dependence.name()), of(ForceModel::Lpv(lpv))));
    }
    all
}

/// Numbers between -1 and 1 that differ from each other.
fn spread(k: usize, step: f64) -> f64 {
    (k as f64 * step).sin()
}

/// Networks, the Maxwell-slip model, fuzzy rules with sets of each shape, and lazy learning, each with a drive and without.
pub(crate) fn learned() -> Vec<Case> {
    let mut all = Vec::new();
    let of_scale = |mean, deviation| Normalisation { mean, deviation };
    for driven in [false, true] {
        let drive = driven.then_some((DriveKind::CoilCurrent, of_scale(1.2, 0.9)));
        let name = |what: &str| format!("{what} {}", if driven { "driven" } else { "passive" });
        for structure in NetworkStructure::ALL {
            let scaling = NetworkScaling {
                displacement_m: of_scale(0.001, 0.008),
                velocity_m_s: of_scale(0.0, 0.12),
                drive,
                force_deviation_n: 450.0,
            };
            let weights: Vec<f64> = (0..structure.weights(driven)).map(|k| 0.3 * spread(k, 1.7)).collect();
            let network = Network::new(structure, scaling, &weights, Second(0.001), 6.0).expect("a network");
            all.push((name(structure.name()), of(ForceModel::Network(network))));
        }
        let sets = driven.then(sets);
        let grid = SlipGrid::new([0.01, 0.05, 0.2], [2e-4, 6e-4, 1.5e-3, 4e-3, 9e-3]).expect("a grid");
        let functions: Vec<SlipFunction> = (0..sets.map_or(1, |sets| sets.len()))
            .map(|set| SlipFunction {
                damping_slopes_n_s_m: std::array::from_fn(|k| 800.0 + 300.0 * spread(k + 9 * set, 0.9)),
                bristle_forces_n: std::array::from_fn(|k| 60.0 + 50.0 * spread(k + 5 * set, 1.1)),
                stiffness_n_m: 400.0 * spread(set, 2.0),
                set_offset_n: 5.0 * spread(set, 3.0),
            })
            .collect();
        let slip = MaxwellSlip::new(grid, sets, &functions, -4.0).expect("a model");
        all.push((name("maxwell-slip"), of(ForceModel::MaxwellSlip(slip))));
        let points: Vec<LazyPoint> = (0..200)
            .map(|k| LazyPoint {
                displacement_m: 0.015 * spread(k, 0.7),
                velocity_m_s: 0.4 * spread(k, 1.3),
                drive: if driven { 1.3 + 1.2 * spread(k, 2.1) } else { 0.0 },
                force_n: 700.0 * spread(k, 1.31),
            })
            .collect();
        let metric = LazyMetric {
            displacement_scale_m: 0.02,
            velocity_scale_m_s: 0.05,
            drive_scale: driven.then_some((DriveKind::CoilCurrent, 0.8)),
        };
        let lazy = Lazy::new(metric, [5, 12], &points, 9.0).expect("a memory");
        all.push((name("boada"), of(ForceModel::Lazy(lazy))));
    }
    all.extend(rules());
    all
}

/// Fuzzy rules over displacement, velocity and drive, with sets of each shape.
fn rules() -> Vec<Case> {
    let gaussian = [-1.2, 0.1, 1.3].map(|centre| TskSet::Gaussian { centre, sigma: 0.5 + 0.1 * centre });
    let triangle = [(-2.0, -1.0, 0.2), (-1.0, 0.1, 1.0), (0.3, 1.2, 2.0)]
        .map(|(left, peak, right)| TskSet::Triangle { left, peak, right });
    let bell =
        [-1.0, 0.2, 1.4].map(|centre| TskSet::Bell { half_width: 0.6, exponent: 2.0 + centre, centre });
    let trapezoid = [(-2.0, -1.5, -1.0, -0.4), (-0.3, 0.0, 0.3, 0.9), (0.8, 1.0, 1.5, 1.9)].map(
        |(left_foot, left_shoulder, right_shoulder, right_foot)| TskSet::Trapezoid {
            left_foot,
            left_shoulder,
            right_shoulder,
            right_foot,
        },
    );
    let two_sided = [-1.1, 0.0, 1.2].map(|centre| TskSet::TwoSidedGaussian {
        left_sigma: 0.4,
        left_centre: centre - 0.2,
        right_sigma: 0.6,
        right_centre: centre + 0.1,
    });
    let shapes = [
        ("gaussian", gaussian),
        ("triangle", triangle),
        ("bell", bell),
        ("trapezoid", trapezoid),
        ("two-sided", two_sided),
    ];
    let mut all = Vec::new();
    for (name, sets) in shapes {
        for order in [Order::Constant, Order::First] {
            let input = |signal, mean, std_dev, sets: &[TskSet]| {
                TskInput::new(signal, mean, std_dev, sets).expect("an input")
            };
            let inputs = [
                input(Signal::Displacement, 0.001, 0.008, &sets),
                input(Signal::Velocity, 0.0, 0.15, &sets[..2]),
                input(Signal::Drive(DriveKind::CoilCurrent), 1.2, 0.8, &sets),
            ];
            let values: Vec<f64> = (0..18 * order.width(3)).map(|k| spread(k, 0.77)).collect();
            let output = OutputScale { mean_n: 3.0, std_dev_n: 400.0 };
            let tsk = Tsk::new(TskKind::Anfis, &inputs, order, &values, output, 2.0).expect("rules");
            all.push((format!("anfis {name} {order:?}"), of(ForceModel::Tsk(tsk))));
        }
    }
    let lone = TskInput::new(Signal::Velocity, 0.0, 0.2, &gaussian).expect("an input");
    let one = Tsk::new(
        TskKind::Anfis,
        &[lone],
        Order::First,
        &[1.0, 0.2, -0.4, 0.9, 0.5, -0.1],
        OutputScale { mean_n: 0.0, std_dev_n: 300.0 },
        0.0,
    );
    all.push(("anfis of one input".to_owned(), of(ForceModel::Tsk(one.expect("rules")))));
    all
}

/// The thesis' model with each filter and each velocity.
pub(crate) fn conditionings() -> Vec<Case> {
    let mut all = Vec::new();
    for apply_to in [ApplyTo::Inputs, ApplyTo::Output, ApplyTo::None] {
        for velocity in [
            VelocitySource::Backward,
            VelocitySource::ThreePoint,
            VelocitySource::Slope,
            VelocitySource::Measured,
        ] {
            let conditioning = Conditioning { apply_to, velocity, cutoff_hz: 25.0, slope_window_s: 0.012 };
            all.push((format!("{apply_to:?} {velocity:?}"), Model { conditioning, ..fuzzy_tanh() }));
        }
    }
    let envelope = Envelope { displacement_m: Some([-0.01, 0.01]), ..Envelope::default() };
    all.push(("one range".to_owned(), Model { envelope, ..fuzzy_tanh() }));
    // The service also flags a force that it holds.
    let envelope = Envelope { force_n: Some([-300.0, 300.0]), ..Envelope::default() };
    all.push(("a range of forces".to_owned(), Model { envelope, ..fuzzy_tanh() }));
    all
}

/// The thesis' model with a term of each form, argument and modulator.
pub(crate) fn terms() -> Vec<Case> {
    let mut all = Vec::new();
    let count = Form::ALL.len().max(Argument::ALL.len()).max(Modulator::ALL.len());
    for k in 0..count {
        let (form, argument) = (Form::ALL[k % Form::ALL.len()], Argument::ALL[k % Argument::ALL.len()]);
        let mut modulator = Modulator::ALL[k % Modulator::ALL.len()];
        if modulator.acts_on_input() && argument == Argument::Force {
            modulator = Modulator::One;
        }
        // About as large as the argument is.
        let size = match argument.unit().suffix() {
            "_m" => 0.005,
            "_m_s" => 0.1,
            "_n" => 200.0,
            _ => 1.0,
        };
        let parameters = match form {
            Form::Resonance => vec![12.0, 0.1],
            _ => vec![size; form.parameters().len()],
        };
        let amount = if modulator.acts_on_input() { 0.02 } else { 0.3 };
        let term =
            Term::new((modulator, argument, form), amount, &parameters, [-size, 2.0 * size]).expect("a term");
        let friction = Effect::Friction.example();
        let list = [friction, Effect::LoadCellDrift.example()];
        let effects = Effects::new(if k % 2 == 0 { &list } else { &list[..1] }).expect("they fit");
        let linear =
            Term::new((Modulator::One, Argument::Path, Form::Linear), 0.5, &[], [0.0, 10.0]).expect("a term");
        let both = [term, linear];
        let terms = Terms::new(if k % 3 == 0 { &both } else { &both[..1] }).expect("they fit");
        let name = format!("term {}, {}, {}", modulator.name(), argument.name(), form.name());
        all.push((name, Model { effects: effects.with_terms(terms), ..fuzzy_tanh() }));
    }
    all
}

pub(crate) fn with(model: Model, effects: &[EffectModel]) -> Model {
    Model { effects: Effects::new(effects).expect("they fit"), ..model }
}

/// The thesis' model with each effect, and combinations around several models.
pub(crate) fn effects() -> Vec<Case> {
    let mut all: Vec<Case> =
        Effect::ALL.iter().map(|effect| (effect.title(), with(fuzzy_tanh(), &[effect.example()]))).collect();
    let late = EffectModel::new(Effect::SensorDelay, &[-2e-3]).expect("in its range");
    all.push(("sensor_delay of displacement".to_owned(), with(fuzzy_tanh(), &[late])));
    let bouc_wen = of(law(ForceLaw::BoucWen, Dependence::None));
    let fuzzy_bouc_wen = of(law(ForceLaw::BoucWen, Dependence::Fuzzy(sets())));
    let kwok = of(law(ForceLaw::Kwok, Dependence::Polynomial { drive: DriveKind::CoilCurrent, degree: 1 }));
    use Effect::{
        AntiAliasMismatch, CoilLag, CoilLagRiseFall, Deadzone, Friction, GasSpring, Inertia, LoadCellDrift,
        Remanence, SensorDelay, SeriesSpring, ThermalFade,
    };
    for (name, model, list) in [
        ("fuzzy-tanh", fuzzy_tanh(), [CoilLag, SeriesSpring].as_slice()),
        ("fuzzy-tanh", fuzzy_tanh(), &[SeriesSpring, LoadCellDrift]),
        ("fuzzy-tanh", fuzzy_tanh(), &[SeriesSpring, SeriesSpring]),
        ("fuzzy-tanh", fuzzy_tanh(), &[GasSpring, Inertia, AntiAliasMismatch]),
        ("fuzzy-tanh", fuzzy_tanh(), &[Friction, ThermalFade, SensorDelay]),
        ("bouc-wen", bouc_wen, &[SeriesSpring]),
        ("fuzzy bouc-wen", fuzzy_bouc_wen, &[Remanence, CoilLagRiseFall, SeriesSpring]),
        ("kwok", kwok, &[Friction, Friction, Deadzone]),
    ] {
        let list: Vec<EffectModel> = list.iter().map(|effect| effect.example()).collect();
        let titles: Vec<String> = list.iter().map(|effect| effect.effect().title()).collect();
        all.push((format!("{name} with {}", titles.join(", ")), with(model, &list)));
    }
    all
}

/// Each law, model and effect once, and three combinations of two effects, for long comparisons. Each has a drive if it can; the laws have
/// their dependences in turn.
pub(crate) fn each_once() -> Vec<Case> {
    let laws =
        laws().into_iter().enumerate().filter(|(index, _)| index % 3 == index / 3 % 3).map(|(_, law)| law);
    let is_driven =
        |(name, _): &Case| ["true", "fuzzy", "driven", "First"].iter().any(|end| name.ends_with(end));
    let models = [lagged(), learned()].concat().into_iter().filter(is_driven);
    let thesis = ("fuzzy-tanh".to_owned(), fuzzy_tanh());
    [thesis]
        .into_iter()
        .chain(laws)
        .chain(models)
        .chain(effects().into_iter().take(Effect::ALL.len() + 4))
        .collect()
}
