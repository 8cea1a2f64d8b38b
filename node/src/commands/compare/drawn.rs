//! A model in a picture, with the way in which it computes force.

use mr_damper_model::force::Phase;
use mr_damper_model::identify::{Dataset, PhaseOptions, Row, Watch, explained_n, identify_phase, walk};
use mr_damper_model::model::Model;
use mr_damper_model::sample::DriveKind;
use std::ops::ControlFlow;

/// A model to draw.
pub(in crate::commands) struct Drawn {
    name: String,
    how: How,
}

/// How the force is computed.
enum How {
    /// From displacement and drive alone.
    Simulated(Box<Model>),
    /// Also from the measured force up to the previous sample.
    OneStep(Box<Model>),
    /// From the measured force of the same instant.
    Explained(Box<Phase>),
}

impl Drawn {
    /// A model in simulation, with the name for the legend.
    pub(in crate::commands) fn simulated(name: String, model: Model) -> Self {
        Self { name, how: How::Simulated(Box::new(model)) }
    }

    /// A model that predicts one step ahead.
    pub(in crate::commands) fn one_step(name: String, model: Model) -> Self {
        Self { name, how: How::OneStep(Box::new(model)) }
    }

    /// A relation that explains measured force.
    pub(in crate::commands) fn explained(name: String, relation: Phase) -> Self {
        Self { name, how: How::Explained(Box::new(relation)) }
    }

    /// The relation p as it is identified on `training`; `None` if it cannot be. A comparison keeps no relation, but its fit is linear and
    /// quick.
    pub(in crate::commands) fn identified_relation(
        name: String,
        training: &Dataset,
        drive: Option<DriveKind>,
        degree: usize,
    ) -> Option<Self> {
        let options = PhaseOptions { drive, degree, ..PhaseOptions::default() };
        let found = identify_phase(std::slice::from_ref(training), &options, &Watch::none()).ok()?;
        Some(Self::explained(name, found.phase))
    }

    /// The name for the legend.
    pub(in crate::commands) fn name(&self) -> &str {
        &self.name
    }

    /// The points that `pick` makes of the rows and their forces in newtons; none if the run does not have the model's drive.
    pub(in crate::commands) fn points(
        &self,
        data: &Dataset,
        mut pick: impl FnMut(&Row, f64) -> Option<(f64, f64)>,
    ) -> Vec<(f64, f64)> {
        let mut points = Vec::new();
        match &self.how {
            How::Simulated(model) | How::OneStep(model) => {
                if model.force.drive().is_none_or(|kind| data.drive == Some(kind)) {
                    let ahead = matches!(self.how, How::OneStep(_));
                    let _ = walk(&model.augmented(), data, |row, predicted| {
                        let force_n = if ahead { predicted.one_step_n } else { predicted.free_run_n };
                        points.extend(pick(row, force_n));
                        ControlFlow::Continue(())
                    });
                }
            }
            How::Explained(relation) => {
                if relation.drive().is_none_or(|kind| data.drive == Some(kind)) {
                    let options = PhaseOptions { drive: relation.drive(), ..PhaseOptions::default() };
                    let forces = explained_n(relation, data, &options);
                    points.extend(forces.iter().filter_map(|(k, force_n)| pick(&data.rows[*k], *force_n)));
                }
            }
        }
        points
    }
}
