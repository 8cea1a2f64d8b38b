//! `[expected.uncertainty]` of a model file: the tables as lists, and their validation.
//!
//! ```toml
//! [expected.uncertainty.free_run]
//! speed_edges_m_s = [0.02, 0.05, 0.09]        # edges between four regions of |conditioned velocity|
//! drive_edges = [0.6, 1.4]                    # edges between three regions of the drive, in its unit; [] without drive
//! std_dev_n = [[9.0, 15.0, 21.0], ...]        # one row per speed region, one number per drive region
//! half_band_n = [[15.0, 26.0, 34.0], ...]
//! [expected.uncertainty.free_run.drive_held]  # absent without drive
//! age_s = [0.0, 0.05, 0.1]                    # nothing is added up to the first age
//! added_std_dev_n = [0.0, 12.0, 20.0]
//! added_half_band_n = [0.0, 20.0, 36.0]
//! [expected.uncertainty.one_step]             # the same; only for models whose input includes force
//! [expected.uncertainty.one_step.coasting]
//! time_s = [0.002, 0.004, 0.008]              # since the last measured force
//! std_dev_factor = [1.0, 1.9, 3.1]
//! half_band_factor = [1.0, 1.8, 3.0]
//! ```

use super::{Bands, DRIVES, Edges, Growth, OneStep, SPEEDS, TIMES, Uncertainty, Width, refused};
use crate::error::{Error, UncertaintyProblem};
use serde::{Deserialize, Serialize};

/// The complete table.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct UncertaintyTable {
    #[serde(skip_serializing_if = "Option::is_none")]
    free_run: Option<BandsTable>,
    #[serde(skip_serializing_if = "Option::is_none")]
    one_step: Option<BandsTable>,
}

/// The table of one predictor.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct BandsTable {
    speed_edges_m_s: Vec<f64>,
    drive_edges: Vec<f64>,
    std_dev_n: Vec<Vec<f64>>,
    half_band_n: Vec<Vec<f64>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    drive_held: Option<HeldTable>,
    #[serde(skip_serializing_if = "Option::is_none")]
    coasting: Option<CoastingTable>,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct HeldTable {
    age_s: Vec<f64>,
    added_std_dev_n: Vec<f64>,
    added_half_band_n: Vec<f64>,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct CoastingTable {
    time_s: Vec<f64>,
    std_dev_factor: Vec<f64>,
    half_band_factor: Vec<f64>,
}

impl From<Uncertainty> for UncertaintyTable {
    fn from(uncertainty: Uncertainty) -> Self {
        Self {
            free_run: uncertainty.free_run.map(|bands| BandsTable::of(&bands, None)),
            one_step: uncertainty.one_step.map(|o| BandsTable::of(&o.bands, Some(&o.coasting))),
        }
    }
}

impl TryFrom<UncertaintyTable> for Uncertainty {
    type Error = Error;

    fn try_from(table: UncertaintyTable) -> Result<Self, Error> {
        if table.free_run.as_ref().is_some_and(|free_run| free_run.coasting.is_some()) {
            return Err(refused("free_run.coasting", UncertaintyProblem::Superfluous));
        }
        let free_run = table.free_run.map(|free_run| free_run.bands("free_run")).transpose()?;
        let one_step = match &table.one_step {
            None => None,
            Some(one_step) => Some(OneStep {
                bands: one_step.bands("one_step")?,
                coasting: one_step
                    .coasting
                    .as_ref()
                    .ok_or_else(|| refused("one_step.coasting", UncertaintyProblem::Missing))?
                    .growth("one_step.coasting")?,
            }),
        };
        if free_run.is_none() && one_step.is_none() {
            return Err(refused("free_run", UncertaintyProblem::Empty));
        }
        Ok(Self { free_run, one_step })
    }
}

impl BandsTable {
    fn of(bands: &Bands, coasting: Option<&Growth>) -> Self {
        let (rows, columns) = (bands.speed_edges_m_s.len + 1, bands.drive_edges.len + 1);
        let grid = |of: fn(&Width) -> f64| {
            bands.width_n[..rows].iter().map(|row| row[..columns].iter().map(of).collect()).collect()
        };
        Self {
            speed_edges_m_s: bands.speed_edges_m_s.as_slice().to_vec(),
            drive_edges: bands.drive_edges.as_slice().to_vec(),
            std_dev_n: grid(|w| w.std_dev),
            half_band_n: grid(|w| w.half_band),
            drive_held: bands.drive_held.as_ref().map(|g| {
                let [age_s, added_std_dev_n, added_half_band_n] = lists(g);
                HeldTable { age_s, added_std_dev_n, added_half_band_n }
            }),
            coasting: coasting.map(|g| {
                let [time_s, std_dev_factor, half_band_factor] = lists(g);
                CoastingTable { time_s, std_dev_factor, half_band_factor }
            }),
        }
    }

    fn bands(&self, name: &str) -> Result<Bands, Error> {
        let speed_edges_m_s = edges(&format!("{name}.speed_edges_m_s"), &self.speed_edges_m_s)?;
        if let Some(first) = self.speed_edges_m_s.first().filter(|edge| **edge <= 0.0) {
            return Err(refused(
                &format!("{name}.speed_edges_m_s"),
                UncertaintyProblem::SpeedEdge { edge_m_s: *first },
            ));
        }
        let drive_edges = edges(&format!("{name}.drive_edges"), &self.drive_edges)?;
        let shape = (self.speed_edges_m_s.len() + 1, self.drive_edges.len() + 1);
        let std_dev = grid(&format!("{name}.std_dev_n"), &self.std_dev_n, shape)?;
        let half_band = grid(&format!("{name}.half_band_n"), &self.half_band_n, shape)?;
        let mut width_n = [[Width::default(); DRIVES]; SPEEDS];
        for (i, row) in width_n.iter_mut().enumerate() {
            for (j, width) in row.iter_mut().enumerate() {
                *width = Width { std_dev: std_dev[i][j], half_band: half_band[i][j] };
            }
        }
        let held = format!("{name}.drive_held");
        let drive_held = self.drive_held.as_ref().map(|table| table.growth(&held)).transpose()?;
        if drive_held.is_none() && !self.drive_edges.is_empty() {
            return Err(refused(&held, UncertaintyProblem::MissingGrowth));
        }
        Ok(Bands { speed_edges_m_s, drive_edges, width_n, drive_held })
    }
}

impl HeldTable {
    fn growth(&self, name: &str) -> Result<Growth, Error> {
        let lists = [
            ("added_std_dev_n", self.added_std_dev_n.as_slice()),
            ("added_half_band_n", self.added_half_band_n.as_slice()),
        ];
        growth(name, ("age_s", &self.age_s), lists, 0.0)
    }
}

impl CoastingTable {
    fn growth(&self, name: &str) -> Result<Growth, Error> {
        let lists = [
            ("std_dev_factor", self.std_dev_factor.as_slice()),
            ("half_band_factor", self.half_band_factor.as_slice()),
        ];
        growth(name, ("time_s", &self.time_s), lists, 1.0)
    }
}

/// Times, standard deviations and half-widths of a growth.
fn lists(growth: &Growth) -> [Vec<f64>; 3] {
    let width = &growth.width[..growth.len];
    [
        growth.at_s[..growth.len].to_vec(),
        width.iter().map(|w| w.std_dev).collect(),
        width.iter().map(|w| w.half_band).collect(),
    ]
}

fn edges<const N: usize>(name: &str, values: &[f64]) -> Result<Edges<N>, Error> {
    if values.len() > N {
        return Err(refused(name, UncertaintyProblem::Count { found: values.len(), least: 0, most: N }));
    }
    Edges::new(values).ok_or_else(|| {
        refused(name, UncertaintyProblem::NotIncreasing { values: values.to_vec(), from_zero: false })
    })
}

/// A grid of `rows`, padded with zeros to its full size.
fn grid(
    name: &str,
    rows: &[Vec<f64>],
    (speeds, drives): (usize, usize),
) -> Result<[[f64; DRIVES]; SPEEDS], Error> {
    if rows.len() != speeds {
        return Err(refused(name, defined_by("speed_edges_m_s", "rows".to_owned(), rows.len(), speeds)));
    }
    let mut filled = [[0.0; DRIVES]; SPEEDS];
    for (i, row) in rows.iter().enumerate() {
        if row.len() != drives {
            let of = format!("values in row {i}");
            return Err(refused(name, defined_by("drive_edges", of, row.len(), drives)));
        }
        for (j, value) in row.iter().enumerate() {
            filled[i][j] = at_least(&format!("{name}[{i}][{j}]"), *value, 0.0)?;
        }
    }
    Ok(filled)
}

/// The size of a list is not the one that the edges in `other` define.
fn defined_by(other: &str, of: String, found: usize, needed: usize) -> UncertaintyProblem {
    UncertaintyProblem::Size { found, of, other: other.to_owned(), needs: "define", needed }
}

/// A growth from lists of equal length. Times must increase; widths start at `base` and never decrease.
fn growth(
    name: &str,
    (times_name, times): (&str, &[f64]),
    lists: [(&str, &[f64]); 2],
    base: f64,
) -> Result<Growth, Error> {
    let times_name = format!("{name}.{times_name}");
    if times.is_empty() || times.len() > TIMES {
        let problem = UncertaintyProblem::Count { found: times.len(), least: 1, most: TIMES };
        return Err(refused(&times_name, problem));
    }
    if !(times.iter().all(|t| t.is_finite() && *t >= 0.0) && times.windows(2).all(|pair| pair[0] < pair[1])) {
        let problem = UncertaintyProblem::NotIncreasing { values: times.to_vec(), from_zero: true };
        return Err(refused(&times_name, problem));
    }
    for (list, values) in lists {
        let list = format!("{name}.{list}");
        if values.len() != times.len() {
            let problem = UncertaintyProblem::Size {
                found: values.len(),
                of: "values".to_owned(),
                other: times_name,
                needs: "has",
                needed: times.len(),
            };
            return Err(refused(&list, problem));
        }
        for (k, value) in values.iter().enumerate() {
            at_least(&format!("{list}[{k}]"), *value, if k == 0 { base } else { values[k - 1] })?;
        }
        if values[0] != base {
            let problem = UncertaintyProblem::First { value: values[0], expected: base };
            return Err(refused(&format!("{list}[0]"), problem));
        }
    }
    let [(_, std_dev), (_, half_band)] = lists;
    let nodes: Vec<(f64, Width)> = (0..times.len())
        .map(|k| (times[k], Width { std_dev: std_dev[k], half_band: half_band[k] }))
        .collect();
    Growth::new(&nodes).ok_or_else(|| refused(name, UncertaintyProblem::Invalid))
}

fn at_least(name: &str, value: f64, least: f64) -> Result<f64, Error> {
    if value.is_finite() && value >= least {
        return Ok(value);
    }
    Err(refused(name, UncertaintyProblem::TooSmall { value, least }))
}
