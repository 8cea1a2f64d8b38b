//! Published figures to compare with.

use mr_damper_model::compare::{Class, Predictor};
use mr_damper_model::identify::Form;
use mr_damper_model::preset::{EXPERIMENTS, published};
use mr_damper_model::units::N_PER_LBF;

/// Models of the thesis, and the predictor with which their published figures were made.
const THESIS: [(&str, Predictor); 5] = [
    ("arx", Predictor::OneStep),
    ("sp", Predictor::FreeRun),
    ("p", Predictor::SameInstant),
    ("anfis", Predictor::FreeRun),
    ("fuzzy-tanh", Predictor::FreeRun),
];

/// Published RMSE (RSSE in the thesis) and NMSE (ESR in the thesis).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Figures {
    /// Root mean squared error, N.
    pub rsse_n: f64,
    /// Mean squared error over the variance of the measured force.
    pub esr: f64,
}

/// Published figures of one model trained on one experiment.
#[derive(Debug, Clone, PartialEq)]
pub struct PublishedRow {
    /// Name of the model, as in this program.
    pub model: String,
    /// How the drive enters it.
    pub form: String,
    /// How it was used.
    pub predictor: Predictor,
    /// The training experiment.
    pub experiment: String,
    /// Figures on the training run (thesis tables 4.1 to 4.7).
    pub identification: Option<Figures>,
    /// Mean figures over all other runs (thesis tables 5.1 and 5.2).
    pub cross_validation: Option<Figures>,
}

/// All published figures.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Published {
    /// One row for each model and training experiment.
    pub rows: Vec<PublishedRow>,
}

impl Published {
    /// The figures of the thesis (tables 4.1 to 4.7, 5.1, 5.2).
    #[must_use]
    pub fn thesis() -> Self {
        let figures =
            |found: published::Published| Figures { rsse_n: found.rsse_lbf * N_PER_LBF, esr: found.esr };
        let mut rows = Vec::new();
        for (model, predictor) in THESIS {
            for form in [Form::Passive, Form::SemiActive] {
                rows.extend(EXPERIMENTS.iter().filter_map(|experiment| {
                    let identification = published::identification(model, form, experiment).map(figures);
                    let cross_validation = published::cross_validation(model, form, experiment).map(figures);
                    (identification.is_some() || cross_validation.is_some()).then(|| PublishedRow {
                        model: model.to_owned(),
                        form: form.name().to_owned(),
                        predictor,
                        experiment: experiment.to_uppercase(),
                        identification,
                        cross_validation,
                    })
                }));
            }
        }
        Self { rows }
    }

    /// True when there are published figures for `experiment`.
    #[must_use]
    pub fn knows(&self, experiment: &str) -> bool {
        self.rows.iter().any(|row| row.experiment == experiment)
    }

    /// The row of `class` trained on `experiment`.
    #[must_use]
    pub fn row(&self, class: &Class, experiment: &str) -> Option<&PublishedRow> {
        self.of(class).find(|row| row.experiment == experiment)
    }

    /// The training experiment with the lowest mean NMSE, and that NMSE. The thesis ranks its models by it (section 5.1).
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_thesis_ranks_its_models_as_section_5_1_says() {
        let thesis = Published::thesis();
        let best = |model: &str, predictor| {
            let class = Class { predictor, model: model.to_owned(), form: "semi_active".to_owned() };
            thesis.best(&class).expect("a figure")
        };
        assert_eq!(best("arx", Predictor::OneStep).1, 0.0163);
        assert_eq!(best("p", Predictor::SameInstant), ("RP-ICPS", 0.0723));
        assert_eq!(best("sp", Predictor::FreeRun), ("RP-ICPS-L", 0.0771));
        assert_eq!(best("anfis", Predictor::FreeRun), ("RP1-CS", 0.0864));
        assert_eq!(best("fuzzy-tanh", Predictor::FreeRun), ("RP3-CS", 0.0993));
        assert!(thesis.knows("RP-ICPS") && !thesis.knows("sine"));
    }
}
