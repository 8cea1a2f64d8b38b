//! Converts the memberships of a TSK model to a list of free parameters, and back.
//!
//! - Gaussians: centre and ln sigma of each set, 2 n parameters per input. The logarithm is used because the
//!   width is positive, so that steps are ratios.
//! - Generalised bells: ln half width, ln exponent and centre of each set, 3 n parameters per input.
//! - Triangles: their feet are the neighbours' peaks, and they span the range of the data, so that n - 2
//!   parameters per input are free: the logarithms of the gaps between peaks, relative to the first gap.
//!   Peaks stay in order for any parameters.

use crate::error::{Error, IdentifyError};
use crate::force::{Shape, Signal, TskInput, TskSet};

/// Largest distance of a centre from its place in the uniform grid, in spacings of the grid.
const ROAM: f64 = 0.5;
/// Largest factor between a width and the uniform grid's width, either way.
const STRETCH: f64 = 2.0;
/// Largest factor between the gaps of peaks.
const GAP_RATIO: f64 = 20.0;
/// Ratio of sigma to spacing at which Gaussians of a uniform grid cross at one half: 1 / (2 sqrt(2 ln 2)).
const CROSS_AT_HALF: f64 = 0.424_660_900_144_009_5;

/// Ratio of half width to spacing at which bells of a uniform grid cross at one half, as in MATLAB's genfis1.
const HALF_SPACING: f64 = 0.5;
/// Exponent of the bells of a uniform grid, as in MATLAB's genfis1.
const EXPONENT: f64 = 2.0;

/// A shape whose numbers can be trained.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Trained {
    Gaussian,
    Triangle,
    Bell,
}

impl Trained {
    /// `shape`, for a model called `model`.
    ///
    /// # Errors
    /// [`IdentifyError::UntrainedShape`] for trapezoids and two-sided Gaussians.
    pub(super) fn of(shape: Shape, model: &'static str) -> Result<Self, Error> {
        match shape {
            Shape::Gaussian => Ok(Self::Gaussian),
            Shape::Triangle => Ok(Self::Triangle),
            Shape::Bell => Ok(Self::Bell),
            Shape::Trapezoid | Shape::TwoSidedGaussian => {
                Err(IdentifyError::UntrainedShape { model, shape: shape.name() }.into())
            }
        }
    }

    /// True if most rules have zero weight for memberships of this shape.
    pub(super) const fn is_sparse(self) -> bool {
        matches!(self, Self::Triangle)
    }
}

/// One input without its memberships.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Axis {
    pub(super) signal: Signal,
    pub(super) mean: f64,
    pub(super) std_dev: f64,
    /// Range of the normalised data.
    pub(super) range: [f64; 2],
    /// Number of sets.
    pub(super) sets: usize,
}

/// All inputs.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Premises {
    pub(super) axes: Vec<Axis>,
    pub(super) shape: Trained,
}

/// One term of the derivative of a set's number with respect to a parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Link {
    pub(super) parameter: usize,
    pub(super) input: usize,
    pub(super) set: usize,
    pub(super) number: usize,
    pub(super) factor: f64,
}

impl Axis {
    fn spacing(&self) -> f64 {
        (self.range[1] - self.range[0]) / (self.sets.max(2) - 1) as f64
    }

    /// Number of free parameters of this input.
    fn free(&self, shape: Trained) -> usize {
        match shape {
            _ if self.sets == 1 => 0,
            Trained::Gaussian => 2 * self.sets,
            Trained::Bell => 3 * self.sets,
            Trained::Triangle => self.sets - 2,
        }
    }

    /// The parameters of this input on the uniform grid, each with its largest change.
    fn grid(&self, shape: Trained) -> Vec<(f64, f64)> {
        let spacing = self.spacing();
        let centre = |j: usize| (self.range[0] + spacing * j as f64, ROAM * spacing);
        let one = |j: usize| match shape {
            Trained::Gaussian => vec![centre(j), ((CROSS_AT_HALF * spacing).ln(), STRETCH.ln())],
            Trained::Bell => {
                vec![((HALF_SPACING * spacing).ln(), STRETCH.ln()), (EXPONENT.ln(), STRETCH.ln()), centre(j)]
            }
            Trained::Triangle => vec![(0.0, GAP_RATIO.ln())],
        };
        let mut grid: Vec<(f64, f64)> = (0..self.sets).flat_map(one).collect();
        grid.truncate(self.free(shape));
        grid
    }

    /// Peaks of triangles, given the logarithms `gaps` of the gaps relative to the first.
    fn peaks(&self, gaps: &[f64]) -> Vec<f64> {
        let gaps: Vec<f64> = std::iter::once(1.0).chain(gaps.iter().map(|g| g.exp())).collect();
        let [low, high] = self.range;
        let total: f64 = gaps.iter().sum();
        let mut reached = 0.0;
        let mut peaks = vec![low];
        for gap in &gaps {
            reached += gap;
            peaks.push(low + (high - low) * reached / total);
        }
        peaks
    }

    /// Memberships of this input for its part of the parameters.
    fn sets(&self, shape: Trained, parameters: &[f64]) -> Vec<TskSet> {
        let middle = f64::midpoint(self.range[0], self.range[1]);
        match shape {
            Trained::Gaussian if self.sets == 1 => {
                vec![TskSet::Gaussian { centre: middle, sigma: self.spacing() }]
            }
            Trained::Gaussian => parameters
                .chunks_exact(2)
                .map(|p| TskSet::Gaussian { centre: p[0], sigma: p[1].exp() })
                .collect(),
            Trained::Bell if self.sets == 1 => {
                vec![TskSet::Bell { half_width: self.spacing(), exponent: EXPONENT, centre: middle }]
            }
            Trained::Bell => parameters
                .chunks_exact(3)
                .map(|p| TskSet::Bell { half_width: p[0].exp(), exponent: p[1].exp(), centre: p[2] })
                .collect(),
            Trained::Triangle if self.sets == 1 => {
                vec![TskSet::Triangle { left: self.range[0], peak: middle, right: self.range[1] }]
            }
            Trained::Triangle => {
                let peaks = self.peaks(parameters);
                let last = peaks.len() - 1;
                // The outer feet of the shoulders have no effect; they mirror the inner feet.
                let foot = |j: usize, before: bool| match (j, before) {
                    (0, true) => 2.0 * peaks[0] - peaks[1],
                    (_, true) => peaks[j - 1],
                    (j, false) if j == last => 2.0 * peaks[last] - peaks[last - 1],
                    (_, false) => peaks[j + 1],
                };
                (0..=last)
                    .map(|j| TskSet::Triangle { left: foot(j, true), peak: peaks[j], right: foot(j, false) })
                    .collect()
            }
        }
    }
}

impl Premises {
    /// The uniform grid over the range of the data, where learning starts.
    pub(super) fn start(&self) -> Vec<f64> {
        self.axes.iter().flat_map(|axis| axis.grid(self.shape)).map(|(at, _)| at).collect()
    }

    /// Bounds of the parameters, which keep the sets near the data and prevent spikes.
    pub(super) fn bounds(&self) -> Vec<[f64; 2]> {
        let bounds = |(at, reach): (f64, f64)| [at - reach, at + reach];
        self.axes.iter().flat_map(|axis| axis.grid(self.shape)).map(bounds).collect()
    }

    /// The inputs with the memberships of `parameters`.
    pub(super) fn inputs(&self, parameters: &[f64]) -> Result<Vec<TskInput>, Error> {
        let mut rest = parameters;
        let one = |axis: &Axis| {
            let (own, others) = rest.split_at(axis.free(self.shape));
            rest = others;
            TskInput::new(axis.signal, axis.mean, axis.std_dev, &axis.sets(self.shape, own))
        };
        self.axes.iter().map(one).collect()
    }

    /// Derivatives of the sets' numbers with respect to the parameters.
    pub(super) fn links(&self, parameters: &[f64]) -> Vec<Link> {
        let mut links = Vec::new();
        let mut first = 0;
        for (input, axis) in self.axes.iter().enumerate() {
            let own = &parameters[first..first + axis.free(self.shape)];
            match self.shape {
                Trained::Gaussian => {
                    for (k, p) in own.iter().enumerate() {
                        let factor = if k % 2 == 0 { 1.0 } else { p.exp() };
                        links.push(Link { parameter: first + k, input, set: k / 2, number: k % 2, factor });
                    }
                }
                Trained::Bell => {
                    for (k, p) in own.iter().enumerate() {
                        let factor = if k % 3 == 2 { 1.0 } else { p.exp() };
                        links.push(Link { parameter: first + k, input, set: k / 3, number: k % 3, factor });
                    }
                }
                Trained::Triangle if !own.is_empty() => triangle_links(axis, input, first, own, &mut links),
                Trained::Triangle => {}
            }
            first += own.len();
        }
        links
    }
}

/// A gap moves all peaks except the two outermost; a peak is also a foot of both neighbours.
fn triangle_links(axis: &Axis, input: usize, first: usize, gaps: &[f64], links: &mut Vec<Link>) {
    let peaks = axis.peaks(gaps);
    let (low, span) = (peaks[0], peaks[peaks.len() - 1] - peaks[0]);
    let total = 1.0 + gaps.iter().map(|g| g.exp()).sum::<f64>();
    for (k, gap) in gaps.iter().enumerate() {
        for (set, peak) in peaks.iter().enumerate().take(peaks.len() - 1).skip(1) {
            // Gap k + 1 lies between peaks k + 1 and k + 2.
            let below = if k + 2 <= set { 1.0 } else { 0.0 };
            let factor = span * gap.exp() / total * (below - (peak - low) / span);
            let parameter = first + k;
            links.push(Link { parameter, input, set, number: 1, factor });
            links.push(Link { parameter, input, set: set + 1, number: 0, factor });
            links.push(Link { parameter, input, set: set - 1, number: 2, factor });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::force::tsk::NUMBERS;

    fn axis(sets: usize) -> Axis {
        Axis { signal: Signal::Velocity, mean: 0.0, std_dev: 1.0, range: [-3.0, 2.0], sets }
    }

    #[test]
    fn links_match_numerical_derivatives_of_the_sets() {
        for (shape, counts) in [
            (Trained::Gaussian, [3, 2]),
            (Trained::Bell, [3, 2]),
            (Trained::Triangle, [5, 4]),
            (Trained::Triangle, [2, 3]),
        ] {
            let second = Axis { signal: Signal::Displacement, ..axis(counts[1]) };
            let premises = Premises { axes: vec![axis(counts[0]), second], shape };
            let at: Vec<f64> =
                premises.start().iter().enumerate().map(|(k, p)| p + 0.1 * (k as f64).sin()).collect();
            assert_eq!(at.len(), premises.bounds().len());
            let numbers = |parameters: &[f64]| -> Vec<Vec<[f64; NUMBERS]>> {
                let inputs = premises.inputs(parameters).expect("in range");
                inputs.iter().map(|input| input.sets().map(|set| set.numbers()).collect()).collect()
            };
            let links = premises.links(&at);
            for parameter in 0..at.len() {
                let step = 1e-6;
                let (mut up, mut down) = (at.clone(), at.clone());
                up[parameter] += step;
                down[parameter] -= step;
                let (up, down) = (numbers(&up), numbers(&down));
                for (input, sets) in up.iter().enumerate() {
                    for (set, n) in sets.iter().enumerate() {
                        for number in 0..NUMBERS {
                            // The outer feet of shoulders are unused and have no links.
                            let outer = (set == 0 && number == 0) || (set + 1 == sets.len() && number == 2);
                            if shape == Trained::Triangle && outer {
                                continue;
                            }
                            let expected = (n[number] - down[input][set][number]) / (2.0 * step);
                            let found: f64 = links
                                .iter()
                                .filter(|l| {
                                    (l.parameter, l.input, l.set, l.number) == (parameter, input, set, number)
                                })
                                .map(|l| l.factor)
                                .sum();
                            assert!(
                                (found - expected).abs() < 1e-6,
                                "{shape:?} {parameter} {input} {set} {number}"
                            );
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn uniform_grid_crosses_at_one_half() {
        for shape in [Trained::Gaussian, Trained::Bell] {
            let premises = Premises { axes: vec![axis(3)], shape };
            let inputs = premises.inputs(&premises.start()).expect("in range");
            let weights = inputs[0].weights(-1.75);
            assert!((weights[0] - weights[1]).abs() < 1e-12);
            let value = match inputs[0].sets().next().expect("a set") {
                TskSet::Gaussian { centre, sigma } => {
                    (-(-1.75_f64 - centre).powi(2) / (2.0 * sigma * sigma)).exp()
                }
                TskSet::Bell { half_width, exponent, centre } => {
                    1.0 / (1.0 + ((-1.75 - centre) / half_width).abs().powf(2.0 * exponent))
                }
                other => panic!("{other:?}"),
            };
            assert!((value - 0.5).abs() < 1e-12, "{shape:?} {value}");
        }
    }

    #[test]
    fn bells_stay_within_their_bounds() {
        let premises = Premises { axes: vec![axis(3)], shape: Trained::Bell };
        let bounds = premises.bounds();
        // Spacing 2.5: half widths 0.625 to 2.5, exponents 1 to 4, centres within 1.25 of -3, -0.5 and 2.
        let expected = [[0.625, 2.5], [1.0, 4.0]];
        for (j, centre) in [-3.0, -0.5, 2.0].into_iter().enumerate() {
            for (k, expected) in expected.iter().enumerate() {
                let found = bounds[3 * j + k].map(f64::exp);
                assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?}");
            }
            assert_eq!(bounds[3 * j + 2], [centre - 1.25, centre + 1.25]);
        }
    }

    #[test]
    fn shapes_without_training_are_refused() {
        for shape in [Shape::Trapezoid, Shape::TwoSidedGaussian] {
            let message = Trained::of(shape, "anfis").expect_err("no training").to_string();
            assert!(message.contains("anfis") && message.contains(shape.name()), "{message}");
        }
    }
}
