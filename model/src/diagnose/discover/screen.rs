//! The screen: the gain of every pair of modulator and argument, by sums that are computed once a pair.
//!
//! ```text
//! M     = m hats(q)               48 hat functions of the argument, each run's mean removed
//! C     = K^-1 N'M                on the side where it is fitted; K = N'N + ridge + penalty
//! A     = M'M - M'N C,            b = M'(r - N d)                      where it is fitted
//! A     = (M - N C)'(M - N C),    b = (M - N C)'(r - N d)              on the other side, with the same C and d
//! G     = g(knots)                a closed form on the knots
//! c     = G'b / G'A G             where it is fitted
//! gain  = 2 c G'b - c^2 G'A G     on the other side
//! ```
//!
//! A form then costs a few microseconds, so each is tried with a grid of its parameters. Forms and pairs are compared by the gain on the
//! validation runs of what was fitted on the training runs. The test of significance also has the gain of the reverse (cross-fitting):
//! amount and nuisance fitted on the validation runs, the gain on the blocks of the training runs.

use super::BothBlocks;
use super::claim::Healthy;
use super::nuisance::{Side, Sides};
use super::resonance;
use super::structure::place;
use crate::diagnose::Thresholds;
use crate::diagnose::blocks::Blocks;
use crate::effect::term::{Argument, Form, MAX_FORM_PARAMETERS, Modulator, Term, Terms};
use crate::error::Error;
use crate::lanes::widest;
use crate::parallel;
use nalgebra::{DMatrix, DVector};

/// Number of hat functions.
const KNOTS: usize = 48;
/// The argument of the form that is the same for all arguments: it is in every run, and its range does not end with the run.
pub(super) const OF_CONSTANT: Argument = Argument::Displacement;
/// Share of a curve that must remain after projection; below it the nuisance space can take its place.
const LEAST_IDENTIFIABLE: f64 = 1e-3;

/// True if enough of a curve remains when the nuisance space is projected off: `power` of it, of the `whole` curve's power.
pub(super) fn is_identifiable(power: f64, whole: f64) -> bool {
    whole > 0.0 && power > LEAST_IDENTIFIABLE * whole
}

/// The score of a term with `parameters` numbers beside its amount, whose gain is `gain`, N².
pub(super) fn score(gain: f64, parameters: usize, thresholds: &Thresholds) -> f64 {
    if gain > 0.0 { gain * (1.0 - thresholds.cost_of_number * (1 + parameters) as f64) } else { gain }
}

/// The best closed form of a pair.
#[derive(Debug, Clone)]
pub(super) struct Pair {
    pub(super) modulator: Modulator,
    pub(super) argument: Argument,
    pub(super) form: Form,
    pub(super) amount: f64,
    pub(super) parameters: Vec<f64>,
    pub(super) range: [f64; 2],
    /// Drop of the squared error on the training runs, N².
    pub(super) train_gain: f64,
    /// Drop of the squared error on the validation runs, N²; less for a term with more numbers.
    pub(super) score: f64,
    /// Drop of the squared error on each block of both sides, of what was fitted on the other one, N².
    pub(super) gains: Vec<f64>,
    /// Size of the amount on the healthy runs as a share of the amount; `None` without healthy runs that can tell.
    pub(super) on_healthy: Option<f64>,
}

impl Pair {
    /// The term that this pair suggests.
    pub(super) fn term(&self) -> Result<Term, Error> {
        Term::new((self.modulator, self.argument, self.form), self.amount, &self.parameters, self.range)
    }
}

/// The best form of each pair that these runs can test and that `taken` does not have, the best pair first. `healthy` are the healthy runs, as
/// training runs.
pub(super) fn pairs(
    sides: &Sides,
    healthy: Option<&Healthy>,
    taken: &Terms,
    blocks: &BothBlocks,
    thresholds: &Thresholds,
) -> Vec<Pair> {
    let all: Vec<(Modulator, Argument)> = Modulator::ALL
        .into_iter()
        .flat_map(|modulator| Argument::ALL.map(|argument| (modulator, argument)))
        .filter(|(modulator, argument)| !(modulator.acts_on_input() && *argument == Argument::Force))
        .filter(|pair| taken.iter().all(|term| !repeats(*pair, term)))
        .collect();
    let nuisance = [&sides.train, &sides.confirm].map(|side| interleaved(&side.nuisance.columns));
    let one = |&(modulator, argument): &(Modulator, Argument)| {
        pair(sides, &nuisance, healthy, modulator, argument, blocks, thresholds)
    };
    let mut found: Vec<Pair> = parallel::map(&all, one).into_iter().flatten().collect();
    let is_new = |pair: &Pair| taken.iter().all(|term| !repeats((pair.modulator, pair.argument), term));
    found.extend(resonance::pairs(sides, healthy, blocks, thresholds).filter(is_new));
    found.sort_by(|a, b| b.score.total_cmp(&a.score));
    found
}

/// True if a term of this pair would refine the curve of `term`: it has the same pair, or both grow while the damper runs, as time, path, energy
/// and temperature do together.
pub(super) fn repeats((modulator, argument): (Modulator, Argument), term: &Term) -> bool {
    let (own, of, _) = term.kind();
    let both_grow = argument.counts_from_start() && of.counts_from_start();
    both_grow || (own, of) == (modulator, argument)
}

/// At most `count` knots of an argument whose values on the training runs are `series`: even over its range; for arguments that are mostly
/// small, half of them at quantiles. `None` if it does not vary.
pub(super) fn knots(argument: Argument, series: &[f64], count: usize) -> Option<Vec<f64>> {
    let mut sorted = series.to_vec();
    sorted.sort_by(f64::total_cmp);
    let (low, high) = (*sorted.first()?, *sorted.last()?);
    let varies = high - low > 1e-9 * high.abs().max(low.abs());
    if !varies {
        return None;
    }
    let even = match argument {
        Argument::Velocity
        | Argument::Speed
        | Argument::Acceleration
        | Argument::Force
        | Argument::Travel
        | Argument::TimeSinceReversal
        | Argument::TimeSinceDriveChange
        | Argument::DriveChange
        | Argument::MeanSpeed => count / 2,
        _ => count,
    };
    let at = |j: usize, n: usize| j as f64 / (n - 1) as f64;
    let mut knots: Vec<f64> = (0..even).map(|j| low + (high - low) * at(j, even)).collect();
    let quantiles = count - even;
    knots.extend((1..=quantiles).map(|j| sorted[(series.len() - 1) * j / (quantiles + 1)]));
    knots.sort_by(f64::total_cmp);
    knots.dedup_by(|a, b| (*a - *b).abs() < 1e-6 * (high - low));
    Some(knots)
}

/// The sums of a pair on one side: A and b of the module.
struct Sums {
    a: DMatrix<f64>,
    b: DVector<f64>,
}

/// M'M, M'N and M'r on one side.
struct Moments {
    own: DMatrix<f64>,
    nuisance: DMatrix<f64>,
    residual: DVector<f64>,
}

/// Columns whose sums over the rows are computed together.
const TOGETHER: usize = 8;

/// Columns in groups of [`TOGETHER`], each group row by row; zeros after the last column.
type Interleaved = Vec<Vec<[f64; TOGETHER]>>;

fn interleaved(columns: &[Vec<f64>]) -> Interleaved {
    let group = |group: &[Vec<f64>]| {
        let value = |row: usize, k: usize| group.get(k).map_or(0.0, |column| column[row]);
        (0..group[0].len()).map(|row| std::array::from_fn(|k| value(row, k))).collect()
    };
    columns.chunks(TOGETHER).map(group).collect()
}

/// The hat functions of a pair on one side: for each row the knot below, and the weights of this knot and the next one.
pub(super) struct Hats {
    places: Vec<(usize, [f64; 2])>,
    knots: usize,
}

impl Hats {
    pub(super) fn new(side: &Side, modulator: Modulator, argument: Argument, knots: &[f64]) -> Option<Self> {
        let (m, q) = (side.series.modulator(modulator)?, side.series.argument(argument)?);
        let place = |(m, q): (&f64, &f64)| {
            let (index, share) = place(knots, *q);
            (
                index.min(knots.len() - 2),
                match index + 1 == knots.len() {
                    true => [0.0, *m],
                    false => [m * (1.0 - share), m * share],
                },
            )
        };
        Some(Self { places: m.iter().zip(q).map(place).collect(), knots: knots.len() })
    }

    /// M'X of several series X, given row by row: a row for each knot.
    fn onto<const N: usize>(&self, rows: &[[f64; N]]) -> Vec<[f64; N]> {
        let mut sums = vec![[0.0; N]; self.knots];
        widest(
            #[inline(always)]
            || {
                for ((index, weights), values) in self.places.iter().zip(rows) {
                    // One check of bounds for both knots.
                    let Some(both) = sums[*index..].first_chunk_mut::<2>() else { continue };
                    for (sums, weight) in both.iter_mut().zip(weights) {
                        sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight * value);
                    }
                }
            },
        );
        sums
    }

    fn moments(&self, side: &Side, nuisance: &Interleaved) -> Moments {
        let n = self.knots;
        let mut own = DMatrix::zeros(n, n);
        for run in side.rows.runs() {
            let mut sums = DVector::<f64>::zeros(n);
            for (index, [below, above]) in &self.places[run.range.clone()] {
                own[(*index, *index)] += below * below;
                own[(*index, index + 1)] += below * above;
                own[(index + 1, *index)] += below * above;
                own[(index + 1, index + 1)] += above * above;
                sums[*index] += below;
                sums[index + 1] += above;
            }
            own -= &sums * sums.transpose() / run.range.len().max(1) as f64;
        }
        let by_group: Vec<Vec<[f64; TOGETHER]>> = nuisance.iter().map(|group| self.onto(group)).collect();
        let value = |knot: usize, column: usize| by_group[column / TOGETHER][knot][column % TOGETHER];
        let nuisance = DMatrix::from_fn(n, side.nuisance.columns.len(), value);
        let residual = self.onto(side.residual_n.as_chunks::<1>().0);
        Moments { own, nuisance, residual: DVector::from_iterator(n, residual.into_iter().flatten()) }
    }

    /// The curve with the values `at_knots`, over the rows, each run's mean removed.
    pub(super) fn series(&self, side: &Side, at_knots: &DVector<f64>) -> Vec<f64> {
        let value = |(index, [below, above]): &(usize, [f64; 2])| {
            below * at_knots[*index] + above * at_knots[index + 1]
        };
        let mut series: Vec<f64> = self.places.iter().map(value).collect();
        side.rows.centre(&mut series);
        series
    }
}

impl Moments {
    /// K^-1 N'M.
    fn nuisance_weights(&self, side: &Side) -> DMatrix<f64> {
        side.nuisance.solve(&self.nuisance.transpose())
    }

    /// A and b on the side where the nuisance weights `c` and the side's own were fitted.
    fn fitted(&self, side: &Side, c: &DMatrix<f64>) -> Sums {
        Sums { a: &self.own - &self.nuisance * c, b: &self.residual - &self.nuisance * &side.d }
    }

    /// A and b on the other side, with the nuisance weights `c` of the hat functions and `d` of the residual.
    fn held_out(&self, side: &Side, c: &DMatrix<f64>, d: &DVector<f64>) -> Sums {
        let crossed = &self.nuisance * c;
        let a = &self.own - &crossed - crossed.transpose() + c.transpose() * (&side.nuisance.square * c);
        let b = &self.residual - &self.nuisance * d - c.transpose() * &side.left;
        Sums { a, b }
    }
}

fn pair(
    sides: &Sides,
    [nuisance_of_train, nuisance_of_confirm]: &[Interleaved; 2],
    healthy: Option<&Healthy>,
    modulator: Modulator,
    argument: Argument,
    blocks: &BothBlocks,
    thresholds: &Thresholds,
) -> Option<Pair> {
    let knots = knots(argument, sides.train.series.argument(argument)?, KNOTS)?;
    let [on_train, on_confirm] =
        [&sides.train, &sides.confirm].map(|side| Hats::new(side, modulator, argument, &knots));
    let (on_train, on_confirm) = (on_train?, on_confirm?);
    let train = on_train.moments(&sides.train, nuisance_of_train);
    let confirm = on_confirm.moments(&sides.confirm, nuisance_of_confirm);
    let c = train.nuisance_weights(&sides.train);
    let fit = Fit {
        argument,
        has_holes: argument.counts_from_start() && sides.train.rows.are_stretches(),
        whole: &train.own,
        train: train.fitted(&sides.train, &c),
        confirm: confirm.held_out(&sides.confirm, &c, &sides.train.d),
        knots: &knots,
        thresholds,
    };
    let best = fit.best()?;
    let at_knots =
        DVector::from_iterator(knots.len(), knots.iter().map(|q| best.form.value(best.parameters, *q)));
    let gains = |side: &Side, hats: &Hats, c: &DMatrix<f64>, amount: f64, blocks: &Blocks| {
        side.gains(hats.series(side, &at_knots), amount, &(c * &at_knots), blocks)
    };
    let mut all_gains = gains(&sides.confirm, &on_confirm, &c, best.amount, &blocks.confirm);
    let c = confirm.nuisance_weights(&sides.confirm);
    let reverse = confirm.fitted(&sides.confirm, &c);
    let power = at_knots.dot(&(&reverse.a * &at_knots));
    let whole = at_knots.dot(&(&confirm.own * &at_knots));
    let amount = if is_identifiable(power, whole) { at_knots.dot(&reverse.b) / power } else { 0.0 };
    all_gains.extend(gains(&sides.train, &on_train, &c, amount, &blocks.train));
    let on_healthy = healthy.and_then(|healthy| {
        let hats = Hats::new(healthy.side(), modulator, argument, &knots)?;
        Some((healthy.share(&hats.series(healthy.side(), &at_knots))? / best.amount).abs())
    });
    Some(Pair {
        modulator,
        argument,
        form: best.form,
        amount: best.amount,
        parameters: best.parameters[..best.form.parameters().len()].to_vec(),
        range: [knots[0], knots[knots.len() - 1]],
        train_gain: best.train_gain,
        score: best.score,
        gains: all_gains,
        on_healthy,
    })
}

/// The closed forms of one pair.
struct Fit<'a> {
    argument: Argument,
    /// The argument has values between stretches of a run that are not in the data.
    has_holes: bool,
    whole: &'a DMatrix<f64>,
    train: Sums,
    confirm: Sums,
    knots: &'a [f64],
    thresholds: &'a Thresholds,
}

/// A closed form, fitted.
struct Curve {
    form: Form,
    parameters: [f64; MAX_FORM_PARAMETERS],
    amount: f64,
    train_gain: f64,
    score: f64,
}

impl Fit<'_> {
    /// The form with the best score; among forms that are alike, the one with the fewest numbers.
    fn best(&self) -> Option<Curve> {
        let of_form = |form: Form| {
            let curves = self.grid(form).into_iter().filter_map(|parameters| self.curve(form, parameters));
            curves.max_by(|a, b| a.score.total_cmp(&b.score))
        };
        let forms = Form::ALL.into_iter().filter(|form| !(self.has_holes && form.repeats_or_returns()));
        let mut all: Vec<Curve> = forms.filter_map(of_form).collect();
        let best = all.iter().map(|curve| curve.score).max_by(f64::total_cmp)?;
        all.retain(|curve| curve.score >= best - self.thresholds.form_alike * best.abs());
        let fewest = all.iter().map(|curve| curve.form.parameters().len()).min()?;
        all.retain(|curve| curve.form.parameters().len() == fewest);
        all.into_iter().max_by(|a, b| a.score.total_cmp(&b.score))
    }

    fn curve(&self, form: Form, parameters: [f64; MAX_FORM_PARAMETERS]) -> Option<Curve> {
        let g =
            DVector::from_iterator(self.knots.len(), self.knots.iter().map(|q| form.value(parameters, *q)));
        let power = g.dot(&(&self.train.a * &g));
        let whole = g.dot(&(self.whole * &g));
        if !is_identifiable(power, whole) {
            return None;
        }
        let along = g.dot(&self.train.b);
        let amount = along / power;
        let gain = 2.0 * amount * g.dot(&self.confirm.b) - amount * amount * g.dot(&(&self.confirm.a * &g));
        let score = score(gain, form.parameters().len(), self.thresholds);
        (amount.is_finite() && score.is_finite()).then_some(Curve {
            form,
            parameters,
            amount,
            train_gain: along * amount,
            score,
        })
    }

    /// The grid of a form's parameters over the range of the argument.
    fn grid(&self, form: Form) -> Vec<[f64; MAX_FORM_PARAMETERS]> {
        let (low, high) = (self.knots[0], self.knots[self.knots.len() - 1]);
        let (range, most) = (high - low, low.abs().max(high.abs()));
        let places = |n: usize| (1..n).map(move |j| low + range * j as f64 / n as f64);
        let sizes = |sizes: &'static [f64], of: f64| sizes.iter().map(move |size| size * of);
        let single = |values: Vec<f64>| values.into_iter().map(|a| [a, 0.0]).collect();
        let double = |places: Vec<f64>, widths: &'static [f64]| {
            let both = places.into_iter().flat_map(|at| sizes(widths, range).map(move |width| [at, width]));
            both.collect()
        };
        match form {
            // It is not a curve: see the screen of resonances.
            Form::Resonance => Vec::new(),
            Form::Constant if self.argument != OF_CONSTANT => Vec::new(),
            Form::Constant | Form::Linear | Form::Quadratic => vec![[0.0; MAX_FORM_PARAMETERS]],
            Form::HingeAbove | Form::HingeBelow => single(places(40).collect()),
            Form::Decay | Form::Growth | Form::Tanh => {
                single(sizes(&[0.02, 0.04, 0.08, 0.15, 0.3, 0.6, 1.2], most).collect())
            }
            Form::Window | Form::Deadband => {
                single(sizes(&[0.03, 0.06, 0.1, 0.15, 0.2, 0.3, 0.4, 0.55, 0.7, 0.85], most).collect())
            }
            Form::Staircase => single((3..16).map(|steps| range / f64::from(steps)).collect()),
            Form::Step => double(places(48).collect(), &[0.005, 0.05]),
            Form::Ramp => double(places(16).collect(), &[0.05, 0.1, 0.2, 0.4, 0.7]),
            Form::Bump => double(places(32).collect(), &[0.02, 0.04, 0.08, 0.15, 0.3]),
            Form::Sine => {
                // A quarter of a wave over the whole range from one to the next: a refit finds the wavelength from there.
                let waves = (4..66).map(|quarters| 4.0 * range / f64::from(quarters));
                waves.flat_map(|wave| (0..8).map(move |j| [low + wave * f64::from(j) / 16.0, wave])).collect()
            }
        }
    }
}
