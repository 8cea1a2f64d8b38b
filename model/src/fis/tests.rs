use super::*;
use crate::force::{ForceModel, Inputs, MAX_SETS};
use crate::preset;

fn anfis(name: &str) -> Tsk {
    match preset::load(name).expect("a preset").force {
        ForceModel::Tsk(model) => model,
        other => panic!("{} is not an ANFIS model", other.name()),
    }
}

const SMALL: &str = "\
[System]
Name='small'
Type='sugeno'
Version=2.0
NumInputs=2
NumOutputs=1
NumRules=4
AndMethod='prod'
OrMethod='probor'
ImpMethod='prod'
AggMethod='sum'
DefuzzMethod='wtaver'

[Input1]
Name='velocity'
Range=[-3 3]
NumMFs=2
MF1='slow':'gaussmf',[1.5 -3]
MF2='fast':'gaussmf',[1.5 3]

[Input2]
Name='current'
Range=[0 2.5]
NumMFs=2
MF1='low':'gaussmf',[0.5 0]
MF2='high':'gaussmf',[0.5 2.5]

[Output1]
Name='force'
Range=[-4 4]
NumMFs=4
MF1='a':'linear',[0.1 0.2 0.3]
MF2='b':'linear',[1.1 1.2 1.3]
MF3='c':'linear',[2.1 2.2 2.3]
MF4='d':'linear',[3.1 3.2 3.3]

[Rules]
1 1, 1 (1) : 1
1 2, 2 (1) : 1
2 1, 3 (1) : 1
2 2, 4 (1) : 1
";

fn error_of(text: &str) -> String {
    Fis::parse(text).expect_err("a broken file").to_string()
}

#[test]
fn every_preset_is_bit_identical_after_write_and_read() {
    for experiment in preset::EXPERIMENTS {
        let model = anfis(&format!("thesis/anfis/{experiment}"));
        let text = Fis::of(&model, experiment).to_text();
        let read = Fis::parse(&text).unwrap_or_else(|e| panic!("{e}\n{text}"));
        assert_eq!(read, Fis::of(&model, experiment));
        let back = read.model(TskKind::Anfis, &Scaling::of(&model)).expect("a model");
        assert_eq!(back, model);
        for k in 0..200 {
            let t = f64::from(k);
            let inputs = Inputs {
                dt_s: None,
                displacement_m: 0.01 * (0.3 * t).sin(),
                velocity_m_s: 0.2 * (0.7 * t).cos(),
                acceleration_m_s2: f64::NAN,
                drive: 1.25 + 1.25 * (0.11 * t).sin(),
                case_temp_c: f64::NAN,
            };
            assert_eq!(back.force_n(&inputs).to_bits(), model.force_n(&inputs).to_bits());
        }
    }
}

#[test]
#[ignore = "needs the FIS files of the thesis: set MR_DAMPER_THESIS"]
fn the_fis_files_of_the_thesis_are_the_presets() {
    let root = std::env::var_os("MR_DAMPER_THESIS").map_or_else(
        || std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/thesis"),
        std::path::PathBuf::from,
    );
    for experiment in preset::EXPERIMENTS {
        let name = format!("thesis/anfis/{experiment}");
        let path = root.join(format!("anfis/{}.fis", experiment.to_uppercase().replace('-', "_")));
        let text = std::fs::read_to_string(&path).unwrap_or_else(|error| {
            panic!("no FIS file of the thesis at {}: {error}; set MR_DAMPER_THESIS", path.display())
        });
        let fis = Fis::parse(&text).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        let model = anfis(&name);
        let scaling = Scaling::of(&model);
        assert_eq!(fis.model(TskKind::Anfis, &scaling).expect("a model"), model, "{experiment}");
        let signals: Vec<Option<Signal>> = fis.inputs.iter().map(FisInput::signal).collect();
        assert_eq!(signals, scaling.inputs.iter().map(|(signal, ..)| Some(*signal)).collect::<Vec<_>>());
        let envelope = preset::load(&name).expect("a preset").envelope;
        let ranges = fis.envelope(&scaling);
        assert_eq!(
            (ranges.displacement_m, ranges.velocity_m_s),
            (envelope.displacement_m, envelope.velocity_m_s)
        );
    }
}

#[test]
fn ranges_are_the_envelope_in_normalised_units() {
    let model = anfis("thesis/anfis/rp1-cs");
    let envelope = preset::load("thesis/anfis/rp1-cs").expect("a preset").envelope;
    let scaling = Scaling::of(&model);
    let fis = Fis::of(&model, "x").with_ranges(&envelope, &scaling);
    // As printed in appendix C of the thesis.
    assert!((fis.inputs[0].range[0] + 3.422_376_303_281_06).abs() < 1e-12, "{:?}", fis.inputs[0].range);
    assert!((fis.output_range[1] - 3.966_328_229_395_64).abs() < 1e-12, "{:?}", fis.output_range);
    let close = |a: Option<[f64; 2]>, b: Option<[f64; 2]>| {
        let (a, b) = (a.expect("a range"), b.expect("a range"));
        a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12 * (1.0 + b.abs()))
    };
    let back = fis.envelope(&scaling);
    assert!(close(back.displacement_m, envelope.displacement_m), "{back:?}");
    assert!(close(back.velocity_m_s, envelope.velocity_m_s), "{back:?}");
    assert!(close(back.drive, envelope.drive) && close(back.force_n, envelope.force_n), "{back:?}");
    // Unknown ranges, and ranges without a width, stay.
    let narrow = Envelope { drive: Some([1.0, 1.0]), ..Envelope::default() };
    assert_eq!(Fis::of(&model, "x").with_ranges(&narrow, &scaling), Fis::of(&model, "x"));
}

#[test]
fn names_of_inputs_say_the_signal() {
    let signal = |name: &str| FisInput { name: name.to_owned(), range: [0.0, 1.0], sets: vec![] }.signal();
    for (name, expected) in [
        ("Displacement_(x)", Some(Signal::Displacement)),
        ("velocity", Some(Signal::Velocity)),
        ("ACCELERATION", Some(Signal::Acceleration)),
        ("current (A)", Some(Signal::Drive(DriveKind::CoilCurrent))),
        ("voltage", Some(Signal::Drive(DriveKind::CommandVoltage))),
        ("force", None),
        ("x", None),
        ("", None),
    ] {
        assert_eq!(signal(name), expected, "{name}");
    }
    for input in Fis::of(&anfis("thesis/anfis/rp1-cs"), "x").inputs {
        assert!(input.signal().is_some(), "{}", input.name);
    }
}

#[test]
fn an_input_with_one_set_survives_write_and_read() {
    let set = TskSet::Gaussian { centre: 0.5, sigma: 1.0 };
    let input = TskInput::new(Signal::Velocity, 0.0, 1.0, &[set]).expect("an input");
    let output = OutputScale { mean_n: 0.0, std_dev_n: 1.0 };
    let model = Tsk::new(TskKind::Anfis, &[input], Order::Constant, &[3.0], output, 0.0).expect("a model");
    let fis = Fis::of(&model, "one");
    assert_eq!(Fis::parse(&fis.to_text()).expect("reads what it wrote"), fis);
}

#[test]
fn triangles_and_constants_survive_write_and_read() {
    let set = |peak: f64| TskSet::Triangle { left: peak - 1.0, peak, right: peak + 1.0 / 3.0 };
    let sets = [set(-1.0), set(0.1), set(1.0)];
    let input = TskInput::new(Signal::Velocity, 0.1, 0.07, &sets).expect("an input");
    let output = OutputScale { mean_n: 0.0, std_dev_n: 400.0 };
    let conclusions = [-1.0 / 3.0, 1e-300, 2.5e17];
    let model =
        Tsk::new(TskKind::Anfis, &[input], Order::Constant, &conclusions, output, 3.0).expect("a model");
    let text = Fis::of(&model, "it's").to_text();
    let back = Fis::parse(&text).expect("reads").model(TskKind::Anfis, &Scaling::of(&model));
    assert_eq!(back.expect("a model"), model);
}

#[test]
fn syntax_that_matlab_tolerates_is_read() {
    let plain = Fis::parse(SMALL).expect("reads");
    assert_eq!(plain.conclusions[..3], [0.1, 0.2, 0.3]);
    assert_eq!(plain.inputs[0].sets[1], TskSet::Gaussian { centre: 3.0, sigma: 1.5 });
    let loose = SMALL
        .replace("Name='small'", "% the system\n  Name = \"small\"   # here")
        .replace("[1.5 -3]", "[ 1.5 ,  -3.0e0 ]")
        .replace("'slow':'gaussmf',", "'a:b % c' : 'gaussmf' , ")
        .replace("1 1, 1 (1) : 1\n", "")
        .replace("2 2, 4 (1) : 1\n", "2 2, 4 (1) : 1\n\n 1  1 ,1 (1.0):1\n")
        .replace('\n', "\r\n");
    assert_eq!(Fis::parse(&loose).expect("reads"), plain);
}

#[test]
fn errors_name_the_line() {
    for (from, to, expected) in [
        ("Type='sugeno'", "Type='mamdani'", "line 3: Type is 'mamdani', but must be 'sugeno'"),
        ("AndMethod='prod'", "AndMethod='min'", "line 8: AndMethod is 'min'"),
        ("DefuzzMethod='wtaver'", "DefuzzMethod='wtsum'", "line 12: DefuzzMethod is 'wtsum'"),
        ("NumInputs=2", "NumInputs=4", "line 5: NumInputs is 4, but must be 1 to 3"),
        ("NumOutputs=1", "NumOutputs=2", "line 6: NumOutputs is 2"),
        ("NumRules=4", "NumRules=3", "line 7: NumRules is 3"),
        ("NumRules=4\n", "", "line 1: [System] has no NumRules"),
        ("Range=[-3 3]", "Range=[3 -3]", "line 16: Range is [3 -3]"),
        ("[1.5 3]", "[1.5 3 4]", "line 19: gaussmf has 3 numbers, but needs 2"),
        ("[1.5 3]", "[1.5 x]", "line 19: \"x\" is not a finite number"),
        ("[1.5 3]", "[1.5 inf]", "line 19: \"inf\" is not a finite number"),
        ("[1.5 3]", "[1.5 3", "line 19: [1.5 3 is not a list"),
        (
            "'fast':'gaussmf'",
            "'fast':'sigmf'",
            "line 19: membership 'sigmf' is not known; known are gaussmf,",
        ),
        ("'fast':'gaussmf'", "'fast':'gbellmf'", "line 19: gbellmf has 2 numbers, but needs 3 (half width"),
        (
            "'fast':'gaussmf',[1.5 3]",
            "'fast':'gbellmf',[1.5 2 3]",
            "line 19: membership 'gbellmf' differs from",
        ),
        ("'gaussmf',[1.5 3]", "'gaussmf',[0 3]", "line 19: MF2.sigma is 0, but must be finite and at least"),
        (
            "'gaussmf',[1.5 3]",
            "'trapmf',[0 1 3]",
            "line 19: trapmf has 3 numbers, but needs 4 (foot, shoulder",
        ),
        ("'fast':'gaussmf'", "'fast' 'gaussmf'", "line 19: MF2 is"),
        ("NumMFs=2\nMF1='slow'", "NumMFs=1\nMF1='slow'", "line 19: MF2 is beyond NumMFs = 1"),
        ("'d':'linear'", "'d':'constant'", "line 35: conclusion 'constant' differs from the first, 'linear'"),
        ("[3.1 3.2 3.3]", "[3.1 3.3]", "line 35: linear has 2 numbers, but needs 3"),
        ("2 2, 4 (1) : 1", "2 1, 4 (1) : 1", "line 41: there is already a rule for these memberships"),
        ("2 2, 4 (1) : 1\n", "", "the rule for the memberships 2 2 is missing"),
        ("2 2, 4 (1) : 1", "2 2, 5 (1) : 1", "line 41: rule \"2 2, 5 (1) : 1\": the conclusion is \"5\""),
        ("2 2, 4 (1) : 1", "2 -2, 4 (1) : 1", "line 41: rule \"2 -2, 4 (1) : 1\": a membership is \"-2\""),
        ("2 2, 4 (1) : 1", "2 2, 4 (0.5) : 1", "has a weight other than 1"),
        ("2 2, 4 (1) : 1", "2 2, 4 (1) : 2", "must end in"),
        ("2 2, 4 (1) : 1", "2, 4 (1) : 1", "has 1 memberships, but there are 2 inputs"),
        ("[Output1]", "[Input1]", "line 28: section [Input1] appears twice"),
        ("[Output1]", "[Output2]", "section [Output1] is missing"),
        ("[Rules]", "[Input3]\nName='x'\n[Rules]", "line 37: section [Input3] does not belong"),
        ("Version=2.0", "Version", "line 4: \"Version\" is neither"),
        ("Name='small'", "Name='sm'all'", "line 2: 'sm'all' contains a quote"),
        ("Name='small'", "Name='small", "line 2: 'small has no closing quote"),
    ] {
        assert!(SMALL.contains(from), "the test must change the file: {from}");
        let message = error_of(&SMALL.replace(from, to));
        assert!(message.contains(expected), "{to}: {message}");
    }
    assert!(error_of("").contains("section [System] is missing"));
    assert!(error_of("Name='x'").contains("line 1: there is text before the first section"));
}

#[test]
fn a_name_with_special_characters_is_kept() {
    let name = "% da\tm\u{19}p\u{85}er #1, [x] = ";
    let fis = Fis { name: name.to_owned(), ..Fis::parse(SMALL).expect("reads") };
    assert_eq!(Fis::parse(&fis.to_text()).expect("reads what it wrote"), fis);
    // A quote or line end would end the name.
    let fis = Fis { name: "a'b\"c\nd".to_owned(), ..fis };
    assert_eq!(Fis::parse(&fis.to_text()).expect("reads what it wrote").name, "a_b_c_d");
}

#[test]
fn scaling_must_have_one_entry_for_each_input() {
    let fis = Fis::parse(SMALL).expect("reads");
    let output = OutputScale { mean_n: 0.0, std_dev_n: 1.0 };
    let inputs = vec![(Signal::Velocity, 0.0, 1.0), (Signal::Drive(DriveKind::CoilCurrent), 0.0, 1.0)];
    let scaling = Scaling { inputs, output, force_offset_n: 0.0 };
    assert_eq!(fis.model(TskKind::Anfis, &scaling).expect("a model").rules(), 4);
    let short = Scaling { inputs: scaling.inputs[..1].to_vec(), ..scaling };
    assert!(fis.model(TskKind::Anfis, &short).expect_err("too short").to_string().contains("scaling.inputs"));
}

/// A system with one input and the memberships `functions`, e.g. `'trimf',[0 1 2]`, whose conclusions are 1, 2, ...
fn system(range: &str, functions: &[&str]) -> String {
    let number = |line: &str, k: usize| line.replace('#', &(k + 1).to_string());
    let all = |line: &str| (0..functions.len()).map(|k| number(line, k)).collect::<Vec<_>>().join("\n");
    let sets: Vec<String> =
        functions.iter().enumerate().map(|(k, f)| format!("MF{}='s':{f}", k + 1)).collect();
    format!(
        "[System]\nName='s'\nType='sugeno'\nNumInputs=1\nNumOutputs=1\nNumRules={n}\nAndMethod='prod'\nDefuzzMethod='wtaver'\n\
         [Input1]\nName='velocity'\nRange={range}\nNumMFs={n}\n{}\n[Output1]\nName='force'\nRange=[0 9]\nNumMFs={n}\n{}\n\
         [Rules]\n{}\n",
        sets.join("\n"),
        all("MF#='c':'constant',[#]"),
        all("#, # (1) : 1"),
        n = functions.len(),
    )
}

/// The force of a system at `u`.
fn surface(text: &str, u: f64) -> f64 {
    let scaling = Scaling {
        inputs: vec![(Signal::Velocity, 0.0, 1.0)],
        output: OutputScale { mean_n: 0.0, std_dev_n: 1.0 },
        force_offset_n: 0.0,
    };
    let fis = Fis::parse(text).unwrap_or_else(|e| panic!("{e}\n{text}"));
    let model = fis.model(TskKind::Anfis, &scaling).expect("a model");
    model.force_n(&Inputs {
        dt_s: None,
        displacement_m: f64::NAN,
        velocity_m_s: u,
        acceleration_m_s2: f64::NAN,
        drive: f64::NAN,
        case_temp_c: f64::NAN,
    })
}

/// MATLAB's documented formulas, branch by branch.
fn matlab(name: &str, p: &[f64], u: f64) -> f64 {
    let gauss = |sigma: f64, c: f64| (-(u - c) * (u - c) / (2.0 * sigma * sigma)).exp();
    match (name, p) {
        ("gaussmf", [sigma, c]) => gauss(*sigma, *c),
        ("gbellmf", [a, b, c]) => 1.0 / (1.0 + f64::powf(((u - c) / a).abs(), 2.0 * b)),
        ("gauss2mf", [s1, c1, s2, c2]) => {
            let left = if u <= *c1 { gauss(*s1, *c1) } else { 1.0 };
            let right = if u >= *c2 { gauss(*s2, *c2) } else { 1.0 };
            left * right
        }
        ("trimf", [a, b, c]) => match u {
            u if u == *b => 1.0,
            u if u <= *a || u >= *c => 0.0,
            u if u < *b => (u - a) / (b - a),
            _ => (c - u) / (c - b),
        },
        ("trapmf", [a, b, c, d]) => {
            let rise = if u >= *b {
                1.0
            } else if u < *a {
                0.0
            } else {
                (u - a) / (b - a)
            };
            let fall = if u <= *c {
                1.0
            } else if u > *d {
                0.0
            } else {
                (d - u) / (d - c)
            };
            f64::min(rise, fall)
        }
        other => panic!("{other:?}"),
    }
}

/// The weighted average of MATLAB's memberships with the conclusions 1, 2, ...; NaN where no rule fires.
fn matlab_surface(functions: &[(&str, Vec<f64>)], u: f64) -> f64 {
    let g: Vec<f64> = functions.iter().map(|(name, p)| matlab(name, p, u)).collect();
    g.iter().zip(1..).map(|(g, k)| g * f64::from(k)).sum::<f64>() / g.iter().sum::<f64>()
}

#[test]
fn surfaces_are_those_of_matlab_within_the_range() {
    let cases: [(&str, &[&str]); 14] = [
        ("[-3 3]", &["'gaussmf',[-0.9 -1]", "'gaussmf',[1.3 1]"]),
        ("[-3 3]", &["'gbellmf',[1 2 -2]", "'gbellmf',[-1.5 0.7 0]", "'gbellmf',[1 4.5 2]"]),
        // c1 < c2 is a plateau, c1 > c2 a maximum below one, c1 = c2 a Gaussian with two widths.
        ("[-3 3]", &["'gauss2mf',[0.5 -2 0.8 -1]", "'gauss2mf',[0.7 1 0.4 0]", "'gauss2mf',[1 2 0.3 2]"]),
        ("[-3 3]", &["'gaussmf',[0.8 -1]", "'gauss2mf',[0.7 1 0.4 0]"]),
        // The outer triangles are shoulders within the range: their peaks are its ends.
        ("[-1 1]", &["'trimf',[-2 -1 0]", "'trimf',[-1 0 1]", "'trimf',[0 1 2]"]),
        ("[-1 1]", &["'trimf',[-1 -1 0]", "'trimf',[-1 0 1]", "'trimf',[0 1 1]"]),
        // They fall within the range, but alone.
        ("[-1 1]", &["'trimf',[-1 -0.5 0.5]", "'trimf',[-0.5 0.5 1]"]),
        // They fall within the range beside another triangle: a shoulder would have other weights.
        ("[-1 1]", &["'trimf',[-1.5 -0.5 0.5]", "'trimf',[-1.2 0.5 1.5]"]),
        ("[-1 1]", &["'trimf',[-1.5 0 1.5]", "'trimf',[-1.4 0.2 1.1]", "'trimf',[-1.1 0.4 1.2]"]),
        // Peaks in decreasing order, and vertical sides.
        ("[0 2]", &["'trimf',[1 1 2]", "'trimf',[0 0.5 1]", "'trimf',[0.2 0.2 1.4]"]),
        ("[-2 2]", &["'trapmf',[-3 -2 -1 0]", "'trapmf',[-1 0 0 1]", "'trapmf',[0 1 2 3]"]),
        ("[-2 2]", &["'trapmf',[-2 -2 0 0]", "'trapmf',[-0.5 -0.5 2 2]"]),
        // c < b: the sides cross below one.
        ("[-2 2]", &["'trapmf',[-3 0 -1 1]", "'trapmf',[-1 2 1 3]"]),
        ("[-2 2]", &["'trapmf',[-3 -2 -1 0]", "'trimf',[-1.5 0 1.5]", "'trapmf',[0 1 2 3]"]),
    ];
    for (range, functions) in cases {
        let parsed: Vec<(&str, Vec<f64>)> = functions
            .iter()
            .map(|f| {
                let (name, list) = f.split_once(',').expect("a name and a list");
                let list = list.trim_matches(['[', ']']).split(' ');
                (name.trim_matches('\''), list.map(|n| n.parse().expect("a number")).collect())
            })
            .collect();
        let text = system(range, functions);
        let fis = Fis::parse(&text).expect("reads");
        let again = fis.to_text();
        assert_eq!(Fis::parse(&again).expect("reads what it wrote"), fis);
        let [low, high] = fis.inputs[0].range;
        for k in 0..=400 {
            let u = low + (high - low) * f64::from(k) / 400.0;
            let expected = matlab_surface(&parsed, u);
            if expected.is_nan() {
                // No rule fires at a foot that two triangles share, which is a single point.
                continue;
            }
            for text in [&text, &again] {
                let found = surface(text, u);
                assert!((found - expected).abs() < 1e-12, "{functions:?} at {u}: {found} {expected}");
            }
        }
    }
}

#[test]
fn triangles_of_a_file_are_shoulders_only_where_that_changes_nothing() {
    let shape = |range: &str, functions: &[&str]| {
        Fis::parse(&system(range, functions)).expect("reads").inputs[0].sets[0].shape()
    };
    let overlapping = ["'trimf',[-1.5 -0.5 0.5]", "'trimf',[-1.2 0.5 1.5]"];
    assert_eq!(shape("[-0.5 0.5]", &overlapping), Shape::Triangle);
    assert_eq!(shape("[-1 0.5]", &overlapping), Shape::Trapezoid);
    // The same numbers as trapezoids fall on both sides, so no conversion changes the surface in silence.
    let g = [0.5, 0.2 / 1.7];
    let expected = (g[0] + 2.0 * g[1]) / (g[0] + g[1]);
    assert!((surface(&system("[-1 0.5]", &overlapping), -1.0) - expected).abs() < 1e-14);
}

#[test]
fn a_range_in_which_no_membership_fires_is_refused_with_its_line() {
    for (range, functions, expected) in [
        ("[-2 1]", &["'trimf',[-1.5 -0.5 0.5]", "'trimf',[-0.5 0.5 1.5]"][..], "between -2 and -1.5"),
        ("[-1 2]", &["'trimf',[-1.5 -0.5 0.5]", "'trimf',[-0.5 0.5 1.5]"], "between 1.5 and 2"),
        ("[-1 1]", &["'trimf',[-2 -1 -0.5]", "'trimf',[0.25 1 2]"], "between -0.5 and 0.25"),
        ("[-1 1]", &["'trapmf',[0 1 2 3]"], "between -1 and 0"),
    ] {
        let message = error_of(&system(range, functions));
        assert!(
            message.contains("line 11: no membership is above zero") && message.contains(expected),
            "{message}"
        );
    }
    let message = error_of(&system("[0 1]", &["'trapmf',[0 -1 1 2]"]));
    assert!(
        message.contains("line 13: MF1.left_shoulder is -1, but must be at least the left foot"),
        "{message}"
    );
    let message = error_of(&system("[0 1]", &["'trimf',[2 1 0]"]));
    assert!(message.contains("line 13: MF1."), "{message}");
    let message = error_of(&system("[0 1]", &["'gbellmf',[1 -2 0]"]));
    assert!(message.contains("line 13: MF1.exponent is -2, but must be above 0"), "{message}");
}

#[test]
fn triangles_that_are_shoulders_within_the_range_are_written_as_trapezoids() {
    // The second triangle reaches below the first peak, where the first is a shoulder of the model.
    let sets = [(-2.0, -1.0, 0.5), (-1.5, 0.0, 1.0), (-0.5, 1.0, 2.0)]
        .map(|(left, peak, right)| TskSet::Triangle { left, peak, right });
    let input = TskInput::new(Signal::Velocity, 0.0, 1.0, &sets).expect("an input");
    let output = OutputScale { mean_n: 0.0, std_dev_n: 1.0 };
    let model =
        Tsk::new(TskKind::Anfis, &[input], Order::Constant, &[1.0, 2.0, 3.0], output, 0.0).expect("a model");
    let envelope = Envelope { velocity_m_s: Some([-3.0, 3.0]), ..Envelope::default() };
    let fis = Fis::of(&model, "x").with_ranges(&envelope, &Scaling::of(&model));
    let text = fis.to_text();
    assert!(text.contains("'trapmf',[-1000000.0 -1000000.0 -1.0 0.5]"), "{text}");
    for k in 0..=600 {
        let u = -3.0 + f64::from(k) / 100.0;
        let weights = input.weights(u);
        let expected = weights[0] + 2.0 * weights[1] + 3.0 * weights[2];
        assert!((surface(&text, u) - expected).abs() < 1e-12, "{u}");
    }
}

/// Any finite number that is not subnormal.
fn number() -> impl proptest::strategy::Strategy<Value = f64> {
    use proptest::strategy::Strategy;
    (proptest::num::f64::NORMAL | proptest::num::f64::ZERO).prop_map(|x| if x == 0.0 { 0.0 } else { x })
}

proptest::proptest! {
    #[test]
    fn a_system_of_bells_is_bit_identical_after_write_and_read(
        sets in proptest::collection::vec((1e-6_f64..1e300, 1e-300_f64..1e6, number()), 1..=MAX_SETS),
        other in proptest::collection::vec((1e-6_f64..1e3, number(), 1e-6_f64..1e3, number()), 1..=3),
        numbers in proptest::collection::vec(number(), MAX_SETS * 9),
        first in proptest::bool::ANY,
    ) {
        let bell = |&(half_width, exponent, centre): &(f64, f64, f64)| TskSet::Bell { half_width, exponent, centre };
        let two = |&(left_sigma, left_centre, right_sigma, right_centre): &(f64, f64, f64, f64)| {
            TskSet::TwoSidedGaussian { left_sigma, left_centre, right_sigma, right_centre }
        };
        let bells: Vec<TskSet> = sets.iter().map(bell).collect();
        let two_sided: Vec<TskSet> = other.iter().map(two).collect();
        let inputs = [
            TskInput::new(Signal::Velocity, 0.1, 0.3, &bells).expect("an input"),
            TskInput::new(Signal::Displacement, 0.0, 1.0, &two_sided).expect("an input"),
        ];
        let order = if first { Order::First } else { Order::Constant };
        let needed = bells.len() * two_sided.len() * order.width(2);
        let output = OutputScale { mean_n: 0.0, std_dev_n: 300.0 };
        let model = Tsk::new(TskKind::Anfis, &inputs, order, &numbers[..needed], output, 0.0).expect("a model");
        let fis = Fis::of(&model, "bells");
        // A range spans all centres, which may be farther apart than the largest number.
        proptest::prop_assume!(fis.inputs.iter().all(|input| input.range.iter().all(|end| end.is_finite())));
        let read = Fis::parse(&fis.to_text()).expect("reads what it wrote");
        proptest::prop_assert_eq!(&read, &fis);
        proptest::prop_assert_eq!(read.model(TskKind::Anfis, &Scaling::of(&model)).expect("a model"), model);
    }

    #[test]
    fn no_text_panics(
        text in "(\\[(System|Input1|Output1|Rules)\\]|[A-Za-z]{1,9}=?|'[a-z:]*'|[\\[\\](),:%# 0-9.\\n-]{1,6}){0,40}",
    ) {
        let _ = Fis::parse(&text);
    }

    #[test]
    fn no_broken_file_panics(
        at in 0_usize..1000, with in "[\\[\\]=,:'()%0-9a-z \\n-]{0,3}", cut in 0_usize..4,
    ) {
        let at = at.min(SMALL.len());
        let text = format!("{}{with}{}", &SMALL[..at], &SMALL[(at + cut).min(SMALL.len())..]);
        if let Ok(fis) = Fis::parse(&text) {
            proptest::prop_assert_eq!(Fis::parse(&fis.to_text()).expect("reads what it wrote"), fis);
        }
    }
}
