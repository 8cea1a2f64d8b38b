//! Line-by-line parser of `.fis` text.

use super::{Fis, FisInput, piecewise, sets_of};
use crate::error::{Error, FisProblem, RuleProblem};
use crate::force::{MAX_CONCLUSIONS, MAX_INPUTS, MAX_SETS, Order, Shape, TskSet};
use std::collections::BTreeMap;

/// A value and the line it is on.
type At<T> = (usize, T);

/// One section: its keys (in lower case) and their values.
#[derive(Debug, Default)]
struct Section<'t> {
    line: usize,
    name: String,
    keys: BTreeMap<String, At<&'t str>>,
}

/// One line of `[Rules]`.
struct Rule {
    sets: Vec<usize>,
    conclusion: usize,
}

fn error(line: usize, problem: FisProblem) -> Error {
    Error::Fis { line, problem }
}

fn wrong_value(line: usize, key: &str, value: &str, expected: &str) -> Error {
    let (key, value, expected) = (key.to_owned(), value.to_owned(), expected.to_owned());
    error(line, FisProblem::Value { key, value, expected })
}

pub(super) fn parse(text: &str) -> Result<Fis, Error> {
    let (sections, rule_lines) = split(text)?;
    let section = |name: &str| {
        sections.get(&name.to_lowercase()).ok_or_else(|| {
            let section = name.to_owned();
            error(text.lines().count().max(1), FisProblem::MissingSection { section })
        })
    };
    let system = section("System")?;
    system.demand("Type", &["sugeno"])?;
    system.demand("AndMethod", &["prod"])?;
    system.demand("DefuzzMethod", &["wtaver"])?;
    let input_count = system.count("NumInputs", 1..=MAX_INPUTS)?;
    system.count("NumOutputs", 1..=1)?;
    let inputs = (1..=input_count)
        .map(|number| read_input(section(&format!("Input{number}"))?))
        .collect::<Result<Vec<_>, Error>>()?;
    let counts: Vec<usize> = inputs.iter().map(|input| input.sets.len()).collect();
    let output = section("Output1")?;
    let (order, functions) = read_output(output, input_count)?;
    let rules: usize = counts.iter().product();
    let (rule_line, declared) = system.integer("NumRules")?;
    if declared != rules {
        return Err(error(rule_line, FisProblem::RuleCount { found: declared, needed: rules }));
    }
    let chosen = read_rules(&rule_lines, &counts, functions.len())?;
    let conclusions = chosen.iter().flat_map(|conclusion| functions[*conclusion].clone()).collect();
    for known in sections.values() {
        let numbered = |prefix: &str, most: usize| {
            (1..=most).any(|number| known.name.eq_ignore_ascii_case(&format!("{prefix}{number}")))
        };
        if !(known.name.eq_ignore_ascii_case("System")
            || numbered("Input", input_count)
            || numbered("Output", 1))
        {
            return Err(error(known.line, FisProblem::ForeignSection { section: known.name.clone() }));
        }
    }
    Ok(Fis {
        name: system.text("Name")?,
        inputs,
        output_name: output.text("Name")?,
        output_range: output.range()?,
        order,
        conclusions,
    })
}

/// Sections by name in lower case, and the lines of `[Rules]`.
#[expect(clippy::type_complexity, reason = "two lists, used once")]
fn split(text: &str) -> Result<(BTreeMap<String, Section<'_>>, Vec<At<&str>>), Error> {
    let mut sections: BTreeMap<String, Section> = BTreeMap::new();
    let mut rules = Vec::new();
    let mut current: Option<String> = None;
    for (k, raw) in text.lines().enumerate() {
        let line = k + 1;
        let content = without_comment(raw).trim().trim_start_matches('\u{feff}');
        if content.is_empty() {
            continue;
        }
        if let Some(name) = content.strip_prefix('[').and_then(|rest| rest.strip_suffix(']')) {
            let name = name.trim();
            let key = name.to_lowercase();
            let section = Section { line, name: name.to_owned(), ..Section::default() };
            if key != "rules" && sections.insert(key.clone(), section).is_some() {
                return Err(error(line, FisProblem::RepeatedSection { section: name.to_owned() }));
            }
            current = Some(key);
            continue;
        }
        match current.as_deref() {
            None => return Err(error(line, FisProblem::BeforeFirstSection)),
            Some("rules") => rules.push((line, content)),
            Some(name) => {
                let Some((key, value)) = content.split_once('=') else {
                    return Err(error(line, FisProblem::NotAKey { text: content.to_owned() }));
                };
                let key = key.trim();
                if let Some(section) = sections.get_mut(name)
                    && section.keys.insert(key.to_lowercase(), (line, value.trim())).is_some()
                {
                    let (section, key) = (section.name.clone(), key.to_owned());
                    return Err(error(line, FisProblem::RepeatedKey { section, key }));
                }
            }
        }
    }
    Ok((sections, rules))
}

/// A line up to the first `%` or `#` outside quotes.
fn without_comment(line: &str) -> &str {
    let mut quote = None;
    for (at, c) in line.char_indices() {
        match (quote, c) {
            (None, '\'' | '"') => quote = Some(c),
            (Some(open), c) if open == c => quote = None,
            (None, '%' | '#') => return &line[..at],
            _ => {}
        }
    }
    line
}

impl Section<'_> {
    fn value(&self, key: &str) -> Result<At<&str>, Error> {
        let found = self.keys.get(&key.to_lowercase());
        found.copied().ok_or_else(|| {
            let (section, key) = (self.name.clone(), key.to_owned());
            error(self.line, FisProblem::MissingKey { section, key })
        })
    }

    fn text(&self, key: &str) -> Result<String, Error> {
        let (line, value) = self.value(key)?;
        unquoted(line, value).map(str::to_owned)
    }

    /// Checks that `key` is one of `needed`.
    fn demand(&self, key: &str, needed: &[&str]) -> Result<(), Error> {
        let (line, value) = self.value(key)?;
        let value = unquoted(line, value)?;
        if needed.iter().any(|needed| value.eq_ignore_ascii_case(needed)) {
            return Ok(());
        }
        let (value, expected) = (format!("'{value}'"), format!("'{}'", needed.join("' or '")));
        Err(error(line, FisProblem::Value { key: key.to_owned(), value, expected }))
    }

    fn integer(&self, key: &str) -> Result<At<usize>, Error> {
        let (line, value) = self.value(key)?;
        let number = value.parse().map_err(|_| wrong_value(line, key, value, "a whole number"))?;
        Ok((line, number))
    }

    fn count(&self, key: &str, range: std::ops::RangeInclusive<usize>) -> Result<usize, Error> {
        let (line, number) = self.integer(key)?;
        if range.contains(&number) {
            return Ok(number);
        }
        let expected = format!("{} to {}", range.start(), range.end());
        Err(wrong_value(line, key, &number.to_string(), &expected))
    }

    fn range(&self) -> Result<[f64; 2], Error> {
        let (line, value) = self.value("Range")?;
        match numbers(line, value)?[..] {
            [low, high] if low < high => Ok([low, high]),
            _ => Err(wrong_value(line, "Range", value, "two numbers, the lower first")),
        }
    }

    /// The functions MF1 to MFn: line, shape and numbers of each.
    fn functions(&self, most: usize) -> Result<Vec<(usize, String, Vec<f64>)>, Error> {
        let count = self.count("NumMFs", 1..=most)?;
        let function = |number: usize| {
            let (line, value) = self.value(&format!("MF{number}"))?;
            // 'name':'shape',[numbers]
            let wrong = || wrong_value(line, &format!("MF{number}"), value, "'name':'shape',[numbers]");
            let bracket = value.find('[').ok_or_else(wrong)?;
            let (head, list) = value.split_at(bracket);
            let head = head.trim_end().strip_suffix(',').ok_or_else(wrong)?;
            let (_, shape) = head.rsplit_once(':').ok_or_else(wrong)?;
            Ok((line, unquoted(line, shape.trim())?.to_lowercase(), numbers(line, list)?))
        };
        if let Some((key, (line, _))) = self.keys.iter().find(|(key, _)| {
            key.strip_prefix("mf").and_then(|n| n.parse().ok()).is_some_and(|n: usize| n > count)
        }) {
            return Err(error(*line, FisProblem::BeyondCount { key: key.to_uppercase(), count }));
        }
        (1..=count).map(function).collect()
    }
}

fn read_input(section: &Section) -> Result<FisInput, Error> {
    let range = section.range()?;
    let functions = section.functions(MAX_SETS)?;
    let lines: Vec<usize> = functions.iter().map(|(line, ..)| *line).collect();
    let shapes: Vec<String> = functions.iter().map(|(_, shape, _)| shape.clone()).collect();
    let mut sets = functions.into_iter().map(read_set).collect::<Result<Vec<_>, Error>>()?;
    let has = |shape| sets.iter().any(|set| set.shape() == shape);
    if has(Shape::Trapezoid) || (has(Shape::Triangle) && !piecewise::as_shoulders(&sets, range)) {
        sets = sets.into_iter().map(piecewise::without_shoulder).collect();
    } else if has(Shape::TwoSidedGaussian) {
        sets = sets.into_iter().map(two_sided).collect();
    }
    if let Some(j) = sets.iter().position(|set| set.shape() != sets[0].shape()) {
        let (shape, first) = (shapes[j].clone(), shapes[0].clone());
        return Err(error(lines[j], FisProblem::MixedMemberships { shape, first }));
    }
    let end = sets.len() - 1;
    for (j, (set, line)) in sets.iter().zip(&lines).enumerate() {
        set.check(&format!("MF{}", j + 1), j > 0, j < end).map_err(|why| match why {
            Error::OutOfRange { name, value, expected } => {
                wrong_value(*line, &name, &value.to_string(), expected)
            }
            other => other,
        })?;
    }
    if let Some([from, to]) = piecewise::gap(&sets, range) {
        let (line, _) = section.value("Range")?;
        return Err(error(line, FisProblem::Gap { from, to }));
    }
    Ok(FisInput { name: section.text("Name")?, range, sets })
}

/// A membership from its shape and numbers. The formulas do not depend on the sign of a width.
fn read_set((line, shape, numbers): (usize, String, Vec<f64>)) -> Result<TskSet, Error> {
    let needed = match (shape.as_str(), &numbers[..]) {
        ("gaussmf", &[sigma, centre]) => return Ok(TskSet::Gaussian { centre, sigma: sigma.abs() }),
        ("trimf", &[left, peak, right]) => return Ok(TskSet::Triangle { left, peak, right }),
        ("gbellmf", &[half_width, exponent, centre]) => {
            return Ok(TskSet::Bell { half_width: half_width.abs(), exponent, centre });
        }
        ("trapmf", &[left_foot, left_shoulder, right_shoulder, right_foot]) => {
            return Ok(TskSet::Trapezoid { left_foot, left_shoulder, right_shoulder, right_foot });
        }
        ("gauss2mf", &[left_sigma, left_centre, right_sigma, right_centre]) => {
            let (left_sigma, right_sigma) = (left_sigma.abs(), right_sigma.abs());
            return Ok(TskSet::TwoSidedGaussian { left_sigma, left_centre, right_sigma, right_centre });
        }
        ("gaussmf", _) => "2 (sigma, centre)",
        ("trimf", _) => "3 (foot, peak, foot)",
        ("gbellmf", _) => "3 (half width, exponent, centre)",
        ("trapmf", _) => "4 (foot, shoulder, shoulder, foot)",
        ("gauss2mf", _) => "4 (sigma, centre, sigma, centre)",
        _ => {
            let (of, known) = ("membership", "gaussmf, gauss2mf, gbellmf, trimf and trapmf");
            return Err(error(line, FisProblem::UnknownShape { of, shape, known }));
        }
    };
    let (found, needed) = (numbers.len(), needed.to_owned());
    Err(error(line, FisProblem::NumberCount { shape, found, needed }))
}

/// A Gaussian as a two-sided one; other sets stay.
fn two_sided(set: TskSet) -> TskSet {
    match set {
        TskSet::Gaussian { centre, sigma } => TskSet::TwoSidedGaussian {
            left_sigma: sigma,
            left_centre: centre,
            right_sigma: sigma,
            right_centre: centre,
        },
        other => other,
    }
}

/// Form of the conclusions, and the numbers of each.
fn read_output(section: &Section, inputs: usize) -> Result<(Order, Vec<Vec<f64>>), Error> {
    let functions = section.functions(MAX_CONCLUSIONS)?;
    let order = match functions[0].1.as_str() {
        "constant" => Order::Constant,
        "linear" => Order::First,
        other => {
            let (of, shape, known) = ("conclusion", other.to_owned(), "linear and constant");
            return Err(error(functions[0].0, FisProblem::UnknownShape { of, shape, known }));
        }
    };
    for (line, shape, numbers) in &functions {
        if *shape != functions[0].1 {
            let (form, first) = (shape.clone(), functions[0].1.clone());
            return Err(error(*line, FisProblem::MixedConclusions { form, first }));
        }
        if numbers.len() != order.width(inputs) {
            let (found, needed) = (numbers.len(), order.width(inputs).to_string());
            return Err(error(*line, FisProblem::NumberCount { shape: shape.clone(), found, needed }));
        }
    }
    Ok((order, functions.into_iter().map(|(_, _, numbers)| numbers).collect()))
}

/// The conclusion of each rule of the grid.
fn read_rules(lines: &[At<&str>], counts: &[usize], functions: usize) -> Result<Vec<usize>, Error> {
    let mut found: BTreeMap<Vec<usize>, usize> = BTreeMap::new();
    for (line, text) in lines {
        let rule = read_rule(*line, text, counts, functions)?;
        if found.insert(rule.sets, rule.conclusion).is_some() {
            return Err(error(*line, FisProblem::RepeatedRule));
        }
    }
    let last = lines.last().map_or(1, |(line, _)| *line);
    let rules = counts.iter().product();
    let one = |rule: usize| {
        let sets = sets_of(rule, counts);
        found.get(&sets).copied().ok_or_else(|| {
            error(last, FisProblem::MissingRule { memberships: sets.iter().map(|set| set + 1).collect() })
        })
    };
    (0..rules).map(one).collect()
}

/// A line such as `1 2 3, 6 (1) : 1`: sets, conclusion, weight, and connective (1 is "and").
fn read_rule(line: usize, text: &str, counts: &[usize], functions: usize) -> Result<Rule, Error> {
    let wrong = |problem| error(line, FisProblem::Rule { rule: text.to_owned(), problem });
    let (sets, rest) = text.split_once(',').ok_or_else(|| wrong(RuleProblem::Form))?;
    let (conclusion, rest) = rest.split_once('(').ok_or_else(|| wrong(RuleProblem::NoWeight))?;
    let (weight, connective) = rest.split_once(')').ok_or_else(|| wrong(RuleProblem::OpenParenthesis))?;
    if weight.trim().parse() != Ok(1.0) {
        return Err(wrong(RuleProblem::Weight));
    }
    let connective = connective.trim().strip_prefix(':').map(str::trim);
    if connective != Some("1") && counts.len() > 1 {
        return Err(wrong(RuleProblem::Connective));
    }
    let index = |text: &str, most: usize, of: &'static str| match text.trim().parse::<usize>() {
        Ok(number) if (1..=most).contains(&number) => Ok(number - 1),
        _ => Err(wrong(RuleProblem::Index { of, text: text.trim().to_owned(), most })),
    };
    let names: Vec<&str> = sets.split_whitespace().collect();
    if names.len() != counts.len() {
        return Err(wrong(RuleProblem::MembershipCount { found: names.len(), inputs: counts.len() }));
    }
    let sets = names
        .iter()
        .zip(counts)
        .map(|(name, most)| index(name, *most, "a membership"))
        .collect::<Result<_, Error>>()?;
    Ok(Rule { sets, conclusion: index(conclusion, functions, "the conclusion")? })
}

/// The text between quotes of either kind, or the unquoted value.
fn unquoted(line: usize, value: &str) -> Result<&str, Error> {
    let inner = match value.chars().next() {
        Some(quote @ ('\'' | '"')) => value[1..]
            .strip_suffix(quote)
            .ok_or_else(|| error(line, FisProblem::OpenQuote { text: value.to_owned() }))?,
        _ => value,
    };
    if inner.contains(['\'', '"']) {
        return Err(error(line, FisProblem::InnerQuote { text: value.to_owned() }));
    }
    Ok(inner)
}

/// A list such as `[1 2.5 -3e-2]`, separated by blanks or commas.
fn numbers(line: usize, list: &str) -> Result<Vec<f64>, Error> {
    let inner = list.trim().strip_prefix('[').and_then(|rest| rest.strip_suffix(']'));
    let inner = inner.ok_or_else(|| error(line, FisProblem::NotAList { text: list.to_owned() }))?;
    let number = |text: &str| match text.parse::<f64>() {
        Ok(number) if number.is_finite() => Ok(number),
        _ => Err(error(line, FisProblem::NotFinite { text: text.to_owned() })),
    };
    inner.split(|c: char| c == ',' || c.is_whitespace()).filter(|text| !text.is_empty()).map(number).collect()
}
