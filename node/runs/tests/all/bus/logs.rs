//! Writers of logs for the tests: frames as candump, ASC and BLF, and MDF4 files block by block.

use std::fmt::Write as _;
use std::io::Write as _;

/// A frame: time in ns, identifier with bit 31 for 29 bits, data.
pub(super) type Frame = (i64, u32, Vec<u8>);

/// The identifier as hexadecimal digits, with as many digits as the format needs.
fn digits(id: u32) -> String {
    if id >> 31 == 1 { format!("{:08X}", id & 0x1fff_ffff) } else { format!("{id:03X}") }
}

fn hex(data: &[u8]) -> Vec<String> {
    data.iter().map(|byte| format!("{byte:02X}")).collect()
}

/// The log of `candump -L`.
pub(super) fn candump(frames: &[Frame]) -> Vec<u8> {
    let mut text = String::new();
    for (nanos, id, data) in frames {
        let mark = if data.len() > 8 { "##0" } else { "#" };
        let (seconds, rest) = (nanos / 1_000_000_000, nanos % 1_000_000_000);
        writeln!(text, "({seconds}.{rest:09}) can0 {}{mark}{}", digits(*id), hex(data).concat())
            .expect("a string");
    }
    text.into_bytes()
}

/// An ASC file.
pub(super) fn asc(frames: &[Frame]) -> Vec<u8> {
    let mut text =
        "date Thu Nov 26 07:00:00 pm 2026\nbase hex  timestamps absolute\nno internal events logged\n"
            .to_owned();
    for (nanos, id, data) in frames {
        let time = format!("{}.{:09}", nanos / 1_000_000_000, nanos % 1_000_000_000);
        let id = format!("{}{}", digits(*id), if id >> 31 == 1 { "x" } else { "" });
        let (count, bytes) = (data.len(), hex(data).join(" "));
        if count > 8 {
            // The length code of 12 bytes is 9.
            assert_eq!(count, 12, "other codes are not written");
            writeln!(text, "{time} CANFD 1 Rx {id} 1 0 9 {count} {bytes} 0 0 0").expect("a string");
        } else {
            writeln!(text, "{time} 1 {id} Rx d {count} {bytes}").expect("a string");
        }
    }
    text.into_bytes()
}

/// A BLF object of this kind, with its stamp in ns.
fn object(kind: u32, nanos: i64, body: &[u8]) -> Vec<u8> {
    let mut object = b"LOBJ".to_vec();
    object.extend(32_u16.to_le_bytes());
    object.extend(1_u16.to_le_bytes());
    object.extend((32 + body.len() as u32).to_le_bytes());
    object.extend(kind.to_le_bytes());
    object.extend(2_u32.to_le_bytes());
    object.extend([0; 4]);
    object.extend((nanos as u64).to_le_bytes());
    object.extend(body);
    object.resize(object.len().next_multiple_of(4), 0);
    object
}

/// The object of a frame. Frames of more than 8 bytes take the two kinds of CAN FD in turn.
fn frame_object(index: usize, (nanos, id, data): &Frame) -> Vec<u8> {
    let (id, count) = (id.to_le_bytes(), data.len() as u8);
    let mut body = Vec::new();
    if data.len() <= 8 {
        body.extend([1, 0, 0, count]);
        body.extend(id);
        body.extend(data);
        body.resize(16, 0);
        return object(if index.is_multiple_of(2) { 1 } else { 86 }, *nanos, &body);
    }
    if index.is_multiple_of(2) {
        body.extend([1, 0, 0, 9]);
        body.extend(id);
        body.extend([0, 0, 0, 0, 0, 1, count, 0, 0, 0, 0, 0]);
        body.extend(data);
        body.resize(84, 0);
        return object(100, *nanos, &body);
    }
    body.extend([1, 9, count, 0]);
    body.extend(id);
    body.extend([0; 4]);
    body.extend(0x1000_u32.to_le_bytes());
    body.resize(40, 0);
    body.extend(data);
    object(101, *nanos, &body)
}

/// A BLF file with containers of `size` bytes, so that objects cross from one to the next; every third one is not packed.
pub(super) fn blf(frames: &[Frame], size: usize) -> Vec<u8> {
    let stream: Vec<u8> =
        frames.iter().enumerate().flat_map(|(index, frame)| frame_object(index, frame)).collect();
    let mut file = b"LOGG".to_vec();
    file.extend(144_u32.to_le_bytes());
    file.resize(144, 0);
    for (index, part) in stream.chunks(size).enumerate() {
        let (method, data) = match index % 3 {
            2 => (0_u16, part.to_vec()),
            _ => (2, miniz_oxide::deflate::compress_to_vec_zlib(part, 6)),
        };
        file.extend(b"LOBJ");
        file.extend(16_u16.to_le_bytes());
        file.extend(1_u16.to_le_bytes());
        file.extend((32 + data.len() as u32).to_le_bytes());
        file.extend(10_u32.to_le_bytes());
        file.extend(method.to_le_bytes());
        file.extend([0; 6]);
        file.extend((part.len() as u32).to_le_bytes());
        file.extend([0; 4]);
        let padding = data.len() % 4;
        file.extend(data);
        file.resize(file.len() + padding, 0);
    }
    file
}

/// Sets the start of the measurement of a BLF file to 2023-11-14 22:13:20.250 UTC, which is 1 700 000 000.25 s since 1970.
pub(super) fn started(mut blf: Vec<u8>) -> Vec<u8> {
    let parts: [u16; 8] = [2023, 11, 2, 14, 22, 13, 20, 250];
    for (index, part) in parts.into_iter().enumerate() {
        blf[40 + 2 * index..42 + 2 * index].copy_from_slice(&part.to_le_bytes());
    }
    blf
}

/// An MDF4 file while it is written: blocks get their addresses in the order in which they are added.
pub(super) struct Mdf {
    bytes: Vec<u8>,
}

/// A channel: name, unit, kind, synchronisation, type of data, first byte, number of bits, data, and its conversion.
pub(super) struct Cn<'a> {
    pub(super) name: &'a str,
    pub(super) unit: &'a str,
    pub(super) kind: u8,
    pub(super) data_type: u8,
    pub(super) byte: u32,
    pub(super) bits: u32,
    pub(super) data: u64,
    pub(super) conversion: u64,
}

impl Mdf {
    /// A file that the recorder finished, or did not finish.
    pub(super) fn new(is_finished: bool) -> Self {
        let mut bytes = if is_finished { b"MDF     4.10    ".to_vec() } else { b"UnFinMF 4.10    ".to_vec() };
        bytes.resize(28, 0);
        bytes.extend(410_u16.to_le_bytes());
        bytes.resize(60, 0);
        // Counts of records and the length of the last data block are missing.
        bytes.extend(if is_finished { [0, 0] } else { [5, 0] });
        bytes.resize(64, 0);
        let mut file = Self { bytes };
        file.block(b"##HD", &[0; 6], &[0; 32]);
        file
    }

    pub(super) fn block(&mut self, id: &[u8; 4], links: &[u64], data: &[u8]) -> u64 {
        self.bytes.resize(self.bytes.len().next_multiple_of(8), 0);
        let at = self.bytes.len() as u64;
        self.bytes.extend(id);
        self.bytes.extend([0; 4]);
        self.bytes.extend((24 + 8 * links.len() as u64 + data.len() as u64).to_le_bytes());
        self.bytes.extend((links.len() as u64).to_le_bytes());
        links.iter().for_each(|link| self.bytes.extend(link.to_le_bytes()));
        self.bytes.extend(data);
        at
    }

    /// A packed block of data. `kind` is the number of the method in the file: deflate, zstd and LZ4, each without and with a transposition
    /// of rows of `columns` bytes.
    pub(super) fn packed(&mut self, kind: u8, columns: usize, part: &[u8]) -> u64 {
        let rows = part.len() / columns;
        let mut content = Vec::new();
        if kind % 2 == 1 {
            (0..columns).for_each(|column| content.extend((0..rows).map(|row| part[row * columns + column])));
            content.extend(&part[rows * columns..]);
        } else {
            content.extend(part);
        }
        let packed = match kind / 2 {
            0 => miniz_oxide::deflate::compress_to_vec_zlib(&content, 6),
            1 => zstd::bulk::compress(&content, 3).expect("in memory"),
            _ => {
                let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
                encoder.write_all(&content).expect("in memory");
                encoder.finish().expect("in memory")
            }
        };
        let mut data = vec![b'D', b'T', kind, 0];
        data.extend((columns as u32).to_le_bytes());
        data.extend((part.len() as u64).to_le_bytes());
        data.extend((packed.len() as u64).to_le_bytes());
        data.extend(packed);
        self.block(b"##DZ", &[], &data)
    }

    /// Sets a link of a block that is written already.
    pub(super) fn link(&mut self, block: u64, index: usize, to: u64) {
        let at = block as usize + 24 + 8 * index;
        self.bytes[at..at + 8].copy_from_slice(&to.to_le_bytes());
    }

    /// A source of acquisition, such as a channel of a recorder, of the kind BUS and the bus type CAN.
    pub(super) fn source(&mut self, name: &str, path: &str) -> u64 {
        let (name, path) = (self.text(name), self.text(path));
        self.block(b"##SI", &[name, path, 0], &[2, 2, 0, 0, 0, 0, 0, 0])
    }

    pub(super) fn text(&mut self, text: &str) -> u64 {
        if text.is_empty() { 0 } else { self.block(b"##TX", &[], format!("{text}\0").as_bytes()) }
    }

    /// A conversion `raw * factor + offset`.
    pub(super) fn linear(&mut self, factor: f64, offset: f64) -> u64 {
        let mut data = vec![1, 0, 0, 0, 0, 0, 2, 0];
        data.extend([0; 16]);
        data.extend(offset.to_le_bytes());
        data.extend(factor.to_le_bytes());
        self.block(b"##CC", &[0; 4], &data)
    }

    /// The channels of a group, linked in order; returns the first.
    pub(super) fn channels(&mut self, channels: &[Cn<'_>]) -> u64 {
        let mut next = 0;
        for channel in channels.iter().rev() {
            let (name, unit) = (self.text(channel.name), self.text(channel.unit));
            let links = [next, 0, name, 0, channel.conversion, channel.data, unit, 0];
            let sync = u8::from(matches!(channel.kind, 2 | 3));
            let mut data = vec![channel.kind, sync, channel.data_type, 0];
            data.extend(channel.byte.to_le_bytes());
            data.extend(channel.bits.to_le_bytes());
            data.resize(72, 0);
            next = self.block(b"##CN", &links, &data);
        }
        next
    }

    /// A channel group.
    pub(super) fn group(
        &mut self,
        next: u64,
        first: u64,
        id: u64,
        records: u64,
        flags: u16,
        bytes: u32,
    ) -> u64 {
        let mut data = id.to_le_bytes().to_vec();
        data.extend(records.to_le_bytes());
        data.extend(flags.to_le_bytes());
        data.resize(24, 0);
        data.extend(bytes.to_le_bytes());
        data.extend([0; 4]);
        self.block(b"##CG", &[next, first, 0, 0, 0, 0], &data)
    }

    /// A data group; the header names the first one.
    pub(super) fn data_group(&mut self, next: u64, first: u64, id_bytes: u8) -> u64 {
        let at = self.block(b"##DG", &[next, first, 0, 0], &[id_bytes, 0, 0, 0, 0, 0, 0, 0]);
        self.link(64, 0, at);
        at
    }

    pub(super) fn finish(self) -> Vec<u8> {
        self.bytes
    }
}
