//! A model as C source: header and source file.

mod parameters;

use crate::arm::SUM_FILE;
use crate::error::ExportError;
use crate::features::Features;
use crate::forces::Force;
use crate::fragment::{Fragment, link, resolve};
use crate::inverse::Inverse;
use crate::parameter::CParameter;
use crate::precision::{Precision, single};
use crate::terms::TermCode;
use mr_damper_model::condition::{ApplyTo, VelocitySource};
use mr_damper_model::effect::{Effect, EffectModel, Need};
use mr_damper_model::force::ForceModel;
use mr_damper_model::inverse::InverseParts;
use mr_damper_model::model::Model;
use mr_damper_model::pipeline::Settings;
use mr_damper_model::sample::DriveKind;
use std::fmt::Write as _;

/// Longest name of an export.
const LONGEST_NAME: usize = 40;

/// A model to be exported.
///
/// ```
/// use mr_damper_export::CExport;
/// use mr_damper_model::preset;
///
/// let model = preset::load(preset::BEST_FUZZY_TANH)?;
/// let source = CExport::new("damper", &model).provenance("preset thesis/fuzzy-tanh/rp3-cs").source().expect("it is exported");
/// assert!(source.header.contains("bool damper_step(const damper_parameters *parameters, damper_state *state"));
/// assert!(source.source.contains("preset thesis/fuzzy-tanh/rp3-cs"));
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct CExport<'a> {
    name: String,
    model: &'a Model,
    settings: Settings,
    inverse: Option<InverseParts>,
    precision: Precision,
    corrects_stamps: bool,
    provenance: Vec<String>,
}

/// The files of an export.
#[derive(Debug, Clone, PartialEq)]
pub struct CSource {
    /// The name, which all names in the files begin with.
    pub name: String,
    /// `NAME.h`.
    pub header: String,
    /// `NAME.c`.
    pub source: String,
    /// Type of its numbers.
    pub precision: Precision,
    /// The model with its effects, in one line.
    pub title: String,
    /// Where the model comes from, line by line.
    pub provenance: Vec<String>,
    /// Rate of the model's training data, Hz; 0 if it is not known.
    pub rate_hz: f64,
    /// The fields of the parameters' structure, in order.
    pub parameters: Vec<CParameter>,
    /// The drive, if the model needs one.
    pub drive: Option<DriveKind>,
    /// True if the step has a measured velocity among its inputs.
    pub needs_velocity: bool,
    /// True if the step has the case temperature among its inputs.
    pub needs_temperature: bool,
    /// True if the step has a requested force among its inputs, and commands a current.
    pub has_inverse: bool,
    /// True if the inverse is a learned one, so that the output says where the search gave the current.
    pub has_learned_inverse: bool,
}

impl CSource {
    /// `text` with the names of this export.
    pub(crate) fn named(&self, text: &str) -> String {
        named(&self.name, text)
    }
}

/// An effect in the source.
struct Level<'a> {
    /// Its name in the code: 1 for the effect next to the model; in the model of the inverse, i1.
    name: String,
    fragment: String,
    effect: &'a EffectModel,
    /// Name of each parameter's field.
    fields: Vec<String>,
    /// True for a series spring directly around a model that gives its slope: it takes Newton steps.
    takes_newton: bool,
}

impl<'a> CExport<'a> {
    /// `model` under `name`, with the service's default settings.
    #[must_use]
    pub fn new(name: &str, model: &'a Model) -> Self {
        Self {
            name: name.to_owned(),
            model,
            settings: Settings::default(),
            inverse: None,
            precision: Precision::default(),
            corrects_stamps: false,
            provenance: Vec::new(),
        }
    }

    /// With limits and timeouts of other settings.
    #[must_use]
    pub fn settings(self, settings: &Settings) -> Self {
        Self { settings: *settings, ..self }
    }

    /// With the inverse controller of these [`parts`](mr_damper_model::inverse::InverseController::parts), which must belong to the model.
    #[must_use]
    pub fn inverse(self, parts: &InverseParts) -> Self {
        Self { inverse: Some(*parts), ..self }
    }

    /// With numbers of this type.
    #[must_use]
    pub fn precision(self, precision: Precision) -> Self {
        Self { precision, ..self }
    }

    /// With the service's correction of stamps that jitter. Without it, a stamp is the time at which its displacement was taken.
    #[must_use]
    pub fn corrected_stamps(self) -> Self {
        Self { corrects_stamps: true, ..self }
    }

    /// With a line that says where the model comes from.
    #[must_use]
    pub fn provenance(mut self, line: impl Into<String>) -> Self {
        // The end of a comment within a comment would end it.
        self.provenance.push(line.into().replace("*/", "* /").replace(['\n', '\r'], " "));
        self
    }

    /// The files.
    ///
    /// # Errors
    /// [`ExportError::Name`], and [`ExportError::Precision`] for lazy learning in single precision.
    pub fn source(&self) -> Result<CSource, ExportError> {
        self.check_name()?;
        let model = self.model;
        if self.precision == Precision::Single && matches!(model.force, ForceModel::Lazy(_)) {
            return Err(ExportError::Precision { model: model.force.name() });
        }
        let mut features = Features::of(model);
        features.set("SINGLE", self.precision == Precision::Single);
        features.set("CORRECTS_STAMPS", self.corrects_stamps);
        let force = Force::of(&model.force);
        if let Some((name, value)) = force.feature {
            features.set(name, value);
        }
        let inverse = self.inverse.as_ref().map(|parts| Inverse::of(model, parts));
        features.set("HAS_INVERSE", inverse.is_some());
        features.set("INVERSE_LEARNED", false);
        if let Some(inverse) = &inverse {
            inverse.set(&mut features, model);
        }
        let levels = self.levels(&force);
        let inverse_levels =
            inverse.as_ref().map_or(Vec::new(), |inverse| inverse_levels(&levels, &inverse.kept, &force));
        let of_damper = model.effects.of_damper().as_slice().len();
        let terms = (!model.effects.terms().is_empty())
            .then(|| TermCode::of(model.effects.terms().iter(), of_damper, model.force.drive()));

        let mut names: Vec<&str> = vec!["bits"];
        names.extend(self.conditioning_fragments());
        names.extend(force.fragments.iter().map(String::as_str));
        let of_force = link(&names, self.precision)?;
        names.extend(levels.iter().map(|level| level.fragment.as_str()));
        if levels.iter().chain(&inverse_levels).any(|level| level.takes_newton) {
            names.push("spring_newton");
        }
        names.extend(terms.iter().flat_map(|terms| &terms.fragments));
        names.extend(inverse.iter().flat_map(|inverse| &inverse.fragments));
        if self.corrects_stamps {
            names.push("timing");
        }
        names.push("step");
        let fragments = link(&names, self.precision)?;

        let mut parameters = self.parameters(&force, &levels, terms.as_ref());
        parameters.extend(inverse.iter().flat_map(|inverse| inverse.parameters(&self.settings)));
        let text = Text { export: self, features: &features };
        let parts = Parts {
            force,
            levels,
            of_damper,
            terms,
            inverse,
            inverse_levels,
            parameters,
            fragments,
            of_force: of_force.len(),
        };
        let header = text.finish(&self.header(&parts))?;
        let source = text.finish(&self.body(&parts)?)?;
        Ok(CSource {
            name: self.name.clone(),
            precision: self.precision,
            header,
            source,
            title: self.title(),
            provenance: self.provenance.clone(),
            rate_hz: model.rate_hz,
            parameters: parts.parameters,
            drive: model.force.drive(),
            needs_velocity: model.conditioning.velocity == VelocitySource::Measured,
            needs_temperature: model.effects.need(Need::CaseTemperature),
            has_inverse: self.inverse.is_some(),
            has_learned_inverse: parts.inverse.as_ref().is_some_and(Inverse::is_learned),
        })
    }

    /// The model with its effects.
    fn title(&self) -> String {
        let model = self.model;
        let effects: Vec<String> =
            model.effects.as_slice().iter().map(|effect| effect.effect().title()).collect();
        let effects =
            if effects.is_empty() { String::new() } else { format!(" with {}", effects.join(", ")) };
        format!("Model {}{effects}", model.force.name())
    }

    fn check_name(&self) -> Result<(), ExportError> {
        let mut letters = self.name.chars();
        let begins = letters.next().is_some_and(|c| c.is_ascii_alphabetic());
        let is_name = begins
            && letters.all(|c| c.is_ascii_alphanumeric() || c == '_')
            && self.name.len() <= LONGEST_NAME;
        if is_name { Ok(()) } else { Err(ExportError::Name { name: self.name.clone() }) }
    }

    fn conditioning_fragments(&self) -> Vec<&'static str> {
        let conditioning = &self.model.conditioning;
        let mut names = Vec::new();
        if conditioning.apply_to != ApplyTo::None {
            names.push("low_pass");
        }
        match conditioning.velocity {
            VelocitySource::Backward => names.push("derivative_backward"),
            VelocitySource::ThreePoint => names.push("derivative_three_point"),
            VelocitySource::Slope => names.push("derivative_slope"),
            VelocitySource::Measured => {}
        }
        names
    }

    fn levels(&self, force: &Force) -> Vec<Level<'a>> {
        let effects = self.model.effects.as_slice();
        let level = |(index, effect): (usize, &'a EffectModel)| {
            let kind = effect.effect();
            let fragment = match kind {
                Effect::SeriesSpring => "series_spring",
                Effect::SensorDelay if effect.parameters()[0] < 0.0 => "sensor_delay_of_displacement",
                Effect::SensorDelay => "sensor_delay_of_force",
                Effect::CoilLagRiseFall => "coil_lag_rise_fall",
                Effect::FrictionOwnScale => "friction_own_scale",
                other => other.id(),
            };
            let same = |other: &&EffectModel| other.effect().id() == kind.id();
            let place = if effects.iter().filter(same).count() > 1 {
                format!("_{}", index + 1)
            } else {
                String::new()
            };
            let fields =
                kind.parameters().iter().map(|parameter| format!("{}{place}_{}", kind.id(), parameter.name));
            Level {
                name: (index + 1).to_string(),
                fragment: format!("effect_{fragment}"),
                effect,
                fields: fields.collect(),
                takes_newton: kind == Effect::SeriesSpring && index == 0 && force.has_slope,
            }
        };
        effects.iter().enumerate().map(level).collect()
    }

    fn header(&self, parts: &Parts<'_>) -> String {
        let Parts { force, levels, parameters, fragments, .. } = parts;
        let mut sizes = String::new();
        let of_inverse = parts.inverse.iter().flat_map(Inverse::sizes);
        for (name, value, about) in force.sizes.iter().copied().chain(of_inverse) {
            let _ = writeln!(sizes, "#define MRD_{name} {value} /* {about} */");
        }
        let fields: String = parameters.iter().map(CParameter::declaration).collect();
        let mut types = String::new();
        let mut inverse_types = String::new();
        for fragment in fragments.iter().filter(|fragment| !fragment.header.trim().is_empty()) {
            let target = if fragment.name == "inverse" { &mut inverse_types } else { &mut types };
            let _ = writeln!(target, "{}{}", fragment.about, fragment.header.trim_end());
            target.push('\n');
        }
        let states_of = |levels: &[Level<'_>]| {
            let mut states = String::new();
            for level in levels {
                if let Some(name) = state_type(level, fragments) {
                    let _ = writeln!(states, "    {name} effect_{};", level.name);
                }
            }
            if parts.terms.is_some() {
                states += "    mrd_terms_state terms;\n";
            }
            states
        };
        let states = states_of(levels);
        let chain = match parts.has_own_chain() {
            true => format!(
                "/* The model of the inverse: without the lag of the coil. */\ntypedef struct {{\n    mrd_force_state force;\n{}}} mrd_inverse_chain;\n\n",
                states_of(&parts.inverse_levels)
            ),
            false => "typedef mrd_chain mrd_inverse_chain;\n\n".to_owned(),
        };
        include_str!("c/header.h")
            .replace("@PREFACE@\n", &self.preface(".h"))
            .replace("@SIZES@\n", &sizes)
            .replace("@PARAMETERS@", &fields)
            .replace("@TYPES@\n", &types)
            .replace("@EFFECT_STATES@", &states)
            .replace("@INVERSE_TYPES@\n", &(chain + &inverse_types))
    }

    /// The comment at the head of each file.
    fn preface(&self, ending: &str) -> String {
        let mut lines = vec![
            format!("{}{ending}: force of a magneto-rheological damper.", self.name),
            format!("{}.", self.title()),
        ];
        lines.extend(self.provenance.iter().cloned());
        lines.push(
            "Written by `mr-damper export`. C99; needs no C library, no heap and no globals.".to_owned(),
        );
        lines.extend(match self.precision {
            Precision::Double => vec![
                "double throughout: the bits of the service. On an Arm processor without an FPU for doubles,"
                    .to_owned(),
                format!("GCC's sums need {SUM_FILE}; it says why, and how to link it."),
            ],
            Precision::Single => vec!["float throughout: the service computes in double.".to_owned()],
        });
        format!("/* {} */\n", lines.join("\n   "))
    }

    fn body(&self, parts: &Parts<'_>) -> Result<String, ExportError> {
        let Parts { force, levels, parameters, fragments, .. } = parts;
        let mut body = self.preface(".c") + include_str!("c/preamble.c");
        let defaults: Vec<String> = parameters.iter().map(CParameter::initialiser).collect();
        let _ = write!(
            body,
            "\nconst mrd_parameters mrd_default_parameters = {{\n{}\n}};\n",
            defaults.join(",\n")
        );
        let (mut is_glued, mut has_levels) = (force.glue.is_empty(), false);
        for (index, fragment) in fragments.iter().enumerate() {
            if fragment.name.starts_with("force_") && !is_glued {
                let _ = write!(body, "\n{}", force.glue);
                is_glued = true;
            }
            if index == parts.of_force {
                body += RUN_FORCE;
            }
            if !has_levels && (fragment.name == "step" || parts.begins_inverse(fragment.name)) {
                has_levels = true;
                let (damper, load_cell) = levels.split_at(parts.of_damper);
                for (index, level) in damper.iter().enumerate() {
                    body += &instance(level, &index.to_string(), fragments)?;
                }
                if let Some(terms) = &parts.terms {
                    body += &terms.code;
                }
                for (index, level) in load_cell.iter().enumerate() {
                    body += &instance(level, &parts.inside(parts.of_damper + index), fragments)?;
                }
                body += &parts.inverse_chain()?;
            }
            if !fragment.source.trim().is_empty() {
                let _ = write!(body, "\n{}{}", fragment.about, fragment.source);
            }
        }
        let of_damper = parts.inside(parts.of_damper);
        let fields: Vec<&[String]> = levels.iter().map(|level| level.fields.as_slice()).collect();
        let (coil, stiffness) = parts.inverse.as_ref().map_or(([""; 2], String::new()), |inverse| {
            (inverse.coil_fields(&fields), inverse.stiffness(self.model, &fields))
        });
        Ok(body
            .replace("@DAMPER@", &of_damper)
            .replace("@READING@", &parts.inside(levels.len()))
            .replace("@INVERSE@", &parts.inverse_damper())
            .replace("@COIL_RISE@", coil[0])
            .replace("@COIL_FALL@", coil[1])
            .replace("@STIFFNESS@", &stiffness))
    }
}

/// Everything that the files are written from.
struct Parts<'a> {
    force: Force,
    levels: Vec<Level<'a>>,
    /// Number of levels that are effects of the damper.
    of_damper: usize,
    terms: Option<TermCode>,
    inverse: Option<Inverse<'a>>,
    /// Levels of the model of the inverse.
    inverse_levels: Vec<Level<'a>>,
    parameters: Vec<CParameter>,
    fragments: Vec<Fragment>,
    /// Number of fragments that the force model needs.
    of_force: usize,
}

impl Parts<'_> {
    /// The name of level `number`: the terms are around the effects of the damper.
    fn inside(&self, number: usize) -> String {
        if number == self.of_damper && self.terms.is_some() { "terms".to_owned() } else { number.to_string() }
    }

    /// True if the model of the inverse differs from the model of the damper.
    fn has_own_chain(&self) -> bool {
        self.inverse.is_some() && self.inverse_levels.len() < self.of_damper
    }

    /// True for the first fragment that uses the model of the inverse.
    fn begins_inverse(&self, fragment: &str) -> bool {
        self.inverse.as_ref().is_some_and(|inverse| inverse.fragments[0] == fragment)
    }

    /// The outermost level of the model of the inverse.
    fn inverse_damper(&self) -> String {
        match (self.has_own_chain(), &self.terms) {
            (false, _) => self.inside(self.of_damper),
            (true, Some(_)) => "iterms".to_owned(),
            (true, None) => format!("i{}", self.inverse_levels.len()),
        }
    }

    /// The levels of the model of the inverse, if it is another one.
    fn inverse_chain(&self) -> Result<String, ExportError> {
        if !self.has_own_chain() {
            return Ok(String::new());
        }
        // The tanh functions of a model without effects need no chain.
        let is_bare = self.inverse_levels.is_empty() && self.terms.is_none();
        if is_bare && self.begins_inverse("inverse_still") {
            return Ok(String::new());
        }
        let mut code = RUN_FORCE.replace("mrd_run_0", "mrd_run_i0");
        for (index, level) in self.inverse_levels.iter().enumerate() {
            code += &instance(level, &format!("i{index}"), &self.fragments)?;
        }
        if let Some(terms) = &self.terms {
            let inside = format!("mrd_run_{}(", self.of_damper);
            let own = format!("mrd_run_i{}(", self.inverse_levels.len());
            code += &terms.level.replace(&inside, &own).replace("mrd_run_terms", "mrd_run_iterms");
        }
        Ok(code.replace("mrd_chain", "mrd_inverse_chain"))
    }
}

/// The innermost level: the force model.
const RUN_FORCE: &str = "
/* The force model without effects. */
static double mrd_run_0(const mrd_parameters *p, mrd_chain *c, const mrd_model_inputs *in) {
    return mrd_force(p, &c->force, in);
}
";

/// Name of the type of an effect's state, if it has one: the last type of its header.
fn state_type<'f>(level: &Level<'_>, fragments: &'f [Fragment]) -> Option<&'f str> {
    let fragment = fragments.iter().find(|fragment| fragment.name == level.fragment)?;
    let last = fragment.header.trim_end().lines().last()?;
    last.strip_prefix("} ")?.strip_suffix(';')
}

/// The levels of the model of the inverse: those in `kept`.
fn inverse_levels<'a>(levels: &[Level<'a>], kept: &[usize], force: &Force) -> Vec<Level<'a>> {
    let level = |(place, index): (usize, &usize)| {
        let Level { fragment, effect, fields, .. } = &levels[*index];
        Level {
            name: format!("i{}", place + 1),
            fragment: fragment.clone(),
            effect,
            fields: fields.clone(),
            takes_newton: effect.effect() == Effect::SeriesSpring && place == 0 && force.has_slope,
        }
    };
    kept.iter().enumerate().map(level).collect()
}

/// The code of one effect.
fn instance(level: &Level<'_>, inside: &str, fragments: &[Fragment]) -> Result<String, ExportError> {
    let fragment = fragments.iter().find(|fragment| fragment.name == level.fragment).ok_or_else(|| {
        ExportError::Fragment { fragment: level.fragment.clone(), what: "it is not linked".to_owned() }
    })?;
    let mut features = Features::default();
    features.set("SPRING_NEWTON", level.takes_newton);
    let mut code = format!("\n{}{}", fragment.about, resolve(&fragment.instance, &features)?)
        .replace("@K@", &level.name)
        .replace("@J@", inside);
    for (parameter, field) in level.effect.effect().parameters().iter().zip(&level.fields) {
        code = code.replace(&format!("@{}@", parameter.name), field);
    }
    Ok(code)
}

/// The last steps of every text.
struct Text<'a> {
    export: &'a CExport<'a>,
    features: &'a Features,
}

impl Text<'_> {
    fn finish(&self, text: &str) -> Result<String, ExportError> {
        let text = resolve(text, self.features)?;
        let drive = self.export.model.force.drive();
        let suffix = drive.map_or("", DriveKind::unit_suffix);
        let text = text
            .replace("@DRIVE@", drive.map_or("drive", DriveKind::name))
            .replace(
                "@DRIVE_ABOUT@",
                match drive {
                    Some(DriveKind::CommandVoltage) => "command voltage, V",
                    _ => "coil current, A",
                },
            )
            .replace("@NAME@", &self.export.name)
            .replace("@drive_range@", &format!("drive_range_{suffix}"));
        let text = [
            "membership_centres",
            "membership_sigma",
            "drive_mean",
            "drive_deviation",
            "drive_scale",
            "memory_drive",
        ]
        .iter()
        .fold(text, |text, name| text.replace(&format!("@{name}@"), &format!("{name}_{suffix}")));
        if let Some(at) = text.find('@') {
            let line = text[at..].lines().next().unwrap_or_default();
            return Err(ExportError::Fragment {
                fragment: line.to_owned(),
                what: "it is not filled in".to_owned(),
            });
        }
        let text = match self.export.precision {
            Precision::Double => text,
            Precision::Single => single(&text),
        };
        Ok(named(&self.export.name, &text))
    }
}

/// `text` with `name` in the place of `mrd`.
fn named(name: &str, text: &str) -> String {
    text.replace("mrd_", &format!("{name}_")).replace("MRD_", &format!("{}_", name.to_ascii_uppercase()))
}
