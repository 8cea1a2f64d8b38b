//! Diagnoses that are started from the page: asks a running damper's node (action `close_loop`) and keeps the report.

use super::folder::Folder;
use super::refusal::{Kind, Refusal};
use super::state::{Closing, Course};
use super::{Workshop, guarded};
use crate::closing::asking;
use crate::config::{Config, RosArgs};
use crate::error::NodeError;
use crate::interrupt::Interrupt;
use crate::provenance;
use crate::report::answered::Answered;
use std::sync::{Arc, PoisonError};

/// Name of the ROS node that asks; a number is appended, so that several diagnoses can run at the same time.
const NODE: &str = "mr_damper_serve_close";

/// How to reach a damper's node.
struct Asked {
    config: Config,
    args: RosArgs,
}

impl Workshop {
    /// Asks the node of the damper named `damper` for a diagnosis of its last `history_s` seconds, or of its whole history.
    ///
    /// # Errors
    /// When the damper cannot be asked, or a diagnosis of it is already running here.
    pub fn start_closing(self: &Arc<Self>, damper: &str, history_s: Option<f64>) -> Result<String, Refusal> {
        let history_s = history_s.unwrap_or(asking::ALL_S);
        if !(history_s > 0.0 && history_s.is_finite()) {
            let says = format!("history_s is {history_s}, but must be a positive number of seconds");
            return Err(Refusal::new(Kind::Wrong, says));
        }
        let asked = self.node_of(damper)?;
        let id = self.next_id();
        let begun = Closing {
            id,
            state: Course::Working,
            says: "asking the node".to_owned(),
            progress: 0.0,
            report: None,
            found: None,
        };
        self.change(|state| {
            if state.closings.get(damper).is_some_and(|closing| closing.state.is_under_way()) {
                let says = format!("a diagnosis of {damper} is under way; wait for it, or cancel it");
                return Err(Refusal::new(Kind::Busy, says));
            }
            state.closings.insert(damper.to_owned(), begun);
            Ok(())
        })?;
        let (shop, damper) = (Arc::clone(self), damper.to_owned());
        let name = damper.clone();
        let begun = self.work(format!("workshop-closing-{id}"), move |interrupt| {
            let found = guarded(|| shop.ask(&damper, id, &asked, history_s, interrupt));
            shop.end_closing(&damper, id, found);
        });
        begun.inspect_err(|_| self.change(|state| drop(state.closings.remove(&name))))?;
        Ok(format!("asked the node of {name} for a diagnosis"))
    }

    /// Cancels the diagnosis of the damper named `damper`.
    ///
    /// # Errors
    /// When no diagnosis of it is running.
    pub fn cancel_closing(&self, damper: &str) -> Result<String, Refusal> {
        let id = self.change(|state| match state.closings.get_mut(damper) {
            Some(closing) if closing.state.is_under_way() => {
                closing.state = Course::Cancelling;
                closing.says = "being cancelled".to_owned();
                Ok(closing.id)
            }
            _ => Err(Refusal::new(Kind::Missing, format!("no diagnosis of {damper} is under way"))),
        })?;
        let works = self.works.lock().unwrap_or_else(PoisonError::into_inner);
        let name = format!("workshop-closing-{id}");
        works.iter().filter(|work| work.name == name).for_each(|work| work.interrupt.raise());
        Ok(format!("the diagnosis of {damper} is being cancelled"))
    }

    /// How to reach the node of the damper named `damper`.
    fn node_of(&self, damper: &str) -> Result<Asked, Refusal> {
        if let Some(namespace) = self.own_namespace(damper) {
            return Ok(Asked { config: self.own_config(), args: RosArgs::in_namespace(&namespace) });
        }
        if let Some(why) = &self.state().no_closing {
            return Err(Refusal::new(Kind::Wrong, why.clone()));
        }
        let askable = self.askable.lock().unwrap_or_else(PoisonError::into_inner);
        let namespace = askable
            .get(damper)
            .ok_or_else(|| Refusal::new(Kind::Missing, format!("no damper named {damper} is watched")))?;
        let config = Config { domain_id: self.domain_id, ..Config::default() };
        let mut args = self.ros_args.below(namespace);
        // A node name that was given on the command line belongs to the watching node.
        args.node = None;
        Ok(Asked { config, args })
    }

    /// Asks the node, and keeps its report.
    fn ask(
        &self,
        damper: &str,
        id: u64,
        asked: &Asked,
        history_s: f64,
        interrupt: &Interrupt,
    ) -> Result<(String, Answered), NodeError> {
        let Asked { config, args } = asked;
        let say = |stage: &str, progress: f32| {
            self.change_closing(damper, id, |closing| {
                // Ignore stages after the diagnosis was cancelled.
                if closing.state == Course::Working {
                    (closing.says, closing.progress) = (stage.to_owned(), progress);
                }
            });
        };
        let report = asking::ask(config, args, &format!("{NODE}_{id}"), history_s, interrupt, &say)?;
        let found = Answered::of(&report, asking::load_line(&report, args, config))?;
        let page = keep(&self.folder, damper, &report, &found)?;
        Ok((page, found))
    }

    fn end_closing(&self, damper: &str, id: u64, found: Result<(String, Answered), NodeError>) {
        // The diagnosis may have written a model file into the models directory.
        self.look_for_models();
        let reports = self.folder.reports();
        self.change(|state| {
            state.reports = reports.unwrap_or_else(|error| {
                tracing::warn!("{error}");
                std::mem::take(&mut state.reports)
            });
            let Some(closing) = state.closings.get_mut(damper).filter(|closing| closing.id == id) else {
                return;
            };
            match found {
                Ok((page, found)) => {
                    closing.state = Course::Done;
                    closing.says = found.says.clone();
                    closing.progress = 1.0;
                    closing.report = Some(page);
                    closing.found = Some(Box::new(found));
                }
                Err(NodeError::Interrupted) => {
                    closing.state = Course::Cancelled;
                    closing.says = "cancelled; nothing was changed".to_owned();
                }
                Err(error) => {
                    closing.state = Course::Failed;
                    closing.says = error.to_string();
                }
            }
        });
    }

    fn change_closing(&self, damper: &str, id: u64, how: impl FnOnce(&mut Closing)) {
        self.change(|state| {
            if let Some(closing) = state.closings.get_mut(damper).filter(|closing| closing.id == id) {
                how(closing);
            }
        });
    }
}

/// Writes `report` on the damper named `damper` as JSON and `found` as a page; returns the page's name.
fn keep(
    folder: &Folder,
    damper: &str,
    report: &serde_json::Value,
    found: &Answered,
) -> Result<String, NodeError> {
    let date = provenance::date();
    let stamp: String = date.chars().filter(|c| !"-:".contains(*c)).collect();
    folder.write_report(damper, &stamp, &format!("{report:#}\n"), &found.html(damper, &date))
}
