//! Packed blocks of MDF4 files: every method gives the same run, and a damaged block ends the run with its place.

use super::*;

/// The place of the `count`th packed block with this number of its method in an MDF4 file, from 0.
fn packed_block(content: &[u8], kind: u8, count: usize) -> usize {
    let is_it = |at: &usize| content[*at..].starts_with(b"##DZ") && content[at + 26] == kind;
    (0..content.len() - 26).filter(is_it).nth(count).expect("a block")
}

#[test]
fn a_damaged_packed_block_of_mdf_ends_the_run_and_is_named() {
    let dir = temporary();
    let options = LoadOptions { dbc: vec![], ..mapped(Path::new(""), &["displacement=Stroke"]) };
    let good = plain_mdf(500, 0);
    let whole = loaded(&write(dir.path(), "whole.mf4", &good), &options).run.displacement_m;
    // Blocks of 500 bytes with records of 16 bytes: the second block of each kind begins after seven blocks.
    for (kind, name, before) in [
        (0, "deflate", 8),
        (1, "deflate", 7),
        (2, "zstd", 11),
        (3, "zstd", 10),
        (4, "LZ4", 13),
        (5, "LZ4", 12),
    ] {
        let mut content = good.clone();
        let at = packed_block(&content, kind, 1);
        // The first byte of the packed data.
        content[at + 48] ^= 0xff;
        let found = loaded(&write(dir.path(), "damaged.mf4", content), &options);
        let rows = before * 500 / 16;
        assert_eq!(found.run.displacement_m.values, whole.values[..rows], "{kind}");
        let note = found.notes.iter().find(|note| matches!(note, Note::LogCutShort { .. }));
        let text = note.unwrap_or_else(|| panic!("{kind}: {:?}", found.notes)).to_string();
        let why = format!("the data of this block, packed with {name}, are damaged: ");
        assert!(text.contains(&format!("byte {at}")) && text.contains(&why), "{kind}: {text}");
    }
    // Nothing is read before the first block.
    let mut content = good;
    let at = packed_block(&content, 1, 0);
    content[at + 26] = 7;
    assert_eq!(
        refusal(&write(dir.path(), "first.mf4", content), &options),
        format!(
            "first.mf4: not a whole MDF4 file: byte {at}: packed by method 7, which is not read (deflate, zstd and LZ4 are); save it \
             without, for example with asammdf"
        )
    );
}

/// An MDF4 file with frames whose bytes are in packed blocks apart from the records.
fn stored_mdf(kind: u8) -> Vec<u8> {
    let (mut records, mut stored) = (Vec::new(), Vec::new());
    for (nanos, id, bytes) in frames() {
        records.extend((nanos as u64).to_le_bytes());
        records.extend((id & 0x1fff_ffff).to_le_bytes());
        records.push((id >> 31) as u8);
        records.extend((stored.len() as u64).to_le_bytes());
        stored.extend((bytes.len() as u32).to_le_bytes());
        stored.extend(bytes);
    }
    let mut mdf = Mdf::new(true);
    let mut parts = vec![0];
    parts.extend(stored.chunks(1000).map(|part| mdf.packed(kind, 12, part)).collect::<Vec<_>>());
    let store = mdf.block(b"##DL", &parts, &[0; 16]);
    let nanoseconds = mdf.linear(1e-9, 0.0);
    let cn = channel_without_unit;
    let first = mdf.channels(&[
        cn("t", 2, 0, 0, 64, 0, nanoseconds),
        cn("CAN_DataFrame.ID", 0, 0, 8, 32, 0, 0),
        cn("CAN_DataFrame.IDE", 0, 0, 12, 8, 0, 0),
        cn("CAN_DataFrame.DataBytes", 1, 10, 13, 64, store, 0),
    ]);
    let group = mdf.group(0, first, 0, 2 * STEPS as u64, 0, 21);
    let data_group = mdf.data_group(0, group, 0);
    let data = mdf.packed(kind, 21, &records);
    mdf.link(data_group, 2, data);
    mdf.finish()
}

#[test]
fn bytes_of_frames_in_packed_blocks_are_read_up_to_a_damage() {
    let dir = temporary();
    let dbc = write(dir.path(), "car.dbc", DBC);
    let expected = reference(dir.path());
    for kind in 0..6 {
        let good = stored_mdf(kind);
        let found = loaded(&write(dir.path(), "stored.mf4", &good), &mapped(&dbc, &MAP));
        assert_eq!(channels(&found.run), channels(&expected), "{kind}");
        assert!(found.notes.is_empty(), "{kind}: {:?}", found.notes);
        let damaged = |count: usize| {
            let mut content = good.clone();
            let at = packed_block(&content, kind, count);
            content[at + 48] ^= 0xff;
            (at, write(dir.path(), "damaged.mf4", content))
        };
        // The second block of bytes: 71 frames and a part of one are before it.
        let (at, path) = damaged(1);
        let found = loaded(&path, &mapped(&dbc, &MAP));
        assert_eq!(found.run.displacement_m.values, expected.displacement_m.values[..36], "{kind}");
        let text = found.notes.iter().map(ToString::to_string).collect::<String>();
        assert!(text.contains(&format!("read up to byte {at}, ")), "{kind}: {text}");
        let (at, path) = damaged(0);
        let text = refusal(&path, &mapped(&dbc, &MAP));
        assert!(text.starts_with(&format!("damaged.mf4: not a whole MDF4 file: byte {at}: ")), "{text}");
    }
}

#[test]
fn of_a_packed_block_that_the_file_ends_in_only_data_that_are_there_are_read() {
    let dir = temporary();
    let dbc = write(dir.path(), "car.dbc", DBC);
    let expected = reference(dir.path()).displacement_m;
    // The packed records are the end of the file. zstd and LZ4 unpack whole blocks only, and these data are one.
    for (kind, least) in [(0, 50), (1, 0), (2, 0), (3, 0), (4, 0), (5, 0)] {
        let content = stored_mdf(kind);
        let path = write(dir.path(), "cut.mf4", &content[..content.len() - content.len() / 8]);
        match load(&path, &mapped(&dbc, &["displacement=SUSP_FL.Position,sign=-1,offset=0.001"])) {
            Ok(found) => {
                let values = found.run.displacement_m.values;
                assert!(values.len() > least && values.len() < 199, "{kind}: {}", values.len());
                assert_eq!(values, expected.values[..values.len()], "{kind}");
                let text = found.notes.iter().map(ToString::to_string).collect::<String>();
                assert!(text.contains("the file ends in data that are packed with "), "{text}");
            }
            Err(error) => {
                assert!(least == 0, "{kind}: {error}");
                let text = error.to_string();
                assert!(text.contains("cut.mf4: not a whole MDF4 file: byte "), "{text}");
                assert!(text.contains(": the file ends in data that are packed with "), "{text}");
            }
        }
    }
}
