//! Diagnoses that are started from the page: asks a running damper's node (action `close_loop`) and keeps the report.

use super::folder::Folder;
use super::{Workshop, catch_panic};
use crate::ros2::close_loop_client;
use crate::settings::config::{Config, RosArgs};
use crate::settings::error::NodeError;
use crate::settings::interrupt::Interrupt;
use mr_damper_base::provenance;
use mr_damper_reports::diagnosis_summary::DiagnosisSummary;
use mr_damper_views::workshop::{Diagnosis, DiagnosisStatus, Refusal, RefusalKind};
use std::sync::{Arc, PoisonError};

/// Name of the ROS node that asks; a number is appended, so that several diagnoses can run at the same time.
const NODE: &str = "mr_damper_serve_close";

/// How to reach a damper's node.
struct NodeAddress {
    config: Config,
    args: RosArgs,
}

impl Workshop {
    /// Asks the node of the damper named `damper` for a diagnosis of its last `history_s` seconds, or of its whole history.
    ///
    /// # Errors
    /// When the damper cannot be asked, or a diagnosis of it is already running here.
    pub fn start_diagnosis(
        self: &Arc<Self>,
        damper: &str,
        history_s: Option<f64>,
    ) -> Result<String, Refusal> {
        let history_s = history_s.unwrap_or(close_loop_client::ALL_S);
        if !(history_s > 0.0 && history_s.is_finite()) {
            let says = format!("history_s is {history_s}, but must be a positive number of seconds");
            return Err(Refusal::new(RefusalKind::Wrong, says));
        }
        let address = self.address_of(damper)?;
        let id = self.next_id();
        let begun = Diagnosis {
            id,
            state: DiagnosisStatus::Working,
            says: "asking the node".to_owned(),
            progress: 0.0,
            report: None,
            found: None,
        };
        self.change(|state| {
            if state.closings.get(damper).is_some_and(|diagnosis| diagnosis.state.is_under_way()) {
                let says = format!("a diagnosis of {damper} is under way; wait for it, or cancel it");
                return Err(Refusal::new(RefusalKind::Busy, says));
            }
            state.closings.insert(damper.to_owned(), begun);
            Ok(())
        })?;
        let (workshop, damper) = (Arc::clone(self), damper.to_owned());
        let name = damper.clone();
        let begun = self.spawn(format!("workshop-diagnosis-{id}"), move |interrupt| {
            let found = catch_panic(|| workshop.ask_node(&damper, id, &address, history_s, interrupt));
            workshop.end_diagnosis(&damper, id, found);
        });
        begun.inspect_err(|_| self.change(|state| drop(state.closings.remove(&name))))?;
        Ok(format!("asked the node of {name} for a diagnosis"))
    }

    /// Cancels the diagnosis of the damper named `damper`.
    ///
    /// # Errors
    /// When no diagnosis of it is running.
    pub fn cancel_diagnosis(&self, damper: &str) -> Result<String, Refusal> {
        let id = self.change(|state| match state.closings.get_mut(damper) {
            Some(diagnosis) if diagnosis.state.is_under_way() => {
                diagnosis.state = DiagnosisStatus::Cancelling;
                diagnosis.says = "being cancelled".to_owned();
                Ok(diagnosis.id)
            }
            _ => Err(Refusal::new(RefusalKind::Missing, format!("no diagnosis of {damper} is under way"))),
        })?;
        let threads = self.threads.lock().unwrap_or_else(PoisonError::into_inner);
        let name = format!("workshop-diagnosis-{id}");
        threads.iter().filter(|thread| thread.name == name).for_each(|thread| thread.interrupt.raise());
        Ok(format!("the diagnosis of {damper} is being cancelled"))
    }

    /// How to reach the node of the damper named `damper`.
    fn address_of(&self, damper: &str) -> Result<NodeAddress, Refusal> {
        if let Some(namespace) = self.own_namespace(damper) {
            return Ok(NodeAddress { config: self.own_config(), args: RosArgs::in_namespace(&namespace) });
        }
        if let Some(why) = &self.state().no_closing {
            return Err(Refusal::new(RefusalKind::Wrong, why.clone()));
        }
        let diagnosable = self.diagnosable.lock().unwrap_or_else(PoisonError::into_inner);
        let namespace = diagnosable.get(damper).ok_or_else(|| {
            Refusal::new(RefusalKind::Missing, format!("no damper named {damper} is watched"))
        })?;
        let config = Config { domain_id: self.domain_id, ..Config::default() };
        let mut args = self.ros_args.below(namespace);
        // A node name that was given on the command line belongs to the watching node.
        args.node = None;
        Ok(NodeAddress { config, args })
    }

    /// Asks the node, and keeps its report.
    fn ask_node(
        &self,
        damper: &str,
        id: u64,
        address: &NodeAddress,
        history_s: f64,
        interrupt: &Interrupt,
    ) -> Result<(String, DiagnosisSummary), NodeError> {
        let NodeAddress { config, args } = address;
        let say = |stage: &str, progress: f32| {
            self.change_diagnosis(damper, id, |diagnosis| {
                // Ignore stages after the diagnosis was cancelled.
                if diagnosis.state == DiagnosisStatus::Working {
                    (diagnosis.says, diagnosis.progress) = (stage.to_owned(), progress);
                }
            });
        };
        let report =
            close_loop_client::diagnose(config, args, &format!("{NODE}_{id}"), history_s, interrupt, &say)?;
        let found = DiagnosisSummary::of(&report, close_loop_client::load_line(&report, args, config))?;
        let page = keep(&self.folder, damper, &report, &found)?;
        Ok((page, found))
    }

    fn end_diagnosis(&self, damper: &str, id: u64, found: Result<(String, DiagnosisSummary), NodeError>) {
        // The diagnosis may have written a model file into the models directory.
        self.look_for_models();
        let reports = self.folder.reports();
        self.change(|state| {
            state.reports = reports.unwrap_or_else(|error| {
                tracing::warn!("{error}");
                std::mem::take(&mut state.reports)
            });
            let Some(diagnosis) = state.closings.get_mut(damper).filter(|diagnosis| diagnosis.id == id)
            else {
                return;
            };
            match found {
                Ok((page, found)) => {
                    diagnosis.state = DiagnosisStatus::Done;
                    diagnosis.says = found.says.clone();
                    diagnosis.progress = 1.0;
                    diagnosis.report = Some(page);
                    diagnosis.found = Some(Box::new(found));
                }
                Err(NodeError::Interrupted) => {
                    diagnosis.state = DiagnosisStatus::Cancelled;
                    diagnosis.says = "cancelled; nothing was changed".to_owned();
                }
                Err(error) => {
                    diagnosis.state = DiagnosisStatus::Failed;
                    diagnosis.says = error.to_string();
                }
            }
        });
    }

    fn change_diagnosis(&self, damper: &str, id: u64, how: impl FnOnce(&mut Diagnosis)) {
        self.change(|state| {
            if let Some(diagnosis) = state.closings.get_mut(damper).filter(|diagnosis| diagnosis.id == id) {
                how(diagnosis);
            }
        });
    }
}

/// Writes `report` on the damper named `damper` as JSON and `found` as a page; returns the page's name.
fn keep(
    folder: &Folder,
    damper: &str,
    report: &serde_json::Value,
    found: &DiagnosisSummary,
) -> Result<String, NodeError> {
    let date = provenance::date();
    let stamp: String = date.chars().filter(|c| !"-:".contains(*c)).collect();
    folder.write_report(damper, &stamp, &format!("{report:#}\n"), &found.html(damper, &date))
}
