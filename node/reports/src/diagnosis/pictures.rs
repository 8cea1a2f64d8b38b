//! Pictures of what a diagnosis found: the effects with their intervals, and the structures that were tried as base.

use crate::row_plot::{Dot, PlotRow, RowPlot};
use maud::Markup;

/// A parameter of a named effect.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ParameterPicture {
    /// Effect and parameter.
    pub(crate) name: String,
    /// The estimate.
    pub(crate) value: f64,
    /// The 95 % interval; an end may be infinite.
    pub(crate) ci95: [f64; 2],
}

/// Parameters with their intervals, in percent of the estimates, so that parameters with different units have one axis.
pub(crate) fn intervals(parameters: &[ParameterPicture]) -> Markup {
    // A parameter of zero has no percentage.
    let known = parameters.iter().filter(|parameter| parameter.value != 0.0 && parameter.value.is_finite());
    let row = |parameter: &ParameterPicture| {
        let percent = |value: f64| 100.0 * value / parameter.value;
        let ends = parameter.ci95.map(percent);
        PlotRow {
            name: parameter.name.clone(),
            line: Some([ends[0].min(ends[1]), ends[0].max(ends[1])]),
            is_interval: true,
            dots: vec![(100.0, Dot::Filled)],
            is_strong: false,
        }
    };
    RowPlot {
        description: "95 % intervals of the parameters of the effects, in percent of their estimates".to_owned(),
        label: "% of the estimate".to_owned(),
        rows: known.map(row).collect(),
        mark: None,
    }
    .figure("95 % intervals. Zero is no effect: an interval that contains it does not exclude that the effect is absent.")
}

/// A structure that was tried as base.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct StructurePicture {
    /// Its name.
    pub(crate) name: String,
    /// RMSE on the validation runs, N: alone, and with the effects that were found on it.
    pub(crate) rmse_n: [f64; 2],
    /// True for the structure of the result.
    pub(crate) is_chosen: bool,
}

/// The structures by their errors, from the largest to the smallest. `noise_n` is the RMSE of the noise.
pub(crate) fn ladder(structures: &[StructurePicture], noise_n: Option<f64>) -> Markup {
    let mut sorted: Vec<&StructurePicture> = structures.iter().collect();
    sorted.sort_by(|a, b| b.rmse_n[1].total_cmp(&a.rmse_n[1]));
    let row = |structure: &StructurePicture| PlotRow {
        name: structure.name.clone(),
        line: Some(structure.rmse_n),
        is_interval: false,
        dots: vec![(structure.rmse_n[0], Dot::Open), (structure.rmse_n[1], Dot::Filled)],
        is_strong: structure.is_chosen,
    };
    RowPlot {
        description: "Structures of the base by their RMSE on the validation runs, alone and with the effects".to_owned(),
        label: "RMSE on the validation runs, N".to_owned(),
        rows: sorted.into_iter().map(row).collect(),
        mark: noise_n,
    }
    .figure("Open: the structure alone. Filled: with the effects that were found on it. Bold: chosen. Dashed: the noise floor, if known.")
}
