//! Figures 3.2, 3.3 and A.1 to A.6 of the thesis: displacement and current of the experiments, over time and over frequency.

use mr_damper_model::compare::Experiment;
use mr_damper_model::identify::Dataset;
use mr_damper_model::statistics::spectrum::Spectra;
use mr_damper_model::units::M_PER_IN;
use mr_damper_reports::plot::{Ink, Plot, Series, Shape};
use mr_damper_reports::reproduction::{Chapter, Item, Part};

/// The figures of the experiments.
const FIGURES: [(&str, &str); 8] = [
    ("Figure 3.2", "RP-ICPS"),
    ("Figure 3.3", "RP3-CS"),
    ("Figure A.1", "RP-APRBS"),
    ("Figure A.2", "RP-PRBS"),
    ("Figure A.3", "RP-APRBS-L"),
    ("Figure A.4", "RP-ICPS-L"),
    ("Figure A.5", "RP1-CS"),
    ("Figure A.6", "RP2-CS"),
];

/// Length of the windows over time of short and of long runs, s; a run is short up to [`SHORT_S`].
const WINDOW_S: [f64; 2] = [20.0, 100.0];
/// Length of the windows of the spectra of short and of long runs, s.
const SPECTRUM_S: [f64; 2] = [30.0, 60.0];
const SHORT_S: f64 = 60.0;
/// Length of a segment of a spectrum, s: the distance of two frequencies is its inverse.
const SEGMENT_S: f64 = 8.0;
/// Highest frequency that is drawn, Hz.
const HIGHEST_HZ: f64 = 25.0;

/// The chapter.
pub(super) fn chapter(experiments: &[Experiment]) -> Chapter {
    let of = |(number, name): (&str, &str)| {
        let experiment = experiments.iter().find(|experiment| experiment.name == name)?;
        let data = &experiment.replicates.first()?.data;
        Some(Item {
            number: number.to_owned(),
            title: format!("displacement and current of {name}, over time and over frequency"),
            remark: String::new(),
            parts: vec![Part::Plots(plots(data))],
        })
    };
    Chapter {
        title: "Thesis, chapter 3 and appendix A: excitation".to_owned(),
        remark: format!(
            "First replicate of each experiment; displacement after the filter. Spectra are Welch's power densities in segments of \
             {SEGMENT_S} s. The thesis does not print which experiment figures A.1 to A.6 show: here they follow Table 3.2."
        ),
        items: FIGURES.into_iter().filter_map(of).collect(),
    }
}

fn plots(data: &Dataset) -> Vec<(String, Plot)> {
    let long = usize::from(data.rows.len() as f64 / data.rate_hz > SHORT_S);
    let taken = |seconds: f64| &data.rows[..data.rows.len().min((seconds * data.rate_hz) as usize)];
    let time = |row: &mr_damper_model::identify::Row| row.stamp.since(data.rows[0].stamp).get();
    let plot = |what: &str, x_label: &str, y_label: &str, log, ink, points: Vec<(f64, f64)>| Plot {
        description: what.to_owned(),
        x_label: x_label.to_owned(),
        y_label: y_label.to_owned(),
        log: (false, log),
        height: 260.0,
        series: vec![Series { name: String::new(), ink, shape: Shape::Line, points }],
        ..Plot::default()
    };
    let rows = taken(WINDOW_S[long]);
    let displacement = rows.iter().map(|row| (time(row), row.displacement_m / M_PER_IN)).collect();
    let current = rows.iter().map(|row| (time(row), row.drive)).collect();
    let mut plots = vec![
        (
            "displacement".to_owned(),
            plot("Displacement over time", "time, s", "displacement, in", false, Ink::Measured, displacement),
        ),
        (
            "current".to_owned(),
            plot("Current over time", "time, s", "current, A", false, Ink::Estimate, current),
        ),
    ];
    let stretch: Vec<(f64, f64)> =
        taken(SPECTRUM_S[long]).iter().map(|row| (row.displacement_m / M_PER_IN, row.drive)).collect();
    if let Some(spectra) = Spectra::of(&[stretch], data.rate_hz, (SEGMENT_S * data.rate_hz) as usize) {
        let points = |density: &[f64]| {
            let drawn = spectra.hz.iter().zip(density).take_while(|(hz, _)| **hz <= HIGHEST_HZ);
            drawn.map(|(hz, density)| (*hz, *density)).collect::<Vec<_>>()
        };
        let label = "frequency, Hz";
        plots.push((
            "spectrum of displacement".to_owned(),
            plot(
                "Spectrum of displacement",
                label,
                "power density, in²/Hz",
                true,
                Ink::Measured,
                points(&spectra.first),
            ),
        ));
        plots.push((
            "spectrum of current".to_owned(),
            plot(
                "Spectrum of current",
                label,
                "power density, A²/Hz",
                true,
                Ink::Estimate,
                points(&spectra.second),
            ),
        ));
    }
    plots
}
