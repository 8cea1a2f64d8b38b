//! The force models that have C code: their fragments, their sizes and their parameters.

use crate::parameter::CParameter;
use mr_damper_model::force::{
    Arx, Dependence, ForceModel, FuzzySets, FuzzyTanh, LAGS, LPV_REGRESSORS, LawModel, Lazy, LazyPoint, Lpv,
    MaxwellSlip, Network, Shape as SetShape, Signal, SlipFunction, Tsk, TskInput, TskSet,
};
use mr_damper_model::units::unit_of_name;

/// The parts of the source of a force model.
#[derive(Debug, Default)]
pub(crate) struct Force {
    /// Fragments, besides those that they need.
    pub(crate) fragments: Vec<String>,
    /// Constants of the header, `MRD_` names without the prefix, and what they are.
    pub(crate) sizes: Vec<(&'static str, usize, &'static str)>,
    pub(crate) parameters: Vec<CParameter>,
    /// C code that the force's fragment needs before it.
    pub(crate) glue: String,
    /// Condition of its fragments that other models do not have.
    pub(crate) feature: Option<(&'static str, bool)>,
    /// True if it can give its slope, so that a series spring around it takes Newton steps.
    pub(crate) has_slope: bool,
}

impl Force {
    /// The parts of `model`.
    pub(crate) fn of(model: &ForceModel) -> Self {
        let mut own = match model {
            ForceModel::FuzzyTanh(fuzzy) => fuzzy_tanh(fuzzy),
            ForceModel::Law(law) => of_law(law),
            ForceModel::Arx(arx) => of_arx(arx),
            ForceModel::Lpv(lpv) => of_lpv(lpv),
            ForceModel::Network(network) => of_network(network),
            ForceModel::MaxwellSlip(slip) => of_slip(slip),
            ForceModel::Tsk(tsk) => of_tsk(tsk),
            ForceModel::Lazy(lazy) => of_lazy(lazy),
        };
        let offset =
            CParameter::scalar("force_offset_n", "N", "force of the session at rest", model.force_offset_n());
        own.parameters.insert(0, offset);
        own
    }
}

fn memberships(sets: &FuzzySets) -> [CParameter; 2] {
    let (suffix, unit) = (sets.drive().unit_suffix(), sets.drive().unit());
    [
        CParameter::array(
            format!("membership_centres_{suffix}"),
            unit,
            "centres of the fuzzy sets, increasing",
            sets.centres(),
        ),
        CParameter::array(
            format!("membership_sigma_{suffix}"),
            unit,
            "widths of the fuzzy sets, above zero",
            sets.sigmas(),
        ),
    ]
}

fn fuzzy_tanh(fuzzy: &FuzzyTanh) -> Force {
    let of = |number: fn(&mr_damper_model::force::TanhFunction) -> f64| -> Vec<f64> {
        fuzzy.functions().iter().map(number).collect()
    };
    let mut parameters = memberships(fuzzy.sets()).to_vec();
    parameters.extend([
        CParameter::array("yield_force_n", "N", "A1, heights of the tanh steps", &of(|f| f.yield_force_n)),
        CParameter::array(
            "post_yield_damping_n_s_m",
            "N s/m",
            "A2, slopes beyond the yield",
            &of(|f| f.post_yield_damping_n_s_m),
        ),
        CParameter::array(
            "pre_yield_slope_s_m",
            "s/m",
            "A3, steepness of the steps",
            &of(|f| f.pre_yield_slope_s_m),
        ),
        CParameter::array(
            "coupling_per_s",
            "1/s",
            "kappa, weights of displacement",
            &of(|f| f.coupling_per_s),
        ),
    ]);
    Force {
        fragments: vec!["force_fuzzy_tanh".to_owned()],
        sizes: vec![("SETS", fuzzy.sets().len(), "fuzzy sets over the drive")],
        parameters,
        has_slope: true,
        ..Force::default()
    }
}

fn of_law(model: &LawModel) -> Force {
    let (law, copies) = (model.law(), model.dependence().copies());
    let n = law.parameters().len();
    let mut own = Force {
        fragments: vec![format!("law_{}", law.name().replace('-', "_"))],
        sizes: vec![("LAW_PARAMETERS", n, "parameters of the force law")],
        ..Force::default()
    };
    let (fragment, about) = match model.dependence() {
        Dependence::None => ("force_law", ""),
        Dependence::Polynomial { .. } => ("force_law_polynomial", ", by power of the drive"),
        Dependence::Fuzzy(_) if law.has_memory() => ("force_law_fuzzy_memory", ", by fuzzy set"),
        Dependence::Fuzzy(_) => ("force_law_fuzzy", ", by fuzzy set"),
    };
    match model.dependence() {
        Dependence::None => {}
        Dependence::Polynomial { .. } => {
            own.sizes.push(("COPIES", copies, "coefficients of a polynomial in the drive"));
        }
        Dependence::Fuzzy(sets) => {
            own.sizes.push(("SETS", sets.len(), "fuzzy sets over the drive"));
            own.parameters.extend(memberships(sets));
        }
    }
    own.fragments.push(fragment.to_owned());
    own.glue = "/* The parameters of one copy of the law, in its order. */
static void mrd_law_parameters(const mrd_parameters *p, int copy, double q[MRD_LAW_PARAMETERS]) {
"
    .to_owned();
    if copies == 1 {
        own.glue += "    (void)copy;\n";
    }
    for (j, parameter) in law.parameters().iter().enumerate() {
        let values: Vec<f64> = model.coefficients().iter().skip(j).step_by(n).copied().collect();
        let label = format!("{}{about}", parameter.name.replace('_', " "));
        let unit = unit_of_name(parameter.name).unwrap_or_default();
        if copies == 1 {
            own.parameters.push(CParameter::scalar(parameter.name, &unit, label, values[0]));
            own.glue += &format!("    q[{j}] = p->{};\n", parameter.name);
        } else {
            own.parameters.push(CParameter::array(parameter.name, &unit, label, &values));
            own.glue += &format!("    q[{j}] = p->{}[copy];\n", parameter.name);
        }
    }
    own.glue += "}\n";
    own
}

/// Sizes of an autoregressive model with a history of this depth.
fn lag_sizes(lags: usize, delay: usize) -> Vec<(&'static str, usize, &'static str)> {
    vec![
        ("LAGS", lags, "lags of each signal"),
        ("DELAY", delay, "samples by which the inputs are delayed"),
        ("DEPTH", lags + delay, "samples that the model remembers"),
    ]
}

fn of_arx(arx: &Arx) -> Force {
    let lags = arx.lags();
    let mut parameters = vec![
        CParameter::array("force_lags", "", "coefficients of the earlier forces", &arx.force_lags()[..lags]),
        CParameter::array(
            "displacement_lags_n_m",
            "N/m",
            "coefficients of the displacements",
            &arx.displacement_lags_n_m()[..lags],
        ),
        CParameter::array(
            "velocity_lags_n_s_m",
            "N s/m",
            "coefficients of the velocities",
            &arx.velocity_lags_n_s_m()[..lags],
        ),
    ];
    if let Some((kind, values)) = arx.drive_lags() {
        let unit = format!("N/{}", kind.unit());
        parameters.push(CParameter::array(
            "drive_lags",
            &unit,
            "coefficients of the drives",
            &values[..lags],
        ));
    }
    Force {
        fragments: vec!["force_arx".to_owned()],
        sizes: lag_sizes(lags, arx.delay()),
        parameters,
        ..Force::default()
    }
}

fn of_lpv(lpv: &Lpv) -> Force {
    let (copies, lags) = (lpv.dependence().copies(), LAGS);
    let mut own = Force { sizes: lag_sizes(lags, 0), ..Force::default() };
    let weights = match lpv.dependence() {
        Dependence::Fuzzy(sets) => {
            own.sizes.push(("SETS", sets.len(), "fuzzy sets over the drive"));
            own.parameters.extend(memberships(sets));
            "weights_fuzzy"
        }
        _ => "weights_polynomial",
    };
    own.sizes.push(("COPIES", copies, "copies of the coefficients"));
    let rows: Vec<&[f64]> = lpv.coefficients().chunks_exact(LPV_REGRESSORS).collect();
    for (signal, (name, unit, what)) in [
        ("force_lags", "", "coefficients of the earlier forces"),
        ("displacement_lags_n_m", "N/m", "coefficients of the displacements"),
        ("velocity_lags_n_s_m", "N s/m", "coefficients of the velocities"),
    ]
    .into_iter()
    .enumerate()
    {
        let values = rows.iter().flat_map(|row| row[signal * lags..][..lags].to_vec()).collect();
        own.parameters.push(CParameter::rows(name, unit, format!("{what}, by copy"), copies, values));
    }
    own.fragments = vec![weights.to_owned(), "force_lpv".to_owned()];
    own
}

fn of_network(network: &Network) -> Force {
    let (structure, scaling) = (network.structure(), network.scaling());
    let (lags, force_lags, hidden, inputs) =
        (structure.input_lags(), structure.force_lags(), structure.hidden(), network.inputs());
    let weights = network.weights();
    let (matrix, rest) = weights.split_at(hidden * inputs);
    let (hidden_bias, rest) = rest.split_at(hidden);
    let (output, rest) = rest.split_at(hidden);
    let (x, v) = (scaling.displacement_m, scaling.velocity_m_s);
    let mut parameters = vec![
        CParameter::scalar("displacement_mean_m", "m", "mean of the displacements", x.mean),
        CParameter::scalar("displacement_deviation_m", "m", "deviation of the displacements", x.deviation),
        CParameter::scalar("velocity_mean_m_s", "m/s", "mean of the velocities", v.mean),
        CParameter::scalar("velocity_deviation_m_s", "m/s", "deviation of the velocities", v.deviation),
    ];
    if let Some((kind, drive)) = scaling.drive {
        let (suffix, unit) = (kind.unit_suffix(), kind.unit());
        parameters.push(CParameter::scalar(
            format!("drive_mean_{suffix}"),
            unit,
            "mean of the drives",
            drive.mean,
        ));
        let about = "deviation of the drives";
        parameters.push(CParameter::scalar(
            format!("drive_deviation_{suffix}"),
            unit,
            about,
            drive.deviation,
        ));
    }
    parameters.extend([
        CParameter::scalar("force_deviation_n", "N", "deviation of the forces", scaling.force_deviation_n),
        CParameter::rows("hidden_weights", "", "W, by input and hidden neuron", inputs, matrix.to_vec()),
        CParameter::array("hidden_bias", "", "b", hidden_bias),
        CParameter::array("output_weights", "", "c", output),
        CParameter::scalar("output_bias", "", "c0", rest[0]),
    ]);
    if structure.has_input_neurons() {
        let (gain, bias) = rest[1..].split_at(inputs);
        parameters.push(CParameter::array("input_gain", "", "a, of the input neurons", gain));
        parameters.push(CParameter::array("input_bias", "", "d, of the input neurons", bias));
    }
    Force {
        fragments: vec!["force_network".to_owned()],
        sizes: vec![
            ("LAGS", lags, "lags of each input"),
            ("FORCE_LAGS", force_lags, "lags of the force"),
            ("DEPTH", lags.max(force_lags), "samples that the model remembers"),
            ("INPUTS", inputs, "inputs of the network"),
            ("HIDDEN", hidden, "hidden neurons"),
        ],
        parameters,
        feature: Some(("HAS_INPUT_NEURONS", structure.has_input_neurons())),
        ..Force::default()
    }
}

fn of_slip(slip: &MaxwellSlip) -> Force {
    let functions = slip.functions();
    let rows = |of: fn(&SlipFunction) -> Vec<f64>| -> Vec<f64> { functions.iter().flat_map(of).collect() };
    let mut own = Force::default();
    own.parameters.extend([
        CParameter::array(
            "knot_speeds_m_s",
            "m/s",
            "knots of the damping curve, increasing",
            slip.grid().knot_speeds_m_s(),
        ),
        CParameter::array(
            "bristle_lengths_m",
            "m",
            "ways on which the bristles yield",
            slip.grid().bristle_lengths_m(),
        ),
        CParameter::rows(
            "damping_slopes_n_s_m",
            "N s/m",
            "slopes of the damping curve, by set",
            functions.len(),
            rows(|f| f.damping_slopes_n_s_m.to_vec()),
        ),
        CParameter::rows(
            "bristle_forces_n",
            "N",
            "forces of bristles that slip, by set",
            functions.len(),
            rows(|f| f.bristle_forces_n.to_vec()),
        ),
        CParameter::array(
            "stiffness_n_m",
            "N/m",
            "springs in parallel, by set",
            &rows(|f| vec![f.stiffness_n_m]),
        ),
        CParameter::array("set_offset_n", "N", "constants, by set", &rows(|f| vec![f.set_offset_n])),
    ]);
    own.fragments.push("force_slip".to_owned());
    if let Some(sets) = slip.sets() {
        own.sizes.push(("SETS", sets.len(), "fuzzy sets over the drive"));
        own.parameters.extend(memberships(sets));
        own.fragments[0] = "force_slip_fuzzy".to_owned();
    }
    own
}

/// The numbers of a set, in the order of its fields.
fn set_numbers(set: TskSet) -> Vec<f64> {
    match set {
        TskSet::Gaussian { centre, sigma } => vec![centre, sigma],
        TskSet::Triangle { left, peak, right } => vec![left, peak, right],
        TskSet::Bell { half_width, exponent, centre } => vec![half_width, exponent, centre],
        TskSet::Trapezoid { left_foot, left_shoulder, right_shoulder, right_foot } => {
            vec![left_foot, left_shoulder, right_shoulder, right_foot]
        }
        TskSet::TwoSidedGaussian { left_sigma, left_centre, right_sigma, right_centre } => {
            vec![left_sigma, left_centre, right_sigma, right_centre]
        }
    }
}

/// The fragment of a shape, its function, and what its numbers are.
const fn shape_code(shape: SetShape) -> (&'static str, &'static str) {
    match shape {
        SetShape::Gaussian => ("gaussian", "centre, sigma"),
        SetShape::Triangle => ("triangle", "left foot, peak, right foot"),
        SetShape::Bell => ("bell", "half width, exponent, centre"),
        SetShape::Trapezoid => ("trapezoid", "left foot, left shoulder, right shoulder, right foot"),
        SetShape::TwoSidedGaussian => ("two_sided", "left sigma, left centre, right sigma, right centre"),
    }
}

fn of_tsk(tsk: &Tsk) -> Force {
    let inputs = tsk.inputs();
    let count = |index: usize| inputs.get(index).map_or(1, TskInput::len);
    let width = tsk.order().width(inputs.len());
    let mut own = Force {
        sizes: vec![
            ("SETS_1", count(0), "fuzzy sets of the first input"),
            ("SETS_2", count(1), "fuzzy sets of the second input"),
            ("SETS_3", count(2), "fuzzy sets of the third input"),
            ("CONCLUSION", width, "numbers of a rule's conclusion"),
        ],
        ..Force::default()
    };
    let mut fire = "/* Normalised inputs, and the weights of their sets. */
static void mrd_tsk_fire(const mrd_parameters *p, const mrd_model_inputs *in, double u[3], double w[3][5]) {
"
    .to_owned();
    let shares = |fire: &mut String, index: usize, len: usize| {
        *fire += &format!("    mrd_tsk_share(u[{index}], {len}, w[{index}]);\n");
    };
    for (index, input) in inputs.iter().enumerate() {
        let (signal, suffix) = (input.signal(), input.signal().unit_suffix());
        let name = signal.name();
        let field = match signal {
            Signal::Displacement => "displacement_m",
            Signal::Velocity => "velocity_m_s",
            Signal::Acceleration => "acceleration_m_s2",
            Signal::Drive(_) | Signal::Force => "drive",
        };
        let unit = match signal {
            Signal::Displacement => "m",
            Signal::Velocity => "m/s",
            Signal::Acceleration => "m/s2",
            Signal::Drive(kind) => kind.unit(),
            Signal::Force => "N",
        };
        let (shape, numbers) = shape_code(input.shape());
        own.parameters.extend([
            CParameter::scalar(
                format!("{name}_mean_{suffix}"),
                unit,
                format!("mean of {name}"),
                input.mean(),
            ),
            CParameter::scalar(
                format!("{name}_std_dev_{suffix}"),
                unit,
                format!("deviation of {name}"),
                input.std_dev(),
            ),
            CParameter::rows(
                format!("{name}_sets"),
                "",
                format!("fuzzy sets of the normalised {name}: {numbers}"),
                input.len(),
                input.sets().flat_map(set_numbers).collect(),
            ),
        ]);
        fire += &format!(
            "    u[{index}] = (in->{field} - p->{name}_mean_{suffix}) / p->{name}_std_dev_{suffix};\n"
        );
        if input.len() > 1 {
            fire += &format!(
                "    mrd_tsk_{shape}(p->{name}_sets, {}, mrd_clamp(u[{index}], -1e6, 1e6), w[{index}]);\n",
                input.len()
            );
            own.fragments.push(format!("tsk_{shape}"));
        }
        shares(&mut fire, index, input.len());
    }
    fire += "}\n";
    own.parameters.extend([
        CParameter::rows(
            "conclusions",
            "",
            "of each rule; the first input's set varies slowest",
            tsk.rules(),
            tsk.conclusions().to_vec(),
        ),
        CParameter::scalar("force_mean_n", "N", "mean of the forces", tsk.output().mean_n),
        CParameter::scalar("force_std_dev_n", "N", "deviation of the forces", tsk.output().std_dev_n),
    ]);
    own.fragments.extend(["tsk_share".to_owned(), "force_tsk".to_owned()]);
    own.glue = fire;
    own
}

fn of_lazy(lazy: &Lazy) -> Force {
    let metric = lazy.metric();
    let points: Vec<LazyPoint> = lazy.points().collect();
    let column = |of: fn(&LazyPoint) -> f64| -> Vec<f64> { points.iter().map(of).collect() };
    let mut own = Force {
        fragments: vec!["force_lazy".to_owned()],
        sizes: vec![
            ("POINTS", points.len(), "points of the memory"),
            ("LEAST_NEIGHBOURS", lazy.neighbours()[0], "fewest points of a local regression"),
            ("MOST_NEIGHBOURS", lazy.neighbours()[1], "most points of a local regression"),
        ],
        ..Force::default()
    };
    own.parameters.extend([
        CParameter::scalar("displacement_scale_m", "m", "unit of distance", metric.displacement_scale_m),
        CParameter::scalar("velocity_scale_m_s", "m/s", "unit of distance", metric.velocity_scale_m_s),
        CParameter::array(
            "memory_displacement_m",
            "m",
            "displacements of the points",
            &column(|p| p.displacement_m),
        ),
        CParameter::array(
            "memory_velocity_m_s",
            "m/s",
            "velocities of the points",
            &column(|p| p.velocity_m_s),
        ),
        CParameter::array(
            "memory_force_n",
            "N",
            "forces of the points, without the offset",
            &column(|p| p.force_n),
        ),
    ]);
    if let Some((kind, scale)) = metric.drive_scale {
        let (suffix, unit) = (kind.unit_suffix(), kind.unit());
        own.parameters.push(CParameter::scalar(
            format!("drive_scale_{suffix}"),
            unit,
            "unit of distance",
            scale,
        ));
        own.parameters.push(CParameter::array(
            format!("memory_drive_{suffix}"),
            unit,
            "drives of the points",
            &column(|p| p.drive),
        ));
    }
    own
}
