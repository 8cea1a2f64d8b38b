//! Published figures that a comparison is held against.

use mr_damper_model::compare::{Class, Predictor};

/// RSSE in newtons and ESR, as published.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Figures {
    /// Root mean squared error, N.
    pub rsse_n: f64,
    /// Error power over force variance.
    pub esr: f64,
}

/// What was published of one model that was trained on one experiment.
#[derive(Debug, Clone, PartialEq)]
pub struct PublishedRow {
    /// Name of the model, as in this program.
    pub model: String,
    /// How the drive enters it.
    pub form: String,
    /// How it was used.
    pub predictor: Predictor,
    /// The experiment.
    pub experiment: String,
    /// On the run that it was trained on (thesis tables 4.1 to 4.7).
    pub identification: Option<Figures>,
    /// Mean over all other runs (thesis tables 5.1 and 5.2).
    pub cross_validation: Option<Figures>,
}

/// All published figures.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Published {
    /// One row for each model and training experiment.
    pub rows: Vec<PublishedRow>,
}

impl Published {
    /// The row of `class` trained on `experiment`.
    #[must_use]
    pub fn row(&self, class: &Class, experiment: &str) -> Option<&PublishedRow> {
        self.of(class).find(|row| row.experiment == experiment)
    }

    /// The least mean ESR over training experiments, with the experiment: the figure that the thesis ranks its
    /// models by (section 5.1).
    #[must_use]
    pub fn best(&self, class: &Class) -> Option<(&str, f64)> {
        let all = self.of(class).filter_map(|row| Some((row.experiment.as_str(), row.cross_validation?.esr)));
        all.min_by(|a, b| a.1.total_cmp(&b.1))
    }

    fn of(&self, class: &Class) -> impl Iterator<Item = &PublishedRow> {
        let same = move |row: &&PublishedRow| {
            row.model == class.model && row.form == class.form && row.predictor == class.predictor
        };
        self.rows.iter().filter(same)
    }
}
