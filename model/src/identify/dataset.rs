//! A run as a model sees it: conditioned rows at the displacement stamps.
//!
//! Rows are computed with the building blocks of the live pipeline (hold, force aligner, sampling times, conditioning,
//! low-pass), in the same order of samples. A model identified on them therefore runs live under the same
//! conditions: causal filters, the same delays, and a restart after each gap.

use crate::condition::{ApplyTo, Conditioning, ForceAligner, Hold, LowPassState, MotionState, Timing};
use crate::effect::term::Past;
use crate::error::{Error, IdentifyError};
use crate::force::Inputs;
use crate::model::Envelope;
use crate::sample::{DriveKind, Reading, Run, Stamp, Trace};

/// Share of the peak speed above which the damper is moving.
const MOVING_SHARE: f64 = 0.05;
/// Time before and after a moving sample that is also taken as moving, s.
const MOVING_MARGIN_S: f64 = 0.1;
/// Number of rows in a stretch (see [`Dataset::stretches`]).
const STRETCH: usize = 1024;
/// Reach of the central difference of the speed, to either side, s.
const SPEED_REACH_S: f64 = 0.01;
/// Largest relative deviation of a run's rate from a whole multiple of the requested rate.
const RATE_TOLERANCE: f64 = 0.01;

/// How a run is converted to rows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DatasetOptions {
    /// Count only rows where the damper moves: speed over 5 % of its peak within 0.1 s. Recordings begin and
    /// end at rest, which tells nothing about a moving damper. Rows at rest still pass the filters. The speed
    /// is a central difference over 20 ms of the raw displacement, so that the choice of rows does not depend
    /// on the conditioning.
    pub moving_only: bool,
    /// Requested rate of the rows, Hz, reached by keeping every n-th displacement; `None` keeps all.
    pub rate_hz: Option<f64>,
    /// Time between displacements above which filters restart, s: as in the pipeline's settings.
    pub gap_s: f64,
}

impl Default for DatasetOptions {
    fn default() -> Self {
        Self { moving_only: true, rate_hz: None, gap_s: 0.1 }
    }
}

/// One displacement sample and the values of the other channels at its stamp. Unknown numbers are NaN.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row {
    /// Stamp of the displacement.
    pub stamp: Stamp,
    /// Time since the previous row, s; `None` for the first row of a segment.
    pub dt_s: Option<f64>,
    /// Conditioned displacement, m.
    pub displacement_m: f64,
    /// Conditioned velocity, m/s.
    pub velocity_m_s: f64,
    /// Conditioned acceleration, m/s²; NaN in the first row of a segment.
    pub acceleration_m_s2: f64,
    /// Drive, A or V.
    pub drive: f64,
    /// Case temperature, °C, held between readings.
    pub case_temp_c: f64,
    /// Measured force at this stamp, N, comparable with the model's force: low-passed if the conditioning
    /// filters the output.
    pub force_n: f64,
    /// Measured force at this stamp without any filter, N.
    pub raw_force_n: f64,
    /// True for a counted row: one that is used for fits and error figures. Its force and both derivatives
    /// are known, the filters have settled, and the damper moves.
    pub counts: bool,
}

impl Row {
    /// The model inputs of this row.
    #[must_use]
    pub const fn inputs(&self) -> Inputs {
        Inputs {
            dt_s: self.dt_s,
            displacement_m: self.displacement_m,
            velocity_m_s: self.velocity_m_s,
            acceleration_m_s2: self.acceleration_m_s2,
            drive: self.drive,
            case_temp_c: self.case_temp_c,
        }
    }
}

/// A conditioned run.
///
/// ```
/// use mr_damper_model::condition::Conditioning;
/// use mr_damper_model::identify::{Dataset, DatasetOptions};
/// use mr_damper_model::rig::{Channels, Experiment, Plant, record};
///
/// let run = record(&Experiment::sine(0.01, 2.0, 1.2, 3.0), &Plant::default(), &Channels::PERFECT, 1);
/// let half_rate = DatasetOptions { rate_hz: Some(256.0), ..DatasetOptions::default() };
/// let data = Dataset::from_run(&run, &Conditioning::THESIS, &half_rate)?;
/// // Every second displacement is a row, except the first one, which has no velocity.
/// assert_eq!(data.rows.len(), run.displacement_m.len() / 2 - 1);
/// // The sine has a peak speed of 2 pi 2 Hz 0.01 m = 0.126 m/s. At 2 Hz the filter of the thesis passes 99 % of it.
/// let middle = &data.rows[256..512];
/// let peak_m_s = middle.iter().map(|row| row.velocity_m_s).fold(0.0, f64::max);
/// assert!((peak_m_s - 0.99 * 0.126).abs() < 0.001, "{peak_m_s} m/s");
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Dataset {
    /// Name of the run.
    pub name: String,
    /// Kind of the run's drive; `None` without a drive.
    pub drive: Option<DriveKind>,
    /// The conditioning of the rows.
    pub conditioning: Conditioning,
    /// Mean rate of the displacement (after thinning), Hz.
    pub rate_hz: f64,
    /// The rows, in time order.
    pub rows: Vec<Row>,
    /// Ranges over the counted rows.
    pub envelope: Envelope,
    /// The past of each segment that begins within the run; see [`Dataset::past`].
    pub(crate) pasts: Vec<(Stamp, Past)>,
}

impl Dataset {
    /// Conditions `run`.
    ///
    /// # Errors
    /// [`Error::MissingChannel`] without force, or without velocity if the conditioning uses the measured
    /// velocity; [`Error::OutOfRange`] for invalid settings; [`Error::Identify`] if the run is too short, or if
    /// its rate is not a whole multiple of the requested rate.
    pub fn from_run(run: &Run, conditioning: &Conditioning, options: &DatasetOptions) -> Result<Self, Error> {
        conditioning.validate()?;
        Error::check("gap_s", options.gap_s, "positive and finite", |g| g > 0.0)?;
        let missing = |channel| Error::MissingChannel {
            run: run.name.clone(),
            channel,
            needed_by: "identification".to_owned(),
        };
        if run.force_n.as_ref().is_none_or(Trace::is_empty) {
            return Err(missing("force_n"));
        }
        if conditioning.velocity == crate::condition::VelocitySource::Measured
            && run.velocity_m_s.as_ref().is_none_or(Trace::is_empty)
        {
            return Err(missing("velocity_m_s"));
        }
        let every = stride(run, options.rate_hz)?;
        let (mut rows, raw_m) = condition(run, conditioning, options.gap_s, every);
        if conditioning.apply_to == ApplyTo::Output {
            filter_force(&mut rows, conditioning);
        }
        mark(&mut rows, conditioning, options.moving_only.then_some(&raw_m));
        let rate_hz = run.displacement_m.mean_rate_hz().unwrap_or(0.0) / every as f64;
        let mut data = Self::from_rows(&run.name, run.drive_kind(), *conditioning, rate_hz, rows);
        for value in run.case_temp_c.iter().flat_map(|trace| &trace.values) {
            Envelope::widen(&mut data.envelope.case_temp_c, *value);
        }
        Ok(data)
    }

    /// A run of the given rows, which are conditioned as stated. The ranges follow from the counted rows; the range of the temperature stays
    /// unknown.
    #[must_use]
    pub fn from_rows(
        name: &str,
        drive: Option<DriveKind>,
        conditioning: Conditioning,
        rate_hz: f64,
        rows: Vec<Row>,
    ) -> Self {
        let envelope = envelope_of(&rows);
        Self { name: name.to_owned(), drive, conditioning, rate_hz, rows, envelope, pasts: Vec::new() }
    }

    /// About one in `every` of the rows, in contiguous stretches from all over the run, each a segment of its
    /// own. For models that learn from sequences, if the run is longer than they can use.
    #[must_use]
    pub fn stretches(&self, every: usize) -> Self {
        let mut rows = Vec::with_capacity(self.rows.len() / every.max(1) + STRETCH);
        for group in self.rows.chunks(STRETCH * every.max(1)) {
            let from = (group.len() - group.len().min(STRETCH)) / 2;
            let first = rows.len();
            rows.extend_from_slice(&group[from..(from + STRETCH).min(group.len())]);
            rows[first].dt_s = None;
        }
        self.with_rows(rows)
    }

    /// The same run with other rows.
    pub(crate) fn with_rows(&self, rows: Vec<Row>) -> Self {
        Self { name: self.name.clone(), rows, pasts: self.pasts.clone(), ..*self }
    }

    /// The past of the segment that begins with `row`. `None` if that is not known: at the start of a recording and after a gap.
    pub(crate) fn past(&self, row: &Row) -> Option<&Past> {
        self.pasts.iter().find_map(|(stamp, past)| (*stamp == row.stamp).then_some(past))
    }

    /// Number of counted rows.
    #[must_use]
    pub fn counted(&self) -> usize {
        self.rows.iter().filter(|row| row.counts).count()
    }
}

/// Number of displacements of `run` for each row at `rate_hz`.
fn stride(run: &Run, rate_hz: Option<f64>) -> Result<usize, Error> {
    let Some(recorded_hz) = run.displacement_m.mean_rate_hz() else {
        return Err(IdentifyError::NoRate { run: run.name.clone() }.into());
    };
    let Some(requested_hz) = rate_hz else { return Ok(1) };
    Error::check("rate_hz", requested_hz, "positive and finite", |r| r > 0.0)?;
    let multiple = (recorded_hz / requested_hz).round();
    if multiple < 1.0 || (recorded_hz / (multiple * requested_hz) - 1.0).abs() > RATE_TOLERANCE {
        return Err(IdentifyError::NotAMultiple {
            run: run.name.clone(),
            rate_hz: recorded_hz,
            requested_hz,
        }
        .into());
    }
    Ok(multiple as usize)
}

/// The rows with unfiltered force, and the raw displacement of each, m.
fn condition(run: &Run, conditioning: &Conditioning, gap_s: f64, every: usize) -> (Vec<Row>, Vec<f64>) {
    let low_pass = conditioning.low_pass();
    let mut motion = MotionState::default();
    let (mut drive, mut velocity, mut case_temp_c) = (Hold::default(), Hold::default(), Hold::default());
    let mut aligner = ForceAligner::<usize>::default();
    let mut rows = Vec::with_capacity(run.displacement_m.len() / every);
    let mut raw_m = Vec::with_capacity(rows.capacity());
    let (mut displacement_timing, mut force_timing) = (Timing::default(), Timing::default());
    // Stamp and sampling time of the displacement before.
    let mut last: Option<(Stamp, Stamp)> = None;
    // True before the first row of a segment, which has no previous row.
    let mut fresh = true;
    let mut count = 0;
    for sample in run.samples() {
        let stamp = sample.stamp;
        match sample.reading {
            Reading::Drive(d) => drive.push(stamp, d.get()),
            Reading::Velocity(v) => velocity.push(stamp, v.0),
            Reading::Force(f) => aligner.push_force(force_timing.place(stamp, f.0), f.0),
            Reading::CaseTemperature(t) => case_temp_c.push(stamp, t.0),
            // The damper's force does not depend on these.
            Reading::BodyVelocity(_) | Reading::ForceRequest(_) => {}
            Reading::Displacement(x) => {
                count += 1;
                let taken = displacement_timing.place(stamp, x.0);
                if (count - 1) % every != 0 {
                    continue;
                }
                let before =
                    last.replace((stamp, taken)).filter(|(last, _)| stamp.since(*last).get() <= gap_s);
                let dt_s = before.map(|(_, before)| taken.since(before).get());
                fresh |= dt_s.is_none();
                let measured =
                    velocity.at(stamp).filter(|(at, _)| stamp.since(*at).get() <= gap_s).map(|(_, v)| v);
                let Some(m) = conditioning.step(&low_pass, &mut motion, dt_s, x.0, measured) else {
                    continue;
                };
                aligner.wait(taken, rows.len());
                raw_m.push(x.0);
                rows.push(Row {
                    stamp,
                    dt_s: dt_s.filter(|_| !fresh),
                    displacement_m: m.displacement_m,
                    velocity_m_s: m.velocity_m_s,
                    acceleration_m_s2: m.acceleration_m_s2,
                    drive: drive.at(stamp).map_or(f64::NAN, |(_, value)| value),
                    case_temp_c: case_temp_c.at(stamp).map_or(f64::NAN, |(_, value)| value),
                    force_n: f64::NAN,
                    raw_force_n: f64::NAN,
                    counts: false,
                });
                fresh = false;
            }
        }
        while let Some((_, force_n, index)) = aligner.next_known(gap_s) {
            rows[index].force_n = force_n;
            rows[index].raw_force_n = force_n;
        }
    }
    (rows, raw_m)
}

/// Low-passes the measured force, as the pipeline does before the comparison with a low-passed output.
fn filter_force(rows: &mut [Row], conditioning: &Conditioning) {
    let low_pass = conditioning.low_pass();
    let mut state = LowPassState::default();
    // Time since the last row with a force; `None` before the first one of a segment.
    let mut since_s: Option<f64> = None;
    for row in rows {
        since_s = since_s.zip(row.dt_s).map(|(since_s, dt_s)| since_s + dt_s);
        if row.force_n.is_finite() {
            row.force_n = low_pass.step(&mut state, since_s, row.force_n);
            since_s = Some(0.0);
        }
    }
}

/// Marks the counted rows: all usable rows or, given the displacements `raw_m`, those where the damper moves.
fn mark(rows: &mut [Row], conditioning: &Conditioning, raw_m: Option<&[f64]>) {
    let settling_s = conditioning.settling_time().get();
    let mut settled_s = 0.0;
    for row in rows.iter_mut() {
        settled_s = row.dt_s.map_or(0.0, |dt| settled_s + dt);
        row.counts = settled_s >= settling_s
            && row.force_n.is_finite()
            && row.velocity_m_s.is_finite()
            && row.acceleration_m_s2.is_finite();
    }
    let Some(raw_m) = raw_m else { return };
    let speeds = speeds(rows, raw_m);
    let limit = MOVING_SHARE * speeds.iter().fold(0.0_f64, |peak, speed| peak.max(*speed));
    let mut near = vec![false; rows.len()];
    let (mut after, mut before): (Option<Stamp>, Option<Stamp>) = (None, None);
    for ((row, speed), near) in rows.iter().zip(&speeds).zip(&mut near) {
        after = if *speed > limit { Some(row.stamp) } else { after };
        *near |= after.is_some_and(|at| row.stamp.since(at).get() <= MOVING_MARGIN_S);
    }
    for ((row, speed), near) in rows.iter().zip(&speeds).zip(&mut near).rev() {
        before = if *speed > limit { Some(row.stamp) } else { before };
        *near |= before.is_some_and(|at| at.since(row.stamp).get() <= MOVING_MARGIN_S);
    }
    for (row, near) in rows.iter_mut().zip(near) {
        row.counts &= near;
    }
}

/// Speed at each row, m/s, from a central difference within the row's segment.
fn speeds(rows: &[Row], raw_m: &[f64]) -> Vec<f64> {
    let mut speeds = Vec::with_capacity(rows.len());
    let apart_s = |a: usize, b: usize| rows[b].stamp.since(rows[a].stamp).get();
    let (mut first, mut from, mut to) = (0, 0, 0);
    for k in 0..rows.len() {
        if rows[k].dt_s.is_none() {
            (first, from) = (k, k);
        }
        while apart_s(from, k) > SPEED_REACH_S && from + 1 < k {
            from += 1;
        }
        // At least one row to either side, if it exists.
        from = if from == k && k > first { k - 1 } else { from };
        to = to.max(k);
        while to + 1 < rows.len()
            && rows[to + 1].dt_s.is_some()
            && (to == k || apart_s(k, to + 1) <= SPEED_REACH_S)
        {
            to += 1;
        }
        let span_s = apart_s(from, to);
        speeds.push(if span_s > 0.0 { (raw_m[to] - raw_m[from]).abs() / span_s } else { 0.0 });
    }
    speeds
}

fn envelope_of(rows: &[Row]) -> Envelope {
    let mut envelope = Envelope::default();
    for row in rows.iter().filter(|row| row.counts) {
        Envelope::widen(&mut envelope.displacement_m, row.displacement_m);
        Envelope::widen(&mut envelope.velocity_m_s, row.velocity_m_s);
        Envelope::widen(&mut envelope.drive, row.drive);
        Envelope::widen(&mut envelope.force_n, row.force_n);
    }
    envelope
}

/// The envelope that includes both; a range that is unknown in one is taken from the other.
#[must_use]
pub(super) fn union(a: &Envelope, b: &Envelope) -> Envelope {
    let both = |a: Option<[f64; 2]>, b: Option<[f64; 2]>| match (a, b) {
        (Some(a), Some(b)) => Some([a[0].min(b[0]), a[1].max(b[1])]),
        (a, b) => a.or(b),
    };
    Envelope {
        displacement_m: both(a.displacement_m, b.displacement_m),
        velocity_m_s: both(a.velocity_m_s, b.velocity_m_s),
        drive: both(a.drive, b.drive),
        case_temp_c: both(a.case_temp_c, b.case_temp_c),
        force_n: both(a.force_n, b.force_n),
    }
}
