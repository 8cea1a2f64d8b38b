//! Inverse by fuzzy rules: ANFIS with force and current swapped.
//!
//! ```text
//! rule r:  if x is in set j, v in set k, Fd in set l, then  f_r = p_r x + q_r v + r_r Fd + s_r
//! i = sum_r W_r f_r / sum_r W_r
//! ```
//!
//! | symbol | what | unit |
//! |---|---|---|
//! | Fd | demanded force of the model without effects, including its offset | N |
//! | x, v | displacement, velocity of the damper | m, m/s |
//! | i | current | A |
//! | p, q, r, s | ridge regression on the model's force along sines, see `cycle.rs` | |
//!
//! Sets are Gaussians: 2 over the displacement, 4 over the velocity, 3 over the force. This is the grid of Schurter and Roschke with
//! force in place of current: 24 rules of four parameters. The velocity sets are closer together about rest, where the force
//! reverses: on the fuzzy-tanh models this reduces the force error by a fifth compared with even distances. Outside the envelope,
//! displacement and velocity are clamped to it.
//!
//! Sources: Jang (1993), IEEE Trans. SMC 23, 665; as inverse of an MR damper Schurter and Roschke (2001), Atray and Roschke (2004).
//! See `[jang1993]`, `[schurter2001]` and `[atray2004]` in the bibliography (node/docs/guide/bibliography.md).

use super::cycle::Cycle;
use super::parts::InverseMap;
use super::surrogate::Sample;
use crate::error::Error;
use crate::force::{MAX_CONCLUSIONS, Order, OutputScale, Signal, Tsk, TskInput, TskKind, TskSet};
use nalgebra::{DMatrix, DVector};

/// Centres over displacement, velocity and force, as shares of their largest.
const CENTRES_X: [f64; 2] = [-1.0, 1.0];
const CENTRES_V: [f64; 4] = [-1.0, -0.2, 0.2, 1.0];
const CENTRES_F: [f64; 3] = [-0.8, 0.0, 0.8];
/// Width of a set as a share of the distance to its nearest neighbour.
const WIDTH: f64 = 0.5;
/// Weight of the ridge penalty on the conclusions, as a share of the number of rows. It affects only rules that hardly fire.
const RIDGE: f64 = 1e-8;

/// The rules.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Fuzzy {
    rules: Tsk,
    /// Range of the fit.
    low_m: f64,
    high_m: f64,
    fastest_m_s: f64,
}

impl Fuzzy {
    /// The least-squares fit of the rules to `samples`; `None` if they do not determine the rules.
    pub(super) fn fit(samples: &[Sample], cycle: &Cycle) -> Result<Option<Self>, Error> {
        let most_n = samples.iter().fold(0.0_f64, |most, sample| most.max(sample.force_n.abs()));
        let inputs = [
            input(Signal::Displacement, cycle.middle_m, cycle.half_m, &CENTRES_X)?,
            input(Signal::Velocity, 0.0, cycle.fastest_m_s, &CENTRES_V)?,
            input(Signal::Force, 0.0, most_n, &CENTRES_F)?,
        ];
        let count = inputs.iter().map(TskInput::len).product::<usize>() * Order::First.width(inputs.len());
        // The output is a current: its unit is A.
        let output = OutputScale { mean_n: 0.0, std_dev_n: 1.0 };
        let made =
            |conclusions: &[f64]| Tsk::new(TskKind::Anfis, &inputs, Order::First, conclusions, output, 0.0);
        let blank = made(&[0.0; MAX_CONCLUSIONS][..count])?;
        let mut square = DMatrix::<f64>::identity(count, count) * (RIDGE * samples.len() as f64);
        let mut rhs = DVector::<f64>::zeros(count);
        for sample in samples {
            // The rules are linear in their conclusions, so the derivatives are the regressors.
            let (_, gradient) = blank.output_and_gradient_at(&sample.raw());
            let row = DVector::from_column_slice(&gradient.conclusions[..count]);
            square.ger(1.0, &row, &row, 1.0);
            rhs.axpy(sample.inputs.drive, &row, 1.0);
        }
        let Some(factors) = square.cholesky() else { return Ok(None) };
        let conclusions = factors.solve(&rhs);
        Ok(Some(Self {
            rules: made(conclusions.as_slice())?,
            low_m: cycle.middle_m - cycle.half_m,
            high_m: cycle.middle_m + cycle.half_m,
            fastest_m_s: cycle.fastest_m_s,
        }))
    }

    pub(super) const fn parts(&self) -> InverseMap {
        let Self { rules, low_m, high_m, fastest_m_s } = *self;
        InverseMap::Fuzzy { rules, displacement_m: [low_m, high_m], fastest_m_s }
    }

    /// The current for `force_n` at displacement `x_m` and velocity `v_m_s`; `None` if it is not finite.
    #[inline]
    pub(super) fn current_a(&self, x_m: f64, v_m_s: f64, force_n: f64) -> Option<f64> {
        let x_m = x_m.clamp(self.low_m, self.high_m);
        let v_m_s = v_m_s.clamp(-self.fastest_m_s, self.fastest_m_s);
        Some(self.rules.output_at(&[x_m, v_m_s, force_n])).filter(|current_a| current_a.is_finite())
    }
}

/// Gaussians at `centres`, given as shares of `scale` about `middle`.
fn input(signal: Signal, middle: f64, scale: f64, centres: &[f64]) -> Result<TskInput, Error> {
    let set = |centre: &f64| {
        let distances = centres.iter().map(|other| (other - centre).abs()).filter(|distance| *distance > 0.0);
        TskSet::Gaussian { centre: *centre, sigma: WIDTH * distances.fold(f64::INFINITY, f64::min) }
    };
    let sets: Vec<TskSet> = centres.iter().map(set).collect();
    TskInput::new(signal, middle, scale, &sets)
}
