//! The best run within the limits: candidates, their scalar products, and the choice.

use super::super::rows::Rows;
use super::criterion::{PairOfForms, Squares, columns, squares};
use super::measured::{dataset, joined, moving};
use super::plan::{self, Course, course, part_samples};
use super::search::{Search, Sums, Weighted, cost};
use super::segment::{Segment, candidates, whole};
use super::task::{Setup, Task};
use super::{DesignError, LEAST_IN_PARTS_S, Limits, PARTS, Question};
use crate::error::Error;
use crate::identify::Dataset;
use crate::parallel;

/// Segments in a part, and shortest and longest segment, s.
const SEGMENTS: f64 = 6.0;
const SEGMENT_S: [f64; 2] = [0.8, 2.5];
/// Largest rate at which candidates are examined, Hz.
const CANDIDATE_HZ: f64 = 600.0;
/// Largest number of rows of the candidates in the sums.
const CANDIDATE_ROWS: usize = 80_000;
/// Limits of the speed that are tried, as shares of the given one.
const SPEEDS: [f64; 3] = [1.0, 0.3, 0.1];
/// Share of the peak speed above which the damper moves, and the time around it that counts too, as in [`Dataset::from_run`].
const MOVING_SHARE: f64 = 0.05;
const MOVING_S: f64 = 0.1;
/// Weight of the pairs with effects that are not rivals, and quality above which more does not count.
const BESIDE: (f64, f64) = (0.1, 1.0);
/// Weight of the pairs with the model without the effect.
const ALONE: f64 = 0.5;

/// A plan with its rows.
pub(super) struct Best {
    pub(super) course: Course,
    pub(super) cost: f64,
}

/// Scalar products by limit of the speed and candidate, number of nuisance columns, time of a row, peak speed of each candidate.
type CandidateSums = ([Vec<Sums>; SPEEDS.len()], usize, f64, Vec<f64>);

/// Distances over the rows of a run.
pub(super) struct Exact {
    pub(super) squares: Vec<Squares>,
    pub(super) rows: f64,
    pub(super) seconds: f64,
    pub(super) cost: f64,
}

impl Task<'_> {
    /// The best course within `limits`, with its setup.
    pub(super) fn best(&self, limits: &Limits) -> Result<(Setup, Best), Error> {
        let setup = self.setup(limits)?;
        let parts = if limits.duration_s >= LEAST_IN_PARTS_S { PARTS } else { 1 };
        let every = (limits.rate_hz / CANDIDATE_HZ).ceil();
        let thinned = Limits { rate_hz: limits.rate_hz / every, ..*limits };
        let part = part_samples(&thinned, parts);
        let part_s = part as f64 / thinned.rate_hz;
        let segment_s = (part_s / SEGMENTS).clamp(SEGMENT_S[0].min(part_s), SEGMENT_S[1]);
        let count = self.settings.candidates.div_ceil(SPEEDS.len());
        let of_speed = |(number, share): (usize, &f64)| {
            let slower = Limits { speed_m_s: share * limits.speed_m_s, ..*limits };
            candidates(&slower, segment_s, count, self.settings.seed.wrapping_add(number as u64))
        };
        let segments: Vec<Segment> = SPEEDS.iter().enumerate().flat_map(of_speed).collect();
        let (sums, nuisance, row_s, peaks) = self.sums(&setup, &thinned, &segments, segment_s)?;
        let pairs = weighted_pairs(&setup, self.question);
        let mut best: Option<Best> = None;
        for (share, sums) in SPEEDS.iter().zip(&sums) {
            let slow: Vec<usize> = (0..segments.len())
                .filter(|&k| peaks[k] <= share * limits.speed_m_s * 1.01 && peaks[k] > 0.0)
                .collect();
            if slow.is_empty() {
                continue;
            }
            let own: Vec<Sums> = slow.iter().map(|&k| sums[k].clone()).collect();
            let places = ((part_s / segment_s) as usize).max(1);
            let search = Search {
                candidates: &own,
                nuisance,
                pairs: &pairs,
                row_s,
                noise_n: setup.noise_n,
                places,
                parts,
            };
            let plan: Vec<Segment> = search.run(self.watch)?.into_iter().map(|k| segments[slow[k]]).collect();
            let length = (segment_s * limits.rate_hz).round() as usize;
            // Moves between the homes keep the slower limit of speed, too.
            let within = Limits { speed_m_s: share * limits.speed_m_s, ..*limits };
            let course = course(&plan, length, parts, &within);
            let cost = self
                .exact(&setup, &course, limits.rate_hz, limits, &pairs)?
                .map_or(f64::INFINITY, |e| e.cost);
            if best.as_ref().is_none_or(|best| cost < best.cost) {
                best = Some(Best { course, cost });
            }
        }
        for segment in whole(limits, self.settings.seed) {
            let course = course(&[segment], part_samples(limits, 1), 1, limits);
            let exact = self.exact(&setup, &course, limits.rate_hz, limits, &pairs)?;
            let cost = exact.map_or(f64::INFINITY, |e| e.cost);
            if best.as_ref().is_none_or(|best| cost < best.cost) {
                best = Some(Best { course, cost });
            }
        }
        let reached_m =
            |course: &Course| course.displacement_m.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
        match best {
            Some(best) if reached_m(&best.course) > 0.0 => Ok((setup, best)),
            _ => Err(DesignError::NoMotion {
                duration_s: limits.duration_s,
                acceleration_m_s2: limits.acceleration_m_s2,
                reached_m: 0.0,
                stroke_m: limits.stroke_m,
            }
            .into()),
        }
    }

    /// For each limit of the speed the scalar products of each candidate; the number of nuisance columns, the time of a row, and the peak
    /// speed of each candidate.
    fn sums(
        &self,
        setup: &Setup,
        limits: &Limits,
        segments: &[Segment],
        segment_s: f64,
    ) -> Result<CandidateSums, Error> {
        let length = (segment_s * limits.rate_hz).round() as usize;
        let settling_s = self.model.conditioning.settling_time().get();
        let lead = ((settling_s + MOVING_S) * limits.rate_hz).ceil() as usize;
        let mut datasets = Vec::with_capacity(segments.len());
        let mut peaks = Vec::with_capacity(segments.len());
        for segment in segments {
            let (x, drive) = segment.play(length, limits);
            peaks.push(plan::peaks(&x, limits.rate_hz)[1]);
            let before = |values: &[f64]| vec![values.first().copied().unwrap_or(f64::NAN); lead];
            let course = Course {
                displacement_m: [before(&x), x].concat(),
                drive: [before(&drive), drive].concat(),
                placed: Vec::new(),
            };
            datasets.push(dataset(&course, &self.model, limits, limits.rate_hz, false, false)?);
        }
        let Some((joined, owner)) = joined(datasets) else {
            return Err(self.diverges());
        };
        let margin = (MOVING_S * limits.rate_hz) as usize;
        let moving = SPEEDS.map(|share| moving(&joined, MOVING_SHARE * share * limits.speed_m_s, margin));
        let datasets = [joined];
        let rows = Rows::new(&datasets, CANDIDATE_ROWS);
        let effects = setup.effects();
        let found = columns(&self.joint(&rows, setup.scales), &self.without, &effects)?;
        let columns = found.ok_or_else(|| self.diverges())?;
        let run = &rows.runs()[0];
        let of_speed = |moving: &Vec<bool>| -> Vec<Sums> {
            let mut keep: Vec<Vec<usize>> = vec![Vec::new(); segments.len()];
            for (at, &row) in run.indices.iter().enumerate().filter(|(_, row)| moving[**row]) {
                keep[owner[row]].push(at);
            }
            parallel::map(&keep, |keep| Sums { gram: columns.gram(keep), rows: keep.len() as f64 })
        };
        Ok((moving.each_ref().map(of_speed), columns.nuisance, run.step_s, peaks))
    }

    /// The distances of `pairs` in the whole `course`, as the diagnosis will see it; `None` if no row counts.
    fn exact(
        &self,
        setup: &Setup,
        course: &Course,
        rate_hz: f64,
        limits: &Limits,
        pairs: &[Weighted],
    ) -> Result<Option<Exact>, Error> {
        let dataset = dataset(course, &self.model, limits, rate_hz, self.warms, true)?;
        self.exact_on(setup, dataset, pairs)
    }

    pub(super) fn exact_on(
        &self,
        setup: &Setup,
        dataset: Dataset,
        pairs: &[Weighted],
    ) -> Result<Option<Exact>, Error> {
        let datasets = [dataset];
        let rows = Rows::new(&datasets, usize::MAX);
        if rows.len() < 2 {
            return Ok(None);
        }
        let joint = self.joint(&rows, setup.scales);
        let Some(columns) = columns(&joint, &self.without, &setup.effects())? else { return Ok(None) };
        let keep: Vec<usize> = (0..rows.len()).collect();
        let gram = columns.gram(&keep);
        let squares = squares(&gram, columns.nuisance, pairs.iter().map(|weighted| &weighted.pair));
        let (count, seconds) = (rows.len() as f64, rows.len() as f64 * rows.runs()[0].step_s);
        let cost = cost(&squares, pairs, count, seconds, setup.noise_n);
        Ok(Some(Exact { squares, rows: count, seconds, cost }))
    }
}

/// The pairs of the search: those of the result, and with less weight each rival against the model without it and against the effects
/// beside the rivals.
fn weighted_pairs(setup: &Setup, question: &Question) -> Vec<Weighted> {
    let mut pairs: Vec<Weighted> = setup
        .reported_pairs(question)
        .into_iter()
        .map(|pair| Weighted { pair: pair.forms, weight: 1.0, enough: f64::INFINITY })
        .collect();
    let forms: usize = setup.rivals.iter().map(|rival| rival.forms.len()).sum();
    let (weight, enough) = BESIDE;
    for truth in 0..forms {
        pairs.push(Weighted {
            pair: PairOfForms { truth, rival: Vec::new() },
            weight: ALONE,
            enough: f64::INFINITY,
        });
        for number in 0..setup.beside.len() {
            let pair = PairOfForms { truth, rival: vec![forms + number] };
            pairs.push(Weighted { pair, weight, enough });
        }
    }
    pairs
}
