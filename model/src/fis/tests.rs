use super::*;
use crate::force::{ForceModel, Inputs};
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
        ("'fast':'gaussmf'", "'fast':'gbellmf'", "line 19: membership 'gbellmf' is not known"),
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

proptest::proptest! {
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
