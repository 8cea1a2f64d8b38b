//! The thresholds by which a diagnosis decides, in one table.
//!
//! Each has a default, what it decides, and the source of the default. `model/examples/threshold_sensitivity.rs` diagnoses generated
//! runs with each threshold at half and at double, and the guide shows what changes. Constants of numerical methods, and conditions that
//! runs must meet before they are diagnosed, stay beside their code.

/// The part of a diagnosis that uses a threshold.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// The choice of an effect of the library.
    Effects,
    /// The verdict, and what is said about the error that remains.
    Verdict,
    /// The choice of a structure for the base, and of the effects that hold under the others.
    Structures,
    /// Runs that are compared with references.
    Pairs,
    /// Terms that are discovered in what the effects leave.
    Terms,
}

/// The quantity that is halved and doubled when the sensitivity to a threshold is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scaled {
    /// The value.
    Value,
    /// The distance below one, for a share close to one.
    BelowOne,
    /// The distance above one, for a ratio close to one.
    AboveOne,
}

/// One threshold of [`Thresholds::TABLE`].
///
/// ```
/// use mr_damper_model::diagnose::Thresholds;
///
/// let row = Thresholds::TABLE.iter().find(|row| row.name == "least_share").expect("a threshold");
/// let mut thresholds = Thresholds::default();
/// row.set(&mut thresholds, row.scaled(2.0));
/// assert_eq!((row.default, thresholds.least_share), (0.1, 0.2));
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Threshold {
    /// Name of its field in [`Thresholds`].
    pub name: &'static str,
    /// The part of a diagnosis that uses it.
    pub part: Part,
    /// The default, dimensionless unless the name ends in a unit.
    pub default: f64,
    /// The quantity that a factor multiplies.
    pub scaled: Scaled,
    /// Where the default comes from.
    pub source: &'static str,
    /// The documentation of its field.
    text: &'static str,
    set: fn(&mut Thresholds, f64),
}

impl Threshold {
    /// The meaning of the field, as one sentence without a full stop.
    #[must_use]
    pub fn meaning(&self) -> &'static str {
        let text = self.text.trim();
        text.split_once(". ").map_or(text.trim_end_matches('.'), |(first, _)| first)
    }

    /// Sets this threshold of `thresholds` to `value`.
    pub fn set(&self, thresholds: &mut Thresholds, value: f64) {
        (self.set)(thresholds, value);
    }

    /// The default changed by `factor`, which applies to the value or to its distance from one.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> f64 {
        match self.scaled {
            Scaled::Value => factor * self.default,
            Scaled::BelowOne => 1.0 - factor * (1.0 - self.default),
            Scaled::AboveOne => 1.0 + factor * (self.default - 1.0),
        }
    }
}

macro_rules! thresholds {
    ($($(#[doc = $doc:literal])+ $name:ident = $default:literal, $part:ident, $scaled:ident, $source:literal;)+) => {
        /// The thresholds by which a diagnosis decides. Shares are of squared errors unless said otherwise.
        ///
        /// The published rates hold for the defaults. Change a threshold to measure what it does.
        #[derive(Debug, Clone, Copy, PartialEq)]
        pub struct Thresholds {
            $($(#[doc = $doc])+ pub $name: f64,)+
        }

        impl Default for Thresholds {
            fn default() -> Self {
                Self { $($name: $default,)+ }
            }
        }

        impl Thresholds {
            /// All thresholds with their defaults and sources, by part.
            pub const TABLE: &[Threshold] = &[$(Threshold {
                name: stringify!($name),
                part: Part::$part,
                default: $default,
                scaled: Scaled::$scaled,
                source: $source,
                text: concat!($($doc),+),
                set: |thresholds, value| thresholds.$name = value,
            },)+];
        }
    };
}

thresholds! {
    /// Least share of the reducible error that a score must predict to remove before the candidate is refitted. It is low because a lag
    /// is far from linear: it may remove several times what its score predicts.
    worth_a_refit = 0.03, Effects, Value, "chosen for time";
    /// Least share of the reducible error after the short refit that ranks candidates; below it the complete refit is not worth the time.
    hopeless = 0.07, Effects, Value, "chosen for time";
    /// Least share of the reducible error that an effect must remove.
    least_share = 0.1, Effects, Value, "chosen: a smaller part of the error does not matter to a user";
    /// Least share of the squared error on the validation runs that an effect must remove.
    least_confirmed = 0.02, Effects, Value, "chosen";
    /// Least change of the force by an effect, once the base has adapted to it, as a share of the force (standard deviations). A base is
    /// never exactly of the damper's structure, and what it cannot follow looks like a small effect. Friction of 80 N beside a base of the
    /// right structure changes the force by 0.17 to 0.4 %, so the limit does not apply to a base that the user fixes. It does not apply to
    /// effects that follow time or temperature either.
    least_of_force = 0.004, Structures, Value,
        "measured on dampers with bristles under the Bouc-Wen law: effects that were not there 0.0015 to 0.0027, those that were 0.0055 or more";
    /// Least share of the base's reducible error that an effect must remove: the base's own misfit around a large effect is of this size.
    /// If less than this remains, no further effect is searched for.
    least_of_base = 0.001, Effects, Value, "chosen";
    /// Least share of the base's reducible error that an effect must remove if structures are compared and the effect does not follow time.
    /// Beside a large effect, a base that is not of the damper's structure shows small ones that are not there.
    least_beside = 0.015, Structures, Value,
        "measured on dampers with bristles and a velocity saturation: inertia that was not there 0.007 to 0.012, effects that were 0.018 or more";
    /// Least share of the base's reducible error that an effect must remove in paired mode, where the change that an effect makes to the
    /// base has the base's own errors.
    least_beside_in_pairs = 0.05, Pairs, Value,
        "measured beside a dead zone: 0.04 to 0.06 for effects that were not there; the warm gas of a real damper 0.07";
    /// A validation run counts as worse if its squared error grows by more than this share of itself and by more than
    /// `matters`. Both are needed because a refit of the base changes the small error of runs in which the effect plays no
    /// part, up or down.
    worse_run = 0.05, Effects, Value, "chosen";
    /// Growth of one run's squared error that matters, as a share of what is saved on all validation runs.
    matters = 0.05, Effects, Value, "chosen";
    /// A candidate that removes at least this share of what the best one removes is in the same class.
    same_class = 0.9, Effects, BelowOne, "chosen";
    /// The data cannot separate effects whose scores are correlated by at least this much.
    alike_scores = 0.95, Effects, BelowOne, "computed: at 0.95 a tenth of a score's power is its own";
    /// Least share of a score that must remain after projection; below it the base can absorb the whole effect.
    least_identifiable = 0.01, Effects, Value, "chosen";
    /// Least drop for a refinement of an effect, as a share: of the reducible error on the training runs, and of the squared error on the
    /// validation runs.
    least_refinement = 0.02, Effects, Value, "as least_confirmed";
    /// Times that an effect may take up the energy that the residual has, on a cyclic motion.
    energy_ratio = 2.0, Effects, Value, "chosen";
    /// Share of the energy that an effect moves to and fro below which it takes up none: a spring or a mass, up to the error of the
    /// velocity.
    energy_neutral = 0.1, Effects, Value, "computed: a spring and a velocity that is late by 1 % of a period give 0.099";

    /// Lack of fit below which there is nothing to explain.
    nothing_left = 0.1, Verdict, Value, "chosen";
    /// Largest share of the reducible error that may remain for the verdict "explained".
    little_left = 0.2, Verdict, Value, "chosen: a meaning of the word";
    /// Lack of fit above which the base may be inadequate.
    lack_of_fit = 0.5, Verdict, Value, "chosen: more than half of the error is not noise";
    /// If no effect was named, the base is inadequate when the alternative structure removes more than this share of its reducible error.
    alternative_removes = 0.5, Verdict, Value, "chosen: a meaning of the word";
    /// Share of the change since the references that the effects found must account for in paired mode. The base's own error cancels there,
    /// so the rest is another change.
    most_of_change = 0.5, Pairs, Value, "chosen: a meaning of the word";
    /// An estimated noise floor whose square is this many times the mean square of a model's residual is wrong: the residual contains the
    /// noise.
    floor_contradicted = 1.2, Verdict, AboveOne, "chosen";
    /// Least correlation of the remaining error with a measured signal that is reported.
    least_correlation = 0.05, Verdict, Value, "chosen";
    /// Largest probability that a reported correlation is chance, corrected for the number of signals.
    correlation_p = 0.05, Verdict, Value, "chosen: the level of the test";

    /// A structure fits worse than the best one if the ratio of their squared errors is below this and its interval is below one.
    about_as_well = 0.9, Structures, BelowOne, "chosen: as same_class";
    /// `about_as_well` where the validation runs are too short for an interval.
    about_as_well_unproved = 0.8, Structures, BelowOne, "chosen: about_as_well with a margin for chance";
    /// A structure is not searched further if the squared error of another one, a round earlier, is below this share of its own.
    surpassed = 0.1, Structures, Value, "chosen for time";
    /// A structure is far behind if the least squared error is below this share of its own with the effects that the rounds found. The checks of these effects, which
    /// follow, change the error by much less.
    far_behind = 0.5, Structures, Value, "chosen for time";
    /// Parameters of an effect under two structures are the same if they differ by less than this share, or if their intervals overlap.
    same_parameter = 0.25, Structures, Value, "chosen";

    /// Least mean difference of the case's temperature between a run and its reference for effects of temperature to act on it, K.
    least_contrast_k = 5.0, Pairs, Value, "chosen";

    /// Rivals of the best term: those whose squared error is at most this many times the least.
    term_rival = 3.0, Terms, Value, "chosen for time";
    /// Largest probability of an accepted term by chance.
    term_p = 0.01, Terms, Value, "chosen: the level of the test";
    /// Least share of the squared error on the validation runs that an accepted term removes.
    term_least_share = 0.05, Terms, Value, "chosen";
    /// `term_least_share` without the space of structures, which is not in the model.
    term_least_raw_share = 0.02, Terms, Value, "as least_confirmed";
    /// Terms whose squared error on the validation runs is within this share of the least one are alike.
    term_alike = 0.03, Terms, Value, "chosen";
    /// A term takes the place of an effect of the library if it removes at least this share of the squared error that the effect leaves on the validation runs.
    term_surpasses = 0.5, Terms, Value,
        "measured: an end stop and a friction that were there lost their names at 0.1 and without this condition";
    /// The search for a term in place of an effect ends if the best one, with everything else as it is, leaves more than this many times the squared
    /// error that it must reach on the validation runs.
    term_far = 2.0, Terms, Value, "chosen for time";
    /// Closed forms of a pair whose scores are within this share of the best one are alike. A simpler form of a term may lose this share of its
    /// gain.
    form_alike = 0.02, Terms, Value, "chosen";
    /// Share of the gain that each number of a term costs when terms are compared.
    cost_of_number = 0.008, Terms, Value, "chosen";
    /// Ratio of a term's amount on healthy runs to its own up to which it is an effect.
    effect_on_healthy = 0.2, Terms, Value, "chosen";
    /// Least ratio of a term's amount on healthy runs to its own for a part of the damper's own structure.
    structure_on_healthy = 0.5, Terms, Value, "chosen: a meaning of the word";
    /// Largest probability of a hum of the mains or a machine by chance.
    hum_p = 0.01, Terms, Value, "as term_p";
    /// Least share of the squared error on the validation runs of a hum.
    hum_least_share = 0.05, Terms, Value, "as term_least_share";
    /// Largest ratio of the power of the simulated force to its median near a hum's frequency.
    hum_in_force = 12.0, Terms, Value, "computed: noise alone exceeds it at one of 4096 frequencies";
}
