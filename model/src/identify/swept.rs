//! Behaviour of an identified model over the whole range of its runs, and a little beyond.
//!
//! Runs rarely fill the range in which their model will be used. If they have few rows at a low drive and high speed, two
//! numbers that nearly cancel within these rows fit as well as the right ones, and the force beyond them has any size. So the
//! model is simulated on sines at constant drive:
//!
//! ```text
//! motion    x = X sin(2 pi f t)    peak speed 1/4, 1/2 and 1 of the runs' peak speed, by X; 3/2, by f
//! drive     five levels, from zero (or the lowest, if it is below zero) to the highest of the runs
//! energy    E = integral of F dx over the third cycle
//! ```
//!
//! | fault | where |
//! |---|---|
//! | diverges | the force is not finite, or above 100 times the largest measured force |
//! | too large | the force is above 3 times the largest measured force, or 4.5 times at 3/2 of the peak speed |
//! | drives the motion | E is below zero by more than 2 % of the largest energy at this speed |
//! | falls with the drive | E falls from one level to the next by more than 10 % of the largest energy at this speed, although it rises over the levels that the runs hold |

use super::dataset::{self, Dataset, Row};
use super::score::{DIVERGED, walk};
use crate::effect::{Augmented, REFERENCE_TEMP_C};
use crate::model::Envelope;
use crate::parallel;
use crate::sample::{Drive, DriveKind, Stamp};
use crate::units::{MetrePerSecond, Newton};
use std::f64::consts::TAU;
use std::fmt;
use std::ops::ControlFlow;

/// Peak speeds of the sines, as shares of the runs' peak speed.
const SPEEDS: [f64; 4] = [0.25, 0.5, 1.0, 1.5];
/// Number of levels of the drive.
const LEVELS: usize = 5;
/// Cycles before the one that counts: memory and filters settle.
const SETTLING_CYCLES: usize = 2;
/// Fewest rows of a cycle.
const CYCLE_ROWS: f64 = 64.0;
/// Multiple of the largest measured force that a model may reach within the runs' speeds. Both forces are without their middle.
const LARGEST: f64 = 3.0;
/// Negative energy of a cycle, as a share of the largest at the same speed, that is rounding or a phase of the filters.
const DRIVEN: f64 = 0.02;
/// Fall of the energy from one level of the drive to the next, as a share of the largest at the same speed, that is an error of
/// the fit.
const FALL: f64 = 0.1;
/// Lowest drive of runs that hold negative drives, as a share of the highest.
const NEGATIVE: f64 = 0.05;
/// Ratio of the energies at the highest and the lowest level that the runs hold, above which the damper grows with the drive.
const RISE: f64 = 1.2;
/// Shortest time that the runs spend near a sine's drive and at its speed for its energy to be known from them, s.
const KNOWN_S: f64 = 0.2;
/// Share of a sine's peak speed above which rows of the runs show that speed.
const NEAR_SPEED: f64 = 0.8;

/// A model on sines over the whole range of its runs.
#[derive(Debug, Clone, PartialEq)]
pub struct SweptRange {
    /// The sines, by drive and then by speed.
    pub sines: Vec<SweptSine>,
    /// Where the model does something that no damper does.
    pub faults: Vec<SweptFault>,
    /// True if the force grows with the drive where the runs show it. Otherwise it may fall elsewhere.
    pub grows: bool,
}

/// A sine at constant drive, and the model's response to it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SweptSine {
    /// The drive; `None` for a model without drive.
    pub drive: Option<Drive>,
    /// Peak speed.
    pub speed: MetrePerSecond,
    /// True if the runs are slower.
    pub is_above_the_runs: bool,
    /// Time that the runs spend near this drive and at this speed or above, s.
    pub runs_s: f64,
    /// The response in the third cycle; `None` if the simulation did not stay finite.
    pub response: Option<SweptResponse>,
}

/// Response to one cycle of a sine.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SweptResponse {
    /// Largest force, without the model's offset.
    pub largest: Newton,
    /// Energy that the damper takes from the motion, J.
    pub energy_j: f64,
}

/// Something that no damper does. Its text is a sentence without a full stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SweptFault {
    /// The sine that shows it.
    pub sine: SweptSine,
    /// What it is.
    pub kind: SweptFaultKind,
}

/// Kind of a fault.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SweptFaultKind {
    /// The force does not stay finite.
    Diverges,
    /// The force exceeds a multiple of the largest measured force.
    TooLarge {
        /// The force.
        largest: Newton,
        /// The largest measured force, without its middle.
        measured: Newton,
    },
    /// The damper gives energy to the motion.
    DrivesMotion {
        /// The energy that it takes from it, below zero, J.
        energy_j: f64,
    },
    /// The energy is lower than at the level of the drive before, although the damper's rises. The sine is at the
    /// level that the runs show less.
    FallsWithDrive {
        /// The level before, and the energy there, J.
        from: (Drive, f64),
        /// The level, and the energy there, J.
        to: (Drive, f64),
    },
}

impl SweptFaultKind {
    /// The name, as in JSON.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Diverges => "diverges",
            Self::TooLarge { .. } => "too_large",
            Self::DrivesMotion { .. } => "drives_motion",
            Self::FallsWithDrive { .. } => "falls_with_drive",
        }
    }
}

impl SweptRange {
    /// The first sine on which the simulation does not stay finite.
    #[must_use]
    pub fn diverges(&self) -> Option<&SweptSine> {
        self.faults.iter().find(|fault| fault.kind == SweptFaultKind::Diverges).map(|fault| &fault.sine)
    }

    /// The first fault, the number of others, and what helps; `None` without a fault.
    #[must_use]
    pub fn warning(&self) -> Option<String> {
        let first = self.faults.first()?;
        let others = match self.faults.len() - 1 {
            0 => String::new(),
            others => format!(" (and at {others} of {} other sines)", self.sines.len() - 1),
        };
        Some(format!("{first}{others}; add runs with this motion"))
    }
}

/// One sentence without a full stop: the range and what the model does in it.
impl fmt::Display for SweptRange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (first, last) = (self.sines.first(), self.sines.last());
        f.write_str("on sines over the range of the runs and half as fast again (")?;
        if let (Some(low), Some(high)) = (first.and_then(|s| s.drive), last.and_then(|s| s.drive)) {
            write!(f, "{:.2} to {}, ", low.get(), level(high))?;
        }
        let (speed, faults) = (last.map_or(0.0, |sine| sine.speed.0), self.faults.len());
        write!(f, "up to {speed:.3} m/s) ")?;
        if faults > 0 {
            return write!(f, "the model does what no damper does at {faults} of {}", self.sines.len());
        }
        f.write_str("the force stays bounded and takes energy from the motion")?;
        if self.grows {
            f.write_str(", and a cycle takes about as much or more of it at a larger drive")
        } else {
            Ok(())
        }
    }
}

/// A level of the drive, as text.
fn level(drive: Drive) -> String {
    format!("{:.2} {}", drive.get(), drive.kind().unit())
}

/// As in "on a sine at 0.50 A with a peak speed of 0.240 m/s".
impl fmt::Display for SweptSine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("on a sine")?;
        if let Some(drive) = self.drive {
            write!(f, " at {}", level(drive))?;
        }
        write!(f, " with a peak speed of {:.3} m/s", self.speed.0)
    }
}

impl fmt::Display for SweptFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}, where the runs have {:.1} s, ", self.sine, self.sine.runs_s)?;
        match self.kind {
            SweptFaultKind::Diverges => f.write_str("the simulation does not stay finite"),
            SweptFaultKind::TooLarge { largest, measured } => write!(
                f,
                "the force reaches {:.0} N, {:.1} times the largest measured force",
                largest.0,
                largest.0 / measured.0
            ),
            SweptFaultKind::DrivesMotion { energy_j } => {
                write!(f, "the model drives the motion: it adds {:.3} J in a cycle", -energy_j)
            }
            SweptFaultKind::FallsWithDrive { from, to } => write!(
                f,
                "the force falls with the drive, although it grows where the runs show it: a cycle takes {:.3} J at {} and {:.3} J at {}",
                from.1,
                level(from.0),
                to.1,
                level(to.0)
            ),
        }
    }
}

/// Sweeps `model`, which does not use measured force, over the range of `datasets`. `None` if they have no motion.
pub(crate) fn sweep(model: &Augmented, datasets: &[Dataset]) -> Option<SweptRange> {
    let range = Range::of(datasets, model.force().drive())?;
    let model = model.with_force_offset_n(0.0);
    let sines: Vec<Sine> = range.sines().collect();
    let sines: Vec<SweptSine> = parallel::map(&sines, |sine| range.simulate(&model, sine));
    let grows = grows(&sines);
    let faults = range.faults(&sines, grows);
    Some(SweptRange { sines, faults, grows })
}

/// A sine at constant drive.
pub(super) struct Sine {
    drive: Option<Drive>,
    speed_m_s: f64,
    amplitude_m: f64,
    /// Number of rows of a cycle, and the time between them, s.
    cycle: usize,
    dt_s: f64,
}

/// The range of some runs.
pub(super) struct Range<'a> {
    datasets: &'a [Dataset],
    /// Middle and half of the largest stroke, m.
    middle_m: f64,
    amplitude_m: f64,
    /// Peak speed, m/s.
    speed_m_s: f64,
    /// Half of the range of the measured force, N.
    force_n: f64,
    /// Levels of the drive; one `None` for a model without drive.
    drives: Vec<Option<Drive>>,
    /// Largest distance from a level at which a drive is near it.
    near: f64,
}

impl<'a> Range<'a> {
    /// The range of `datasets` and, for a model with a `drive`, of this drive. `None` if they have no motion.
    pub(super) fn of(datasets: &'a [Dataset], drive: Option<DriveKind>) -> Option<Self> {
        let all = datasets.iter().fold(Envelope::default(), |all, d| dataset::union(&all, &d.envelope));
        let [x, v, force] = [all.displacement_m?, all.velocity_m_s?, all.force_n?];
        let (mut drives, mut near) = (vec![None], f64::INFINITY);
        if let (Some(kind), Some([low, high])) = (drive, all.drive) {
            // Noise of a converter around zero does not make the drive negative.
            let low = if low < -NEGATIVE * high { low } else { 0.0 };
            let step = (high - low) / (LEVELS - 1) as f64;
            drives = (0..LEVELS).map(|level| Some(Drive::new(kind, low + step * level as f64))).collect();
            near = 0.5 * step;
        }
        let range = Self {
            datasets,
            middle_m: f64::midpoint(x[0], x[1]),
            amplitude_m: 0.5 * (x[1] - x[0]),
            speed_m_s: v[1].abs().max(v[0].abs()),
            force_n: 0.5 * (force[1] - force[0]),
            drives,
            near,
        };
        (range.amplitude_m > 0.0 && range.speed_m_s > 0.0).then_some(range)
    }

    /// The sines, by drive and then by speed.
    pub(super) fn sines(&self) -> impl Iterator<Item = Sine> {
        let sine = |(drive, share): (Option<Drive>, f64)| {
            let (amplitude_m, speed_m_s) = (self.amplitude_m * share.min(1.0), self.speed_m_s * share);
            let period_s = TAU * amplitude_m / speed_m_s;
            let cycle = (period_s * self.datasets[0].rate_hz).max(CYCLE_ROWS).round() as usize;
            Sine { drive, speed_m_s, amplitude_m, cycle, dt_s: period_s / cycle as f64 }
        };
        self.drives.iter().flat_map(|drive| SPEEDS.map(|share| (*drive, share))).map(sine)
    }

    /// The rows of `cycles` cycles of `sine`, a segment of their own, without force.
    pub(super) fn rows(&self, sine: &Sine, cycles: usize) -> impl Iterator<Item = Row> {
        let &Sine { drive, speed_m_s, amplitude_m, cycle, dt_s } = sine;
        let (omega, middle_m) = (speed_m_s / amplitude_m, self.middle_m);
        (0..cycles * cycle).map(move |k| {
            let time_s = dt_s * k as f64;
            let (sin, cos) = (omega * time_s).sin_cos();
            Row {
                stamp: Stamp::from_nanos((time_s * 1e9) as i64),
                dt_s: (k > 0).then_some(dt_s),
                displacement_m: middle_m + amplitude_m * sin,
                velocity_m_s: speed_m_s * cos,
                acceleration_m_s2: -speed_m_s * omega * sin,
                drive: drive.map_or(f64::NAN, Drive::get),
                case_temp_c: REFERENCE_TEMP_C,
                force_n: f64::NAN,
                raw_force_n: f64::NAN,
                counts: false,
            }
        })
    }

    fn simulate(&self, model: &Augmented, sine: &Sine) -> SweptSine {
        let &Sine { drive, speed_m_s, cycle, dt_s, .. } = sine;
        let dataset = self.datasets[0].with_rows(self.rows(sine, SETTLING_CYCLES + 1).collect());
        let (mut k, mut largest_n, mut energy_j) = (0, 0.0_f64, 0.0);
        let limit_n = DIVERGED * self.force_n.max(1.0);
        let walked = walk(model, &dataset, |row, predicted| {
            let force_n = predicted.free_run_n;
            // A history needs some rows before the first force.
            let is_lost = k > cycle && !(-limit_n..=limit_n).contains(&force_n);
            if k >= SETTLING_CYCLES * cycle {
                largest_n = largest_n.max(force_n.abs());
                energy_j += force_n * row.velocity_m_s * dt_s;
            }
            k += 1;
            if is_lost { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        let response = walked.is_continue().then_some(SweptResponse { largest: Newton(largest_n), energy_j });
        SweptSine {
            drive,
            speed: MetrePerSecond(speed_m_s),
            is_above_the_runs: speed_m_s > self.speed_m_s,
            runs_s: self.runs_s(drive, speed_m_s),
            response,
        }
    }

    /// Time that the runs spend near `drive` and at `speed_m_s` or above, s.
    fn runs_s(&self, drive: Option<Drive>, speed_m_s: f64) -> f64 {
        let is_there = |row: &&Row| {
            row.counts
                && row.velocity_m_s.abs() >= NEAR_SPEED * speed_m_s
                && drive.is_none_or(|drive| (row.drive - drive.get()).abs() <= self.near)
        };
        let of_run = |d: &Dataset| d.rows.iter().filter(is_there).count() as f64 / d.rate_hz;
        parallel::map(self.datasets, of_run).iter().sum()
    }

    fn faults(&self, sines: &[SweptSine], grows: bool) -> Vec<SweptFault> {
        let energy_j = |sine: &SweptSine| sine.response.map(|response| response.energy_j);
        let mut faults = Vec::new();
        for (at, sine) in sines.iter().enumerate() {
            let speed = at % SPEEDS.len();
            let at_speed = sines.iter().skip(speed).step_by(SPEEDS.len());
            let most_j =
                at_speed.filter_map(energy_j).fold(0.0, |most, energy_j| f64::max(most, energy_j.abs()));
            let before = at.checked_sub(SPEEDS.len()).map(|before| &sines[before]).filter(|_| grows);
            let level = |sine: &SweptSine| sine.drive.filter(|drive| drive.get() >= 0.0).zip(energy_j(sine));
            let fall = before.and_then(level).zip(level(sine));
            let kind = match sine.response {
                None => SweptFaultKind::Diverges,
                Some(SweptResponse { largest, .. })
                    if largest.0 > LARGEST * SPEEDS[speed].max(1.0) * self.force_n =>
                {
                    SweptFaultKind::TooLarge { largest, measured: Newton(self.force_n) }
                }
                Some(SweptResponse { energy_j, .. }) if energy_j < -DRIVEN * most_j => {
                    SweptFaultKind::DrivesMotion { energy_j }
                }
                Some(_) => match fall {
                    Some((from, to)) if to.1 < from.1 - FALL * most_j => {
                        SweptFaultKind::FallsWithDrive { from, to }
                    }
                    _ => continue,
                },
            };
            let lesser = before.filter(|before| {
                matches!(kind, SweptFaultKind::FallsWithDrive { .. }) && before.runs_s < sine.runs_s
            });
            faults.push(SweptFault { sine: *lesser.unwrap_or(sine), kind });
        }
        faults
    }
}

/// True if the energy rises over the levels that the runs hold, at some speed.
fn grows(sines: &[SweptSine]) -> bool {
    (0..SPEEDS.len()).any(|speed| {
        let at_speed = sines.iter().skip(speed).step_by(SPEEDS.len());
        let mut known = at_speed.filter(|sine| sine.runs_s >= KNOWN_S).filter_map(|sine| sine.response);
        let lowest = known.next();
        lowest.zip(known.next_back()).is_some_and(|(low, high)| high.energy_j > RISE * low.energy_j)
    })
}

#[cfg(test)]
mod tests;
