//! Frames in several channel groups of an MDF4 file: groups of one bus are merged in order of time, and buses are kept apart as far as the
//! file names them.

use super::logs::{Frame, Mdf};
use super::*;

/// A channel group of frames.
#[derive(Clone, Default)]
struct Group {
    acquisition: &'static str,
    /// Name and path.
    source: Option<(&'static str, &'static str)>,
    /// The value of `BusChannel`; `None` if the group does not have it.
    bus: Option<u8>,
    frames: Vec<Frame>,
}

/// A group without a name of its bus.
fn group(frames: impl IntoIterator<Item = Frame>) -> Group {
    Group { frames: frames.into_iter().collect(), ..Group::default() }
}

/// An MDF4 file with these groups, each in a data group of its own, or all in one data group, whose records are group after group.
fn mdf(groups: &[Group], in_one: bool) -> Vec<u8> {
    let mut mdf = Mdf::new(true);
    let nanoseconds = mdf.linear(1e-9, 0.0);
    let cn = channel_without_unit;
    let (mut next_group, mut next_data, mut all) = (0, 0, Vec::new());
    for (index, of) in groups.iter().enumerate().rev() {
        let mut channels = vec![
            cn("t", 2, 0, 0, 64, 0, nanoseconds),
            cn("CAN_DataFrame.ID", 0, 0, 8, 32, 0, 0),
            cn("CAN_DataFrame.IDE", 0, 0, 12, 8, 0, 0),
            cn("CAN_DataFrame.DataLength", 0, 0, 13, 8, 0, 0),
            cn("CAN_DataFrame.DataBytes", 0, 10, 14, 96, 0, 0),
        ];
        if of.bus.is_some() {
            channels.push(cn("CAN_DataFrame.BusChannel", 0, 0, 26, 8, 0, 0));
        }
        let first = mdf.channels(&channels);
        let (acquisition, source) =
            (mdf.text(of.acquisition), of.source.map_or(0, |(name, path)| mdf.source(name, path)));
        let at = mdf.group(next_group, first, index as u64 + 1, of.frames.len() as u64, 0, 27);
        mdf.link(at, 2, acquisition);
        mdf.link(at, 3, source);
        let mut records = Vec::new();
        for (nanos, id, data) in &of.frames {
            records.extend(in_one.then_some(index as u8 + 1));
            records.extend((*nanos as u64).to_le_bytes());
            records.extend((id & 0x1fff_ffff).to_le_bytes());
            records.extend([(id >> 31) as u8, data.len() as u8]);
            records.extend(data);
            records.resize(records.len() + 12 - data.len(), 0);
            records.push(of.bus.unwrap_or_default());
        }
        if in_one {
            (next_group, all) = (at, [records, all].concat());
        } else {
            next_data = mdf.data_group(next_data, at, 0);
            let data = mdf.block(b"##DT", &[], &records);
            mdf.link(next_data, 2, data);
        }
    }
    if in_one {
        let data_group = mdf.data_group(0, next_group, 1);
        let data = mdf.block(b"##DT", &[], &all);
        mdf.link(data_group, 2, data);
    }
    mdf.finish()
}

/// The frames of SUSP_FL with the position `k` at `k` ms.
fn positions(steps: impl IntoIterator<Item = i16>) -> Vec<Frame> {
    let frame = |k: i16| (i64::from(k) * 1_000_000, SUSP, [k.to_le_bytes().to_vec(), vec![0; 6]].concat());
    steps.into_iter().map(frame).collect()
}

const POSITION: &str = "displacement=SUSP_FL.Position";

struct Files {
    dir: tempfile::TempDir,
    dbc: PathBuf,
}

impl Files {
    fn new() -> Self {
        let dir = temporary();
        let dbc = write(dir.path(), "car.dbc", DBC);
        Self { dir, dbc }
    }

    fn loaded(&self, groups: &[Group], in_one: bool, map: &str) -> Loaded {
        loaded(&write(self.dir.path(), "run.mf4", mdf(groups, in_one)), &mapped(&self.dbc, &[map]))
    }

    fn refusal(&self, groups: &[Group], map: &str) -> String {
        refusal(&write(self.dir.path(), "run.mf4", mdf(groups, false)), &mapped(&self.dbc, &[map]))
    }
}

/// The times in ms.
fn times(found: &Loaded) -> Vec<i64> {
    found.run.displacement_m.stamps.iter().map(|stamp| stamp.nanos() / 1_000_000).collect()
}

fn warnings(found: &Loaded) -> Vec<String> {
    let is_hint = |note: &&Note| matches!(note, Note::CouldServe { .. });
    found.notes.iter().filter(|note| !is_hint(note)).map(Note::to_string).collect()
}

#[test]
fn frames_of_one_bus_in_several_groups_are_merged_in_order_of_time() {
    let files = Files::new();
    let all = files.loaded(&[Group { bus: Some(1), ..group(positions(0..300)) }], false, POSITION);
    let named = |source, acquisition, bus| {
        let of = |frames| Group { source, acquisition, bus, frames };
        [
            of(positions((0..300).filter(|k| k % 3 == 0))),
            of(positions((0..300).filter(|k| k % 3 == 2))),
            of(positions((0..300).filter(|k| k % 3 == 1))),
        ]
    };
    for groups in [
        named(None, "", Some(1)),
        named(None, "CAN", Some(1)),
        named(Some(("CAN1", "")), "", None),
        named(None, "CAN1", None),
    ] {
        for in_one in [false, true] {
            let found = files.loaded(&groups, in_one, POSITION);
            assert_eq!(channels(&found.run), channels(&all.run), "in one: {in_one}");
            assert_eq!(warnings(&found), Vec::<String>::new());
        }
    }
    // One group of records that is split in data groups.
    let found = files.loaded(&[group(positions(100..300)), group(positions(0..100))], false, POSITION);
    assert_eq!(channels(&found.run), channels(&all.run));
    // Groups that each have the same frame.
    let found = files.loaded(
        &named(None, "", Some(1)).map(|it| Group { frames: positions(0..9), ..it }),
        false,
        POSITION,
    );
    assert_eq!(times(&found), (0..9).collect::<Vec<_>>());
    assert_eq!(
        warnings(&found),
        ["signal SUSP_FL.Position: 18 frames dropped whose time is not after the one before"]
    );
}

#[test]
fn times_that_go_back_in_one_group_are_dropped_as_before() {
    let files = Files::new();
    let back = [positions(0..50), positions(40..100)].concat();
    let groups = [group(back), group(positions(100..150))].map(|it| Group { bus: Some(1), ..it });
    let found = files.loaded(&groups, false, POSITION);
    assert_eq!(times(&found), (0..150).collect::<Vec<_>>());
    assert!(warnings(&found)[0].contains("10 frames dropped whose time is not after"), "{:?}", found.notes);
}

#[test]
fn buses_are_told_apart_by_the_source_of_their_group() {
    let files = Files::new();
    let (first, second) = (positions((0..100).map(|k| 2 * k)), positions((0..70).map(|k| 2 * k + 1)));
    let of = |frames: &Vec<Frame>, acquisition, source, bus| Group {
        frames: frames.clone(),
        acquisition,
        source,
        bus,
    };
    for (groups, names) in [
        // By the name of the source, its path, the name of the acquisition, and the number of the bus.
        (
            [of(&first, "", Some(("CAN1", "")), None), of(&second, "", Some(("CAN2", "")), None)],
            ["CAN1", "CAN2"],
        ),
        (
            [of(&first, "", Some(("CAN", "A:1")), None), of(&second, "", Some(("CAN", "A:2")), None)],
            ["A_1", "A_2"],
        ),
        ([of(&first, "CAN1", None, None), of(&second, "CAN2", None, None)], ["CAN1", "CAN2"]),
        ([of(&first, "", None, Some(3)), of(&second, "", None, Some(4))], ["3", "4"]),
        // Two recorders, each with a bus 1.
        (
            [of(&first, "", Some(("L1", "")), Some(1)), of(&second, "", Some(("L2", "")), Some(1))],
            ["L1", "L2"],
        ),
        // One group does not name its bus.
        ([of(&first, "", Some(("CAN1", "")), None), of(&second, "", None, None)], ["CAN1", "0"]),
    ] {
        let error = files.refusal(&groups, POSITION);
        let advice = format!(
            "its message was on several buses ({}): name one after a colon, as in SUSP_FL.Position:{}",
            names.join(", "),
            names[0]
        );
        assert!(error.contains(&advice), "{error}");
        for (name, count) in names.into_iter().zip([100, 70]) {
            let found = files.loaded(&groups, false, &format!("{POSITION}:{name}"));
            assert_eq!((found.run.displacement_m.len(), warnings(&found)), (count, vec![]), "{name}");
        }
        let error = files.refusal(&groups, &format!("{POSITION}:other"));
        assert!(
            error
                .contains(&format!("no frame of SUSP_FL was on bus `other`; it was on {}", names.join(", "))),
            "{error}"
        );
    }
    // The number of the bus does not tell the recorders apart.
    let groups = [of(&first, "", Some(("L1", "")), Some(1)), of(&second, "", Some(("L2", "")), Some(1))];
    let error = files.refusal(&groups, "displacement=SUSP_FL.Position:1");
    assert!(
        error.contains("several buses (L1, L2): name one after a colon, as in SUSP_FL.Position:L1"),
        "{error}"
    );
    // A recorder with two buses, and one with another.
    let groups = [groups[0].clone(), of(&second, "", Some(("L1", "")), Some(2)), groups[1].clone()];
    let error = files.refusal(&groups, POSITION);
    assert!(error.contains("several buses (L1/1, 2, L2)"), "{error}");
    assert_eq!(
        files.loaded(&groups, false, "displacement=SUSP_FL.Position:L1/1").run.displacement_m.len(),
        100
    );
}

#[test]
fn groups_that_name_no_bus_are_read_as_one_and_a_note_says_so() {
    let files = Files::new();
    let groups = [group(positions((0..100).map(|k| 2 * k))), group(positions((0..100).map(|k| 2 * k + 1)))];
    for map in [POSITION, "displacement=SUSP_FL.Position:0"] {
        let found = files.loaded(&groups, false, map);
        assert_eq!(times(&found), (0..200).collect::<Vec<_>>());
        let warnings = warnings(&found);
        assert_eq!(warnings.len(), 1, "{warnings:?}");
        assert!(
            warnings[0].contains(": its frames are in 2 groups of the file that do not name their bus"),
            "{warnings:?}"
        );
    }
    // One source for all: as without a source.
    let named = groups.clone().map(|it| Group { source: Some(("CAN1", "")), ..it });
    for map in ["displacement=SUSP_FL.Position:0", "displacement=SUSP_FL.Position:CAN1"] {
        let found = files.loaded(&named, false, map);
        assert_eq!((found.run.displacement_m.len(), warnings(&found)), (200, vec![]));
    }
}
