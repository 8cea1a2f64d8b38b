//! Inverse fuzzy model `wang-hu`: first-order TSK rules over velocity, acceleration and demanded force.
//!
//! ```text
//! rule r = (j, k, l):  if v is in set j, a in set k, F in set l, then  f_r = p_r v + q_r a + r_r F + s_r
//! i = mean_i + std_dev_i sum_r W_r f_r / sum_r W_r
//! ```
//!
//! Three Gaussian sets over each input give 27 rules of four conclusions: 108 conclusions, 9 centres and 9 widths. All inputs are
//! normalised. This is the direct model `tsk-wang-hu` with force and current exchanged. Wang and Hu exchange force and voltage; the current
//! takes the place of the voltage here.
//!
//! Source: `[wanghu2009]` in the bibliography (node/docs/guide/bibliography.md), section 2.1.4 of the thesis.

use crate::error::Error;
use crate::force::{Order, OutputScale, Signal, Tsk, TskInput, TskKind, TskSet};

/// Number of sets over each input.
const SETS: usize = 3;
/// The inputs.
const SIGNALS: [Signal; 3] = [Signal::Velocity, Signal::Acceleration, Signal::Force];

/// One input: its normalisation in its unit, and its Gaussian sets over the normalised value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FuzzyAxis {
    /// Mean, in the unit of the signal.
    pub mean: f64,
    /// Standard deviation, in the unit of the signal; positive.
    pub std_dev: f64,
    /// Centres of the sets.
    pub centres: [f64; SETS],
    /// Standard deviations of the sets.
    pub sigmas: [f64; SETS],
}

/// Inverse fuzzy rules.
///
/// ```
/// use mr_damper_model::inverse::{FuzzyAxis, InverseFuzzy};
///
/// let axis = |std_dev| FuzzyAxis { mean: 0.0, std_dev, centres: [-1.0, 0.0, 1.0], sigmas: [0.5; 3] };
/// // All 27 rules are i = 0.4 F / 500 N + 1 in units of 2 A, so the sets do not matter.
/// let conclusions = [[0.0, 0.0, 0.4, 1.0]; 27];
/// let model = InverseFuzzy::new([axis(0.1), axis(5.0), axis(500.0)], &conclusions, 0.0, 2.0)?;
/// assert!((model.current_a(0.2, -3.0, 250.0) - 2.0 * (0.4 * 0.5 + 1.0)).abs() < 1e-12);
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InverseFuzzy {
    axes: [FuzzyAxis; 3],
    /// Rules over these axes, whose output is in A.
    rules: Tsk,
}

impl InverseFuzzy {
    /// Number of rules.
    pub const RULES: usize = SETS * SETS * SETS;

    /// Rules over velocity, acceleration and force. A rule's conclusion has the slopes in this order, and then the constant; the sets of
    /// the velocity vary slowest. `mean_a` and `std_dev_a` undo the normalisation of the current.
    ///
    /// # Errors
    /// Names the number that is out of range.
    pub fn new(
        axes: [FuzzyAxis; 3],
        conclusions: &[[f64; 4]; Self::RULES],
        mean_a: f64,
        std_dev_a: f64,
    ) -> Result<Self, Error> {
        Error::check("current_mean_a", mean_a, "finite", |_| true)?;
        Error::check("current_std_dev_a", std_dev_a, "positive and finite", |s| s > 0.0)?;
        let input = |(signal, axis): (Signal, &FuzzyAxis)| {
            let sets = [0, 1, 2].map(|j| TskSet::Gaussian { centre: axis.centres[j], sigma: axis.sigmas[j] });
            TskInput::new(signal, axis.mean, axis.std_dev, &sets)
        };
        let inputs = SIGNALS.into_iter().zip(&axes).map(input).collect::<Result<Vec<_>, _>>()?;
        // The unit of the output is A.
        let output = OutputScale { mean_n: mean_a, std_dev_n: std_dev_a };
        let rules = Tsk::new(TskKind::Anfis, &inputs, Order::First, conclusions.as_flattened(), output, 0.0)?;
        Ok(Self { axes, rules })
    }

    /// The inverse rules that `exchanged` are: rules of `tsk-wang-hu` whose drive is the force and whose force is the current. `None` for
    /// another structure.
    pub(crate) fn of_exchanged(exchanged: &Tsk) -> Result<Option<Self>, Error> {
        let inputs = exchanged.inputs();
        let axes: Vec<FuzzyAxis> = inputs.iter().filter_map(axis).collect();
        let (Ok(axes), Ok(conclusions)) = (axes.try_into(), exchanged.conclusions().as_chunks().0.try_into())
        else {
            return Ok(None);
        };
        let mean_a = exchanged.output().mean_n + exchanged.force_offset_n();
        Self::new(axes, conclusions, mean_a, exchanged.output().std_dev_n).map(Some)
    }

    /// Velocity, acceleration and force.
    #[must_use]
    pub const fn axes(&self) -> [FuzzyAxis; 3] {
        self.axes
    }

    /// The conclusions, rule by rule.
    #[must_use]
    pub fn conclusions(&self) -> &[[f64; 4]] {
        self.rules.conclusions().as_chunks().0
    }

    /// Mean and standard deviation of the current, A.
    #[must_use]
    pub const fn current_scale_a(&self) -> [f64; 2] {
        let output = self.rules.output();
        [output.mean_n, output.std_dev_n]
    }

    /// Number of conclusions, centres and widths.
    #[must_use]
    pub const fn parameter_count(&self) -> usize {
        self.rules.parameter_count()
    }

    /// The current, A, for `force_n` (without the session's offset). Not finite if an input is not finite.
    #[inline]
    #[must_use]
    pub fn current_a(&self, velocity_m_s: f64, acceleration_m_s2: f64, force_n: f64) -> f64 {
        self.rules.output_at(&[velocity_m_s, acceleration_m_s2, force_n])
    }
}

/// `input` as numbers; `None` for other sets than three Gaussians.
fn axis(input: &TskInput) -> Option<FuzzyAxis> {
    let numbers = |set| match set {
        TskSet::Gaussian { centre, sigma } => Some((centre, sigma)),
        _ => None,
    };
    let sets: Option<Vec<(f64, f64)>> = input.sets().map(numbers).collect();
    let [a, b, c] = sets?.try_into().ok()?;
    Some(FuzzyAxis {
        mean: input.mean(),
        std_dev: input.std_dev(),
        centres: [a.0, b.0, c.0],
        sigmas: [a.1, b.1, c.1],
    })
}
