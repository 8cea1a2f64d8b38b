//! Checks of clock, timer, priority, and the limit on open files.

use super::{Finding, leaves_this_machine};
use crate::process::files;
use crate::settings::config::Config;
use mr_damper_base::clock::system_now;
use mr_damper_base::realtime::{self, Request, Scheduling};
use std::path::Path;
use std::time::{Duration, Instant};

/// 2025-01-01, ns since 1970: before this program was written.
const EARLIEST_NS: i64 = 1_735_689_600_000_000_000;
/// How long the clock is compared with the monotonic clock.
const COMPARED: Duration = Duration::from_millis(200);
/// Number of sleeps that are measured.
const SLEEPS: usize = 300;
/// Length of a sleep: the period of samples at 1 kHz.
const SLEEP: Duration = Duration::from_millis(1);
/// Largest accepted delay of waking up, at the 99th percentile.
const OVERSLEPT: Duration = Duration::from_millis(1);

/// Checks the clock that gives the stamps.
pub(super) fn clock(config: &Config) -> Finding {
    const WHAT: &str = "clock";
    if config.use_sim_time {
        return Finding::ok(WHAT, "the time comes from /clock (use_sim_time)");
    }
    let (stamp, began) = (system_now(), Instant::now());
    std::thread::sleep(COMPARED);
    let apart_s = (system_now().since(stamp).get() - began.elapsed().as_secs_f64()).abs();
    if stamp.nanos() < EARLIEST_NS {
        return Finding::warning(
            WHAT,
            "it is set before 2025",
            "set it or synchronise it: its time is in all stamps and bags",
        );
    }
    if apart_s > 1e-3 {
        let found = format!("it jumped by {:.1} ms during the check", 1e3 * apart_s);
        return Finding::warning(WHAT, found, "after a jump, samples with stamps in the past are refused");
    }
    // The files of systemd-timesyncd and chrony.
    let kept = ["/run/systemd/timesync/synchronized", "/run/chrony/chronyd.pid"]
        .into_iter()
        .any(|path| Path::new(path).exists());
    match (leaves_this_machine(config), kept) {
        (true, false) => Finding::warning(
            WHAT,
            "it runs evenly, but neither systemd-timesyncd nor chrony synchronises it",
            "stamps of other machines that differ by more than input_timeout_s count as late or in the future: synchronise the clocks (PTP, NTP)",
        ),
        (_, true) => Finding::ok(WHAT, "it runs evenly and is synchronised"),
        (false, false) => Finding::ok(WHAT, "it runs evenly"),
    }
}

/// Measures how late the system wakes a thread, which shows how busy the machine is.
pub(super) fn timer() -> Finding {
    let mut late: Vec<Duration> = (0..SLEEPS)
        .map(|_| {
            let began = Instant::now();
            std::thread::sleep(SLEEP);
            began.elapsed().saturating_sub(SLEEP)
        })
        .collect();
    late.sort_unstable();
    let (most, worst) = (late[SLEEPS * 99 / 100], late[SLEEPS - 1]);
    let ms = |time: Duration| time.as_secs_f64() * 1e3;
    let found = format!(
        "a sleeping thread wakes up to {:.2} ms late (99th percentile), at worst {:.2} ms",
        ms(most),
        ms(worst)
    );
    if most <= OVERSLEPT {
        Finding::ok("timer", found)
    } else {
        Finding::warning(
            "timer",
            found,
            "the machine is busy: realtime_priority gives the node precedence over others, deadline_s counts late estimates",
        )
    }
}

/// Checks whether threads can get real-time priority, also if none is requested.
pub(super) fn priority(config: &Config) -> Finding {
    const WHAT: &str = "real-time priority";
    let requested = Request::from_parameter(config.realtime_priority);
    // Tries it also if it is not requested, to say whether it could be.
    let tried = if requested == Request::Ordinary { Request::IfPermitted } else { requested };
    let found = match (realtime::raised(tried, || ()).1, requested) {
        (Scheduling::Refused { priority, why }, _) => {
            return Finding::warning(
                WHAT,
                format!("SCHED_FIFO {priority} is refused: {why}"),
                realtime::ADVICE,
            );
        }
        (Scheduling::NotPermitted { priority, why }, Request::IfPermitted) => format!(
            "the node runs without: SCHED_FIFO {priority} is not available ({why}). To permit it, {}",
            realtime::ADVICE
        ),
        (Scheduling::NotPermitted { why, .. }, _) => {
            format!("not requested, and it would be refused: {why}")
        }
        (_, Request::Ordinary) => "not requested; it is available (realtime_priority)".to_owned(),
        (scheduling, _) => format!("{scheduling} is available"),
    };
    Finding::ok(WHAT, found)
}

/// Checks the limit on open files.
pub(super) fn files(dampers: usize) -> Finding {
    let (allowed, needed) = (files::allowed(), files::needed(dampers));
    let found = match allowed {
        Some(allowed) => format!("at most {allowed}; enough are {needed} (dampers: {dampers})"),
        None => "there is no limit".to_owned(),
    };
    match allowed {
        Some(allowed) if allowed < needed => {
            Finding::warning("open files", found, "raise the limit: ulimit -Hn, or LimitNOFILE= of systemd")
        }
        _ => Finding::ok("open files", found),
    }
}
