//! The terms of a model: C code for each, from its argument, form and modulator.

use crate::parameter::CParameter;
use mr_damper_model::effect::term::{Argument, Form, Modulator, Term};
use mr_damper_model::sample::DriveKind;
use std::fmt::Write as _;

/// The parts of the source of a model's terms.
#[derive(Debug, Default)]
pub(crate) struct TermCode {
    /// Fragments, besides those that they need.
    pub(crate) fragments: Vec<&'static str>,
    pub(crate) parameters: Vec<CParameter>,
    /// One function for each term, and what tells whether they extrapolate.
    pub(crate) code: String,
    /// The level around the effects of the damper.
    pub(crate) level: String,
}

/// The argument as an expression of the inputs `in` and the signals `s`, and the fragments that it needs.
const fn argument(argument: Argument) -> (&'static str, &'static [&'static str]) {
    match argument {
        Argument::Displacement => ("in->displacement_m", &[]),
        Argument::DisplacementMagnitude => ("mrd_abs(in->displacement_m)", &[]),
        Argument::DisplacementSignVelocity => {
            ("in->displacement_m * mrd_smooth_sign(in->velocity_m_s)", &["smooth_sign"])
        }
        Argument::Velocity => ("in->velocity_m_s", &[]),
        Argument::Speed => ("mrd_abs(in->velocity_m_s)", &[]),
        Argument::Acceleration => ("in->acceleration_m_s2", &[]),
        Argument::Drive => ("in->drive", &[]),
        Argument::Force => ("s->force_n", &[]),
        Argument::Time => ("s->time_s.sum", &[]),
        Argument::Path => ("s->path_m.sum", &[]),
        Argument::Energy => ("s->energy_j.sum", &[]),
        Argument::TemperatureRise => ("in->case_temp_c - s->first_temp_c", &[]),
        Argument::Travel => ("in->displacement_m - s->turn_m", &[]),
        Argument::TimeSinceReversal => ("s->direction * (s->time_s.sum - s->turn_s)", &[]),
        Argument::TimeSinceDriveChange => ("s->time_s.sum - s->changed_s", &[]),
        Argument::DriveChange => ("in->drive - s->lagged_drive", &[]),
        Argument::MeanSpeed => ("s->mean_speed_m_s", &[]),
    }
}

/// The form as an expression of the argument `q` and its parameters `A` and `B`, and the fragments that it needs.
const fn form(form: Form) -> (&'static str, &'static [&'static str]) {
    match form {
        Form::Constant => ("1.0", &[]),
        Form::Linear => ("q", &[]),
        Form::Quadratic => ("q * q", &[]),
        Form::Step => ("mrd_term_step((q - A) / B)", &["term_step"]),
        Form::HingeAbove => ("mrd_max(q - A, 0.0)", &["max"]),
        Form::HingeBelow => ("mrd_max(A - q, 0.0)", &["max"]),
        Form::Ramp => ("mrd_clamp((q - A) / B, 0.0, 1.0)", &["clamp"]),
        Form::Decay => ("mrd_exp(-mrd_abs(q) / A)", &["exp"]),
        Form::Growth => ("mrd_exp_m1(q / A)", &["exp_m1"]),
        Form::Tanh => ("mrd_tanh(q / A)", &["tanh"]),
        Form::Bump => ("mrd_term_bump((q - A) / B)", &["term_bump"]),
        Form::Window => ("mrd_term_step((A - mrd_abs(q)) / (A * 0.1))", &["term_step"]),
        Form::Deadband => ("q - mrd_max(mrd_min(q, A), -A)", &["max", "min"]),
        Form::Sine => ("mrd_sin((q - A) / B * 6.283185307179586)", &["sin"]),
        Form::Staircase => ("mrd_floor(q / A)", &["floor"]),
        Form::Resonance => ("mrd_resonator_step(&s->filters[FILTER], A, B, s->step_s, q)", &["resonator"]),
    }
}

/// The factor of a term that adds a force, and the fragments that it needs.
const fn modulator(modulator: Modulator) -> (&'static str, &'static [&'static str]) {
    const SIGN: &[&str] = &["smooth_sign"];
    match modulator {
        Modulator::One | Modulator::ForcePerDrive | Modulator::ForcePerVelocity => ("1.0", &[]),
        Modulator::Force => ("s->force_n", &[]),
        Modulator::ForceInExtension => {
            ("(s->force_n * (mrd_smooth_sign(in->velocity_m_s) + 1.0) * 0.5)", SIGN)
        }
        Modulator::ForceInCompression => {
            ("(s->force_n * (-mrd_smooth_sign(in->velocity_m_s) + 1.0) * 0.5)", SIGN)
        }
        Modulator::SignVelocity => ("mrd_smooth_sign(in->velocity_m_s)", SIGN),
        Modulator::Velocity => ("in->velocity_m_s", &[]),
        Modulator::Displacement => ("in->displacement_m", &[]),
        Modulator::Acceleration => ("in->acceleration_m_s2", &[]),
        Modulator::Drive => ("in->drive", &[]),
        Modulator::DriveSignVelocity => ("(in->drive * mrd_smooth_sign(in->velocity_m_s))", SIGN),
    }
}

impl TermCode {
    /// The code of `terms` around the level `inner`.
    pub(crate) fn of<'t>(
        terms: impl Iterator<Item = &'t Term>,
        inner: usize,
        drive: Option<DriveKind>,
    ) -> Self {
        let mut own = Self { fragments: vec!["terms"], ..Self::default() };
        let (mut before, mut after) = (String::new(), String::new());
        for (index, term) in terms.enumerate() {
            let (acts, by, shape) = term.kind();
            let (q, q_needs) = argument(by);
            let (curve, curve_needs) = form(shape);
            let (factor, factor_needs) = modulator(acts);
            own.fragments.extend(q_needs.iter().chain(curve_needs).chain(factor_needs));
            let number = index + 1;
            let field = |name: &str| format!("term_{number}_{name}");
            own.parameters(term, number, drive);
            let parameters = shape.parameters();
            let letters = ["A", "B"].iter().zip(parameters);
            let curve = letters.fold(curve.to_owned(), |text, (letter, parameter)| {
                text.replace(&format!("-{letter})"), &format!("-p->{})", field(parameter.name)))
                    .replace(&format!("{letter} "), &format!("p->{} ", field(parameter.name)))
                    .replace(&format!("{letter})"), &format!("p->{})", field(parameter.name)))
                    .replace(&format!("{letter},"), &format!("p->{},", field(parameter.name)))
            });
            let curve = curve.replace("FILTER", &index.to_string());
            let (range, amount) = (field("confirmed_in"), field("amount"));
            let _ = write!(
                own.code,
                "
/* Term {number}: {}, {}, {}. */
static double mrd_term_{number}(const mrd_parameters *p, mrd_terms_state *s, const mrd_model_inputs *in) {{
    const double q = {q};
    (void)in;
    if (q < p->{range}[0] || q > p->{range}[1]) {{
        s->extrapolates = true;
    }}
    return p->{amount} * ({curve});
}}
",
                acts.name(),
                by.name(),
                shape.name()
            );
            match acts {
                Modulator::ForcePerVelocity => {
                    let _ = writeln!(
                        before,
                        "    own.velocity_m_s = own.velocity_m_s + mrd_term_{number}(p, s, in);"
                    );
                }
                Modulator::ForcePerDrive => {
                    let _ = writeln!(before, "    own.drive = own.drive + mrd_term_{number}(p, s, in);");
                }
                _ => {
                    let _ = writeln!(after, "    sum_n = sum_n + mrd_term_{number}(p, s, in) * {factor};");
                }
            }
        }
        own.level = format!(
            "
/* The terms, around all effects of the damper. */
static double mrd_run_terms(const mrd_parameters *p, mrd_chain *c, const mrd_model_inputs *in) {{
    mrd_terms_state *s = &c->terms;
    mrd_model_inputs own = *in;
    double force_n, sum_n;
    mrd_signals_before_force(s, in);
    s->extrapolates = false;
{before}    force_n = mrd_run_{inner}(p, c, &own);
    if (!mrd_is_finite(force_n)) {{
        return force_n;
    }}
    mrd_signals_after_force(s, in, force_n - p->force_offset_n);
    sum_n = force_n;
{after}    return sum_n;
}}
"
        );
        own.code += &own.level;
        own.code.push_str(
            "
static bool mrd_terms_extrapolate(const mrd_chain *c) {
    return c->terms.extrapolates;
}
",
        );
        own
    }

    fn parameters(&mut self, term: &Term, number: usize, drive: Option<DriveKind>) {
        let (acts, by, shape) = term.kind();
        let drive_symbol = drive.map_or("", DriveKind::unit);
        let name = |what: &str| format!("term_{number}_{what}");
        let unit = acts.unit_of_curve().symbol().unwrap_or(drive_symbol);
        let about = format!("term {number}: amount of the {} over {}", shape.name(), by.name());
        self.parameters.push(CParameter::scalar(name("amount"), unit, about, term.amount()));
        for (parameter, value) in shape.parameters().iter().zip(term.parameters()) {
            let unit = parameter.unit(by).symbol().unwrap_or(drive_symbol);
            let about = format!("term {number}: {} of the {}", parameter.name, shape.name());
            let own = CParameter::scalar(name(parameter.name), unit, about, *value);
            self.parameters.push(if parameter.is_positive() {
                own.within([f64::MIN_POSITIVE, 1e300])
            } else {
                own
            });
        }
        let unit = by.unit().symbol().unwrap_or(drive_symbol);
        let about = format!("term {number}: range of the {} in which it was confirmed", by.name());
        self.parameters.push(CParameter::array(name("confirmed_in"), unit, about, &term.confirmed_in()));
    }
}
