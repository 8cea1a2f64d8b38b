//! Learned inverse models against the equations of their modules, written in another way.

use super::*;
use crate::force::Normalisation;

const PERIOD_S: f64 = 1.0 / 512.0;

fn inputs(k: usize) -> Inputs {
    let t = 0.05 * k as f64;
    Inputs {
        dt_s: (k > 0).then_some(PERIOD_S),
        displacement_m: 0.004 * t.sin(),
        velocity_m_s: 0.1 * t.cos(),
        acceleration_m_s2: -3.0 * t.sin(),
        drive: f64::NAN,
        case_temp_c: f64::NAN,
    }
}

fn force_n(k: usize) -> f64 {
    300.0 * (0.07 * k as f64).cos()
}

/// Hand-set weights: a formula of their place, different for each.
fn weight(input: usize, neuron: usize) -> f64 {
    0.3 * ((1 + input) as f64 * 0.7 + neuron as f64 * 0.31).sin()
}

/// A network with hand-set weights over signals of scale one each.
fn network(structure: NetworkStructure) -> InverseModel {
    let (hidden, inputs) = (structure.hidden(), structure.inputs(true));
    let mut weights: Vec<f64> = (0..inputs).flat_map(|i| (0..hidden).map(move |j| weight(i, j))).collect();
    weights.extend((0..hidden).map(|j| 0.05 * j as f64 - 0.4));
    weights.extend((0..hidden).map(|j| 0.2 * (j as f64).cos()));
    weights.push(0.15);
    let of = |mean, deviation| Normalisation { mean, deviation };
    let scaling = InverseScaling {
        displacement_m: of(0.001, 0.003),
        velocity_m_s: of(-0.01, 0.08),
        force_n: of(20.0, 250.0),
        current_a: of(0.9, 0.6),
    };
    InverseModel::Network(
        InverseNetwork::new(structure, scaling, &weights, Second(PERIOD_S)).expect("a network"),
    )
}

#[test]
fn networks_compute_their_equation_with_the_current_fed_back() {
    for (structure, lags, past) in [(NetworkStructure::Chen, 2, 1), (NetworkStructure::Narx, 5, 5)] {
        let model = network(structure);
        let mut state = InverseState::default();
        // The fed-back current is not the network's own, as after a limit.
        let fed_a: Vec<f64> = (0..40).map(|k| 1.0 + 0.8 * (0.3 * k as f64).sin()).collect();
        for k in 0..40 {
            let found = model.step(&mut state, &inputs(k), force_n(k));
            state.feed(fed_a[k]);
            if k < lags.max(past + 1) - 1 {
                assert_eq!(found, None, "{structure:?}: sample {k} has no complete history");
                continue;
            }
            let mut u = Vec::new();
            (0..lags).for_each(|l| u.push((inputs(k - l).displacement_m - 0.001) / 0.003));
            (0..lags).for_each(|l| u.push((inputs(k - l).velocity_m_s + 0.01) / 0.08));
            (0..lags).for_each(|l| u.push((force_n(k - l) - 20.0) / 250.0));
            (1..=past).for_each(|l| u.push((fed_a[k - l] - 0.9) / 0.6));
            let mut output = 0.15;
            for j in 0..structure.hidden() {
                let z: f64 = u.iter().enumerate().map(|(i, u)| u * weight(i, j)).sum();
                output += 0.2 * (j as f64).cos() * (z + 0.05 * j as f64 - 0.4).tanh();
            }
            let found = found.expect("the history is complete");
            assert!((found - (0.9 + 0.6 * output)).abs() < 1e-12, "{structure:?} {k}: {found} {output}");
        }
    }
}

#[test]
fn rules_compute_their_equation() {
    let axis =
        |mean, std_dev| FuzzyAxis { mean, std_dev, centres: [-1.2, 0.1, 1.4], sigmas: [0.5, 0.7, 0.6] };
    let axes = [axis(0.01, 0.1), axis(-0.5, 4.0), axis(15.0, 400.0)];
    let conclusions: [[f64; 4]; 27] =
        std::array::from_fn(|r| std::array::from_fn(|m| ((r * 4 + m) as f64 * 0.37).sin()));
    let rules = InverseFuzzy::new(axes, &conclusions, 0.8, 0.5).expect("rules");
    assert_eq!((rules.parameter_count(), rules.axes()), (126, axes));
    let model = InverseModel::Fuzzy(rules);
    for k in 0..30 {
        let at = inputs(k);
        let u =
            [(at.velocity_m_s - 0.01) / 0.1, (at.acceleration_m_s2 + 0.5) / 4.0, (force_n(k) - 15.0) / 400.0];
        let (mut sum, mut total) = (0.0, 0.0);
        for (r, [p, q, s, c]) in conclusions.iter().enumerate() {
            let sets = [r / 9, (r / 3) % 3, r % 3];
            let z: f64 =
                (0..3).map(|n| ((u[n] - axes[n].centres[sets[n]]) / axes[n].sigmas[sets[n]]).powi(2)).sum();
            let fires = (-0.5 * z).exp();
            (sum, total) = (sum + fires * (p * u[0] + q * u[1] + s * u[2] + c), total + fires);
        }
        let mut state = InverseState::default();
        let found = model.step(&mut state, &at, force_n(k)).expect("rules have no history");
        assert!((found - (0.8 + 0.5 * sum / total)).abs() < 1e-12, "{k}: {found}");
    }
    let still = Inputs { acceleration_m_s2: f64::NAN, ..inputs(3) };
    assert_eq!(model.step(&mut InverseState::default(), &still, 100.0), None);
}

#[test]
fn a_gap_and_another_rate_clear_the_history() {
    for structure in [NetworkStructure::Narx, NetworkStructure::Chen] {
        let model = network(structure);
        let complete = 1 + structure.force_lags();
        let missing_after = |dt_s: Option<f64>| {
            let mut state = InverseState::default();
            let mut missing = 0;
            for k in 0..60 {
                let dt_s = if k == 30 { dt_s } else { inputs(k).dt_s };
                let found = model.step(&mut state, &Inputs { dt_s, ..inputs(k) }, force_n(k));
                state.feed(found.unwrap_or(0.5));
                missing += usize::from(k >= 30 && found.is_none());
            }
            missing
        };
        assert_eq!(missing_after(Some(1.2 * PERIOD_S)), 0, "jitter");
        for dt_s in [None, Some(2.0 * PERIOD_S), Some(0.5 * PERIOD_S), Some(f64::NAN)] {
            assert_eq!(missing_after(dt_s), complete - 1, "{structure:?} {dt_s:?}");
        }
        // A broken sample takes its place in the lags.
        let mut state = InverseState::default();
        let found = (0..60).map(|k| {
            let velocity_m_s = if k == 30 { f64::NAN } else { inputs(k).velocity_m_s };
            let found = model.step(&mut state, &Inputs { velocity_m_s, ..inputs(k) }, force_n(k));
            state.feed(found.unwrap_or(0.5));
            found.is_none() && k >= 30
        });
        assert_eq!(found.filter(|missing| *missing).count(), structure.input_lags());
    }
}

#[test]
fn invalid_numbers_are_refused_by_name() {
    let unit = Normalisation { mean: 0.0, deviation: 1.0 };
    let scaling = InverseScaling { displacement_m: unit, velocity_m_s: unit, force_n: unit, current_a: unit };
    let refused = |scaling, count: usize| {
        InverseNetwork::new(NetworkStructure::Chen, scaling, &vec![0.1; count], Second(PERIOD_S))
            .expect_err("not valid")
            .to_string()
    };
    assert_eq!(refused(scaling, 225), "weights has 225 values, but 226 are needed");
    let still = Normalisation { deviation: 0.0, ..unit };
    assert_eq!(
        refused(InverseScaling { force_n: still, ..scaling }, 226),
        "force_deviation_n is 0, but must be positive and finite"
    );
    assert_eq!(
        refused(InverseScaling { current_a: still, ..scaling }, 226),
        "current_deviation_a is 0, but must be positive and finite"
    );
    let axis = FuzzyAxis { mean: 0.0, std_dev: 1.0, centres: [-1.0, 0.0, 1.0], sigmas: [0.5; 3] };
    let none = FuzzyAxis { sigmas: [0.5, 0.0, 0.5], ..axis };
    let error = InverseFuzzy::new([axis, none, axis], &[[0.0; 4]; 27], 0.0, 1.0).expect_err("no width");
    assert!(error.to_string().starts_with("acceleration_sets[1]"), "{error}");
    let error = InverseFuzzy::new([axis; 3], &[[0.0; 4]; 27], 0.0, 0.0).expect_err("no scale");
    assert_eq!(error.to_string(), "current_std_dev_a is 0, but must be positive and finite");
}
