//! Replays a recorded run through a separate node in this process, over real DDS that does not leave this machine.
//!
//! Node, player and watcher use a namespace that belongs to this process only, so played samples do not reach another damper.
//! They stay after the end of the run, because a diagnosis uses the node's history; the next replay, or a stop, ends them.

use super::folder::loader_options;
use super::{Workshop, WorkshopError, catch_panic};
use crate::estimation::models;
use crate::nodes::damper_node::{DamperNode, ThreadsPanicked};
use crate::settings::config::{Config, RosArgs};
use crate::settings::error::NodeError;
use crate::settings::interrupt::Interrupt;
use crate::streams::player::{PlaybackOptions, Played, Player, Rate};
use crate::views::watch::ros_watcher::RosWatcher;
use mr_damper_model::sample::Run;
use mr_damper_reports::evaluate;
use mr_damper_views::workshop::{
    ReadOptions, Refusal, RefusalKind, Replay, ReplayCommand, ReplayStatus, RunFigures, StoredRun,
};
use std::ops::RangeInclusive;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, PoisonError};
use std::thread::ScopedJoinHandle;
use std::time::{Duration, Instant};

/// Speeds at which a run is replayed.
pub const RATES: RangeInclusive<f64> = 0.1..=10.0;

/// Name of the watching node.
const WATCHER: &str = "mr_damper_serve_replay";
/// Time limit for the node to discover its player.
const LISTEN_WITHIN: Duration = Duration::from_secs(10);
/// Interval at which received messages are read.
const LOOK_EVERY: Duration = Duration::from_millis(5);
/// Interval at which the progress is updated.
const REPORT_EVERY: Duration = Duration::from_millis(200);
/// Minimum and maximum length of the node's history (`history.duration_s`), s.
const HISTORY_S: (f64, f64) = (120.0, 3600.0);

/// Handle to a running replay.
#[derive(Debug)]
pub(super) struct ReplayHandle {
    id: u64,
    interrupt: Interrupt,
}

/// The run to replay, and how.
struct ReplayJob {
    id: u64,
    run: String,
    reading: ReadOptions,
    /// The model as in the node's configuration: name of a preset, or path.
    model: String,
    label: String,
    rate: f64,
}

/// A node with its player and its watcher.
struct ReplayNode {
    service: DamperNode,
    player: Player,
    watcher: RosWatcher,
}

impl ReplayNode {
    fn start(config: &Config, args: &RosArgs, label: &str) -> Result<Self, NodeError> {
        let (service, _) = DamperNode::start(config, args, false)?;
        let others = Player::start(config, args, false)
            .and_then(|player| Ok((player, RosWatcher::start_one(config, args, WATCHER, label)?)));
        match others {
            Ok((player, watcher)) => Ok(Self { service, player, watcher }),
            Err(error) => {
                service.stop()?;
                Err(error)
            }
        }
    }

    /// Stops all three in parallel, because Ctrl-C waits for it.
    fn stop(self) -> Result<(), ThreadsPanicked> {
        let Self { service, player, watcher } = self;
        std::thread::scope(|scope| {
            scope.spawn(|| player.stop());
            scope.spawn(|| watcher.stop());
            service.stop()
        })
    }
}

impl Workshop {
    /// Replays the run named `run` with a listed model, at `rate` times the original speed.
    ///
    /// # Errors
    /// When the run or model does not exist, the rate is out of range, or another replay is running.
    pub fn start_replay(self: &Arc<Self>, run: &str, model: &str, rate: f64) -> Result<String, Refusal> {
        check(rate)?;
        // A previous replay that has ended, or is ending, is replaced; its node must leave the namespace first.
        let mut held = self.replay.lock().unwrap_or_else(PoisonError::into_inner);
        let job = self.prepare_replay(run, model, rate)?;
        let before = held.take().map(|before| {
            before.interrupt.raise();
            format!("workshop-replay-{}", before.id)
        });
        let (workshop, id) = (Arc::clone(self), job.id);
        let begun = self.spawn(format!("workshop-replay-{id}"), move |interrupt| {
            if let Some(before) = before {
                workshop.await_end(&before, interrupt);
            }
            let ended = catch_panic(|| workshop.play(&job, interrupt));
            workshop.registry.lock().remove(&job.label);
            if let Err(error) = ended {
                workshop.change_replay(id, |replay| {
                    (replay.state, replay.says) = (ReplayStatus::Failed, error.to_string());
                });
            }
        });
        match begun {
            Ok(interrupt) => *held = Some(ReplayHandle { id, interrupt }),
            Err(error) => {
                self.change(|state| state.replay = None);
                return Err(error.into());
            }
        }
        Ok(format!("{run} is being replayed"))
    }

    /// Prepares the replay and shows it on the page.
    fn prepare_replay(&self, run: &str, model: &str, rate: f64) -> Result<ReplayJob, Refusal> {
        let id = self.next_id();
        self.change(|state| {
            if let Some(replay) = state.replay.as_ref().filter(|replay| replay.state.is_under_way()) {
                let says = format!("{} is being replayed; stop that first: only one replay at a time is possible", replay.run);
                return Err(Refusal::new(RefusalKind::Busy, says));
            }
            let about = match state.runs.iter().find(|stored| stored.name() == run) {
                Some(StoredRun::Ready(about)) => about,
                Some(StoredRun::Opening { .. }) => {
                    return Err(Refusal::new(RefusalKind::Busy, format!("{run} is being opened; wait until that is done")));
                }
                Some(StoredRun::Unusable { why, .. }) => return Err(Refusal::new(RefusalKind::Wrong, why.clone())),
                None => return Err(Refusal::new(RefusalKind::Missing, format!("a run named {run} does not exist"))),
            };
            if !state.models.iter().any(|known| known == model) {
                let says = format!(
                    "a model named {model} does not exist; give a preset (`mr-damper presets`) or a .toml file in {}/models",
                    state.folder
                );
                return Err(Refusal::new(RefusalKind::Missing, says));
            }
            let path = self.folder.models_dir().join(model);
            let in_folder = model.ends_with(".toml");
            let label = format!("workshop: {run}");
            let job = ReplayJob {
                id,
                run: run.to_owned(),
                reading: about.reading.clone(),
                model: if in_folder { path.display().to_string() } else { model.to_owned() },
                label: label.clone(),
                rate,
            };
            state.replay = Some(Replay {
                id,
                run: run.to_owned(),
                model: model.to_owned(),
                damper: label,
                namespace: self.namespace(),
                state: ReplayStatus::Starting,
                says: "starting a separate node".to_owned(),
                at_s: 0.0,
                length_s: about.length_s,
                rate,
                figures: RunFigures::Computing,
            });
            Ok(job)
        })
    }

    /// Sends a command to the replay.
    ///
    /// # Errors
    /// When no replay is running, the command does not fit its state, or the rate is out of range.
    pub fn control_replay(&self, command: ReplayCommand) -> Result<String, Refusal> {
        if let ReplayCommand::Rate(rate) = command {
            check(rate)?;
        }
        let held = self.replay.lock().unwrap_or_else(PoisonError::into_inner);
        let none = || Refusal::new(RefusalKind::Missing, "nothing is being replayed".to_owned());
        let held = held.as_ref().ok_or_else(none)?;
        self.change(|state| {
            let replay = state.replay.as_mut().filter(|replay| replay.id == held.id).ok_or_else(none)?;
            let playing = replay.state;
            match command {
                ReplayCommand::Stop => {
                    held.interrupt.raise();
                    state.replay = None;
                    return Ok("the replay is stopped, and its node is ending".to_owned());
                }
                ReplayCommand::Rate(rate) => replay.rate = rate,
                ReplayCommand::Pause if playing == ReplayStatus::Playing => {
                    replay.state = ReplayStatus::Paused
                }
                ReplayCommand::Resume if playing == ReplayStatus::Paused => {
                    replay.state = ReplayStatus::Playing
                }
                ReplayCommand::Pause | ReplayCommand::Resume => {
                    let says = format!(
                        "the replay is not {}",
                        if command == ReplayCommand::Pause { "playing" } else { "paused" }
                    );
                    return Err(Refusal::new(RefusalKind::Busy, says));
                }
            }
            replay.says = in_words(replay);
            Ok(replay.says.clone())
        })
    }

    /// The namespace of the replay's node. It contains the process id, so no other process of this machine uses it.
    #[must_use]
    pub fn namespace(&self) -> String {
        format!("/workshop_{}", std::process::id())
    }

    /// The namespace of the damper named `damper`, if it is the replayed one.
    pub(super) fn own_namespace(&self, damper: &str) -> Option<String> {
        let state = self.state();
        state.replay.as_ref().filter(|replay| replay.damper == damper).map(|replay| replay.namespace.clone())
    }

    /// Configuration to join the domain of the replay's node, limited to this machine.
    pub(super) fn own_config(&self) -> Config {
        Config { domain_id: self.domain_id, discovery_range: "localhost".to_owned(), ..Config::default() }
    }

    /// Waits until the thread named `name` has ended.
    fn await_end(&self, name: &str, interrupt: &Interrupt) {
        let is_there = || {
            let threads = self.threads.lock().unwrap_or_else(PoisonError::into_inner);
            threads.iter().any(|thread| thread.name == name && !thread.handle.is_finished())
        };
        while is_there() && interrupt.sleep_until(Instant::now() + LOOK_EVERY) {}
    }

    /// Plays the run, and keeps its node running until it is interrupted.
    fn play(self: &Arc<Self>, job: &ReplayJob, interrupt: &Interrupt) -> Result<(), NodeError> {
        let options = loader_options(&job.reading)?;
        let run = Arc::new(mr_damper_runs::load(&self.folder.run(&job.run), &options)?.run);
        self.compute_figures(job, &run)?;
        let config = Config {
            model: job.model.clone(),
            history_duration_s: (run.duration().get() + 10.0).clamp(HISTORY_S.0, HISTORY_S.1),
            close_loop_out: self.folder.models_dir().display().to_string(),
            ..self.own_config()
        };
        let mut args = RosArgs::in_namespace(&self.namespace());
        // The log of this process belongs to the web server, not to a damper.
        args.rosout_logs = false;
        let mut node = ReplayNode::start(&config, &args, &job.label)?;
        let played = self.watch_and_play(job, &run, &mut node, interrupt);
        let ended = node.stop();
        played?;
        Ok(ended?)
    }

    fn watch_and_play(
        &self,
        job: &ReplayJob,
        run: &Run,
        node: &mut ReplayNode,
        interrupt: &Interrupt,
    ) -> Result<(), NodeError> {
        let ReplayNode { service, player, watcher } = node;
        let (player, at_ns) = (&*player, AtomicU64::new(0));
        std::thread::scope(|scope| {
            let player_thread = std::thread::Builder::new().name("workshop-player".to_owned());
            let mut playing = Some(
                player_thread
                    .spawn_scoped(scope, || self.run_player(job, run, player, &at_ns, interrupt))
                    .map_err(NodeError::io("starting the thread of the player"))?,
            );
            let mut reported = Instant::now();
            let ended = loop {
                if interrupt.is_raised() {
                    break Ok(());
                }
                let now_s = self.registry.now_s();
                let discovered = watcher.discover(&mut self.registry.lock(), now_s);
                watcher.drain(&mut self.registry.lock(), now_s, &mut |_, _| {});
                let dead = service.dead_thread();
                let dead = dead.map(|thread| WorkshopError::NodeThreadDied { thread }.into());
                let over = playing.take_if(|playing| playing.is_finished()).map_or(Ok(()), join);
                if let Some(error) = discovered.err().or(dead).or(over.err()) {
                    break Err(error);
                }
                if reported.elapsed() >= REPORT_EVERY {
                    reported = Instant::now();
                    let at_s = at_ns.load(Ordering::Relaxed) as f64 * 1e-9;
                    self.follow(job.id, player, at_s, playing.is_none());
                }
                std::thread::sleep(LOOK_EVERY);
            };
            // The player ends together with the replay.
            interrupt.raise();
            ended.and(playing.map_or(Ok(()), join))
        })
    }

    /// Waits for the node to listen, and plays the run.
    fn run_player(
        &self,
        job: &ReplayJob,
        run: &Run,
        player: &Player,
        at_ns: &AtomicU64,
        interrupt: &Interrupt,
    ) -> Result<(), NodeError> {
        if !player.wait_for_listener(LISTEN_WITHIN, interrupt) {
            return match interrupt.is_raised() {
                true => Ok(()),
                false => Err(WorkshopError::NoNode { within_s: LISTEN_WITHIN.as_secs() }.into()),
            };
        }
        self.change_replay(job.id, |replay| {
            replay.state = ReplayStatus::Playing;
            replay.says = in_words(replay);
        });
        let options = PlaybackOptions { rate: Rate::Times(job.rate), ..PlaybackOptions::default() };
        let at = |at_s: f64| at_ns.store((at_s * 1e9) as u64, Ordering::Relaxed);
        let mut played = Played::default();
        player.play(run, &options, &mut played, interrupt, None, &at);
        Ok(played.check()?)
    }

    /// Applies the requested pause and speed to the player, and updates the progress.
    fn follow(&self, id: u64, player: &Player, at_s: f64, is_over: bool) {
        let control = player.control();
        self.change_replay(id, |replay| {
            let paused = replay.state == ReplayStatus::Paused;
            if paused != control.is_paused() {
                control.toggle_paused();
            }
            if control.rate() != Rate::Times(replay.rate) {
                control.set_rate(replay.rate);
            }
            replay.at_s = at_s;
            if is_over && replay.state.is_under_way() {
                replay.state = ReplayStatus::Ended;
            }
            replay.says = in_words(replay);
        });
    }

    /// Computes the errors over the whole run offline, like `mr-damper evaluate`, on a separate thread.
    fn compute_figures(self: &Arc<Self>, job: &ReplayJob, run: &Arc<Run>) -> Result<(), NodeError> {
        let (workshop, run) = (Arc::clone(self), Arc::clone(run));
        let (id, name, model) = (job.id, job.run.clone(), job.model.clone());
        let begun = self.spawn(format!("workshop-figures-{id}"), move |_| {
            let figures = match catch_panic(|| Ok(evaluate::figures(name, models::load(&model)?, &run)?)) {
                Ok(report) => RunFigures::Done(report),
                Err(error) => RunFigures::None { why: error.to_string() },
            };
            workshop.change_replay(id, |replay| replay.figures = figures);
        });
        begun.map(drop)
    }

    fn change_replay(&self, id: u64, how: impl FnOnce(&mut Replay)) {
        self.change(|state| {
            if let Some(replay) = state.replay.as_mut().filter(|replay| replay.id == id) {
                how(replay);
            }
        });
    }
}

/// State of a replay in words.
fn in_words(replay: &Replay) -> String {
    match replay.state {
        ReplayStatus::Starting => "starting a separate node".to_owned(),
        ReplayStatus::Playing => "playing".to_owned(),
        ReplayStatus::Paused => "paused".to_owned(),
        ReplayStatus::Ended => {
            "played to its end; its node has the run in its history, so the model can be diagnosed".to_owned()
        }
        ReplayStatus::Failed => replay.says.clone(),
    }
}

/// Result of a player's thread that has ended.
fn join(playing: ScopedJoinHandle<'_, Result<(), NodeError>>) -> Result<(), NodeError> {
    playing.join().unwrap_or_else(|_| Err(WorkshopError::PlayerPanicked.into()))
}

fn check(rate: f64) -> Result<(), Refusal> {
    if RATES.contains(&rate) {
        return Ok(());
    }
    let says = format!("the rate is {rate}, but must be a number from {} to {}", RATES.start(), RATES.end());
    Err(Refusal::new(RefusalKind::Wrong, says))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_are_bounded() {
        assert!([0.1, 1.0, 10.0].into_iter().all(|rate| check(rate).is_ok()));
        for bad in [0.0, -1.0, 0.09, 10.1, f64::NAN, f64::INFINITY] {
            assert_eq!(check(bad).expect_err("bad").kind, RefusalKind::Wrong);
        }
    }
}
