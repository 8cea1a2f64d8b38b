//! Clock, timer, priority, open files.

use super::{Finding, leaves_this_machine};
use crate::clock::system_now;
use crate::config::Config;
use crate::files;
use crate::realtime::{self, Standing};
use std::path::Path;
use std::time::{Duration, Instant};

/// 2025-01-01, ns since 1970: before this program was written.
const EARLIEST_NS: i64 = 1_735_689_600_000_000_000;
/// How long the clock is compared with the one that nobody sets.
const COMPARED: Duration = Duration::from_millis(200);
/// Sleeps that are measured, each as long as a sample at 1 kHz.
const SLEEPS: usize = 300;
const SLEEP: Duration = Duration::from_millis(1);
/// How much longer than asked for 99 of 100 sleeps may last.
const OVERSLEPT: Duration = Duration::from_millis(1);

/// The clock that stamps come from.
pub(super) fn clock(config: &Config) -> Finding {
    const WHAT: &str = "clock";
    if config.use_sim_time {
        return Finding::ok(WHAT, "/clock says what time it is (use_sim_time)");
    }
    let (stamp, began) = (system_now(), Instant::now());
    std::thread::sleep(COMPARED);
    let apart_s = (system_now().since(stamp).get() - began.elapsed().as_secs_f64()).abs();
    if stamp.nanos() < EARLIEST_NS {
        return Finding::warning(
            WHAT,
            "it is set before 2025",
            "set it, or have it synchronised: stamps and bags say when something was",
        );
    }
    if apart_s > 1e-3 {
        let found = format!("it was set by {:.1} ms meanwhile", 1e3 * apart_s);
        return Finding::warning(WHAT, found, "while it is set in steps, samples are refused as of the past");
    }
    // systemd's, and chrony's.
    let kept = ["/run/systemd/timesync/synchronized", "/run/chrony/chronyd.pid"]
        .into_iter()
        .any(|path| Path::new(path).exists());
    match (leaves_this_machine(config), kept) {
        (true, false) => Finding::warning(
            WHAT,
            "it goes evenly, and neither systemd-timesyncd nor chrony keeps it",
            "stamps of other machines that differ by more than input_timeout_s are late or of the future: synchronise them (PTP, NTP)",
        ),
        (_, true) => Finding::ok(WHAT, "it goes evenly, and is synchronised"),
        (false, false) => Finding::ok(WHAT, "it goes evenly"),
    }
}

/// How exactly the system wakes a thread, which says how busy it is.
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
        "a thread that sleeps is woken up to {:.2} ms late (99 %), {:.2} at the worst",
        ms(most),
        ms(worst)
    );
    if most <= OVERSLEPT {
        Finding::ok("timer", found)
    } else {
        Finding::warning(
            "timer",
            found,
            "the machine is busy: realtime_priority puts the node before others, deadline_s counts what is late",
        )
    }
}

/// Whether threads may have real-time priority, asked for or not.
pub(super) fn priority(config: &Config) -> Finding {
    const WHAT: &str = "real-time priority";
    let asked = u8::try_from(config.realtime_priority).unwrap_or_default();
    let ((), standing) = realtime::raised(asked.max(1), || ());
    match (standing, asked) {
        (Standing::Refused { why, .. }, 0) => {
            Finding::ok(WHAT, format!("not asked for, and it would be refused: {why}"))
        }
        (Standing::Refused { priority, why }, _) => {
            Finding::warning(WHAT, format!("SCHED_FIFO {priority} is refused: {why}"), realtime::ADVICE)
        }
        (_, 0) => Finding::ok(WHAT, "not asked for; it may be had (realtime_priority)"),
        (_, asked) => Finding::ok(WHAT, format!("SCHED_FIFO {asked} may be had")),
    }
}

/// The limit on open files.
pub(super) fn files(dampers: usize) -> Finding {
    let (allowed, wanted) = (files::allowed(), files::wanted(dampers));
    let found = match allowed {
        Some(allowed) => format!("{allowed} may be had, {wanted} are enough for {dampers}"),
        None => "as many as there may be".to_owned(),
    };
    match allowed {
        Some(allowed) if allowed < wanted => {
            Finding::warning("open files", found, "ulimit -Hn, or LimitNOFILE= of systemd")
        }
        _ => Finding::ok("open files", found),
    }
}
