//! The file of checkpoints as bytes: what the daemon before wrote, and another one reads again. Pure; what it reads is input.
//!
//! A header, then records at multiples of a page, each for the checkpoint of one slot: who it is of, two copies, and for each
//! copy a checksum and the moment at which it was made. Numbers are in the order of bytes of the machine, which is the same one:
//! nothing is taken up that was written before it was started last.
//!
//! | byte of the header | what |
//! |---|---|
//! | 0 | `FWDKEEP`, version |
//! | 8 | checksum of what follows |
//! | 16 | the directory's number |
//! | 24 | the kernel's boot id, 40 bytes |
//!
//! | byte of a record | what |
//! |---|---|
//! | 0 | `FWDSLOT` |
//! | 8 | where its copies begin |
//! | 16 | room for each of them |
//! | 24 | length of the table |
//! | 28 | how often it was taken up since the last copy |
//! | 32 | checksum of the table and of the three lengths |
//! | 40 | of each copy: checksum, moment |
//! | 72 | table: slot, class, build, regions, each with its name and length |

use std::ops::Range;

use crate::model::limits::CHECKPOINT_BYTES;
use crate::sys::copy::{STRIPE, Sum};
use crate::sys::mapping::PAGE;

const FILE_MARK: [u8; 8] = *b"FWDKEEP\x01";
const RECORD_MARK: [u8; 8] = *b"FWDSLOT\x00";
const BOOT_BYTES: usize = 40;
const COPIES: usize = 2;
const COPY_AT: usize = 40;
const TABLE_AT: usize = COPY_AT + COPIES * 16;
const TRIES_AT: usize = 28;

/// Which daemon wrote a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Origin {
    /// The kernel's boot id.
    pub boot: String,
    /// Stands for the profile directory.
    pub directory: u64,
}

/// What a record is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Whose<'a> {
    /// The slot.
    pub slot: &'a str,
    /// The class of the instance.
    pub class: &'a str,
    /// Stands for the plugin's file: another build may lay its fields out in another way.
    pub build: u64,
}

/// A checkpoint that a daemon left.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Kept {
    /// The slot.
    pub slot: String,
    /// The class of the instance.
    pub class: String,
    /// Stands for the plugin's file.
    pub build: u64,
    /// Names and lengths of the regions, in order.
    pub regions: Vec<(String, usize)>,
    /// How often it was taken up since it was made.
    pub tries: u32,
    /// When it was made: monotonic nanoseconds.
    pub at_ns: u64,
    /// The regions, each from a multiple of [`STRIPE`] on.
    pub data: Vec<u8>,
}

/// Bytes that regions of these lengths take in a copy; `None`: more than a checkpoint may have.
#[must_use]
pub fn room_of(lengths: impl Iterator<Item = usize>) -> Option<usize> {
    let bytes = lengths.fold(0, |sum: usize, len| sum.saturating_add(len.saturating_add(STRIPE - 1) / STRIPE * STRIPE));
    (bytes <= CHECKPOINT_BYTES).then_some(bytes)
}

/// The checksum of a copy of regions of these lengths; 0, which none is, where it is too short.
#[must_use]
pub fn sum_of(lengths: impl Iterator<Item = usize>, copy: &[u8], at_ns: u64) -> u64 {
    let (mut sum, mut rest) = (Sum::default(), copy);
    for len in lengths {
        let Some((part, behind)) = rest.split_at_checked(len.next_multiple_of(STRIPE)) else { return 0 };
        sum.add(&part[..len]);
        rest = behind;
    }
    sum.finish(at_ns)
}

/// The first page of a file.
#[must_use]
pub fn header(origin: &Origin) -> [u8; PAGE] {
    let mut page = [0; PAGE];
    page[..8].copy_from_slice(&FILE_MARK);
    page[16..24].copy_from_slice(&origin.directory.to_ne_bytes());
    let boot = &origin.boot.as_bytes()[..origin.boot.len().min(BOOT_BYTES)];
    page[24..24 + boot.len()].copy_from_slice(boot);
    let sum = Sum::of(&page[16..]).finish(0);
    page[8..16].copy_from_slice(&sum.to_ne_bytes());
    page
}

/// What lies in a file: checkpoints, and of what is refused why.
///
/// # Errors
/// In words, when all of it is refused.
pub fn read(file: &[u8], origin: &Origin) -> Result<(Vec<Kept>, Vec<String>), String> {
    let page = file.first_chunk::<PAGE>().ok_or("it is too short")?;
    if page[..8] != FILE_MARK {
        return Err("it is no file of checkpoints, or one of another version".to_owned());
    }
    if number(page, 8) != Some(Sum::of(&page[16..]).finish(0)) {
        return Err("its header is damaged".to_owned());
    }
    let expected = header(origin);
    if page[24..] != expected[24..] {
        return Err("it is of before the machine was started last".to_owned());
    }
    if page[16..24] != expected[16..24] {
        return Err("it is of another profile directory".to_owned());
    }
    let (mut kept, mut refused, mut at) = (Vec::new(), Vec::new(), PAGE);
    while let Some(rest) = file.get(at..).filter(|rest| rest.len() >= TABLE_AT) {
        let mut step = PAGE;
        if rest.starts_with(&RECORD_MARK) {
            match record(rest) {
                Ok((found, len)) => {
                    step = len;
                    kept.extend(found);
                }
                Err(reason) => refused.push(format!("the record at byte {at}: {reason}")),
            }
        }
        at = at.saturating_add(step);
    }
    Ok((newest_of_each(kept), refused))
}

fn newest_of_each(mut kept: Vec<Kept>) -> Vec<Kept> {
    kept.sort_by(|one, other| one.slot.cmp(&other.slot).then(other.at_ns.cmp(&one.at_ns)));
    kept.dedup_by(|later, first| later.slot == first.slot);
    kept
}

/// The record at the beginning of `bytes`, if it holds a whole copy, and its length.
fn record(bytes: &[u8]) -> Result<(Option<Kept>, usize), String> {
    let damaged = || "it is damaged".to_owned();
    let frame = Frame::read(bytes).ok_or_else(damaged)?;
    let table = bytes.get(frame.table()).ok_or_else(damaged)?;
    if number(bytes, 32) != Some(frame.sum(table)) {
        return Err(damaged());
    }
    let mut kept = fields(table).ok_or_else(damaged)?;
    let lengths = || kept.regions.iter().map(|(_, len)| *len);
    let room = room_of(lengths()).filter(|room| *room <= frame.capacity).ok_or_else(damaged)?;
    let (mut newest, mut torn) = (None, 0);
    for index in 0..COPIES {
        let stamp = COPY_AT + index * 16;
        let (sum, at_ns) = number(bytes, stamp).zip(number(bytes, stamp + 8)).ok_or_else(damaged)?;
        let copy = bytes.get(frame.copy(index)).and_then(|copy| copy.get(..room)).ok_or_else(damaged)?;
        if sum == 0 {
            continue;
        }
        if sum_of(lengths(), copy, at_ns) == sum {
            newest = newest.max(Some((at_ns, index)));
        } else {
            torn += 1;
        }
    }
    let Some((at_ns, index)) = newest else {
        let slot = &kept.slot;
        return if torn == 0 { Ok((None, frame.bytes())) } else { Err(format!("no copy of slot {slot} is whole")) };
    };
    kept.at_ns = at_ns;
    kept.tries = u32::from_ne_bytes(bytes[TRIES_AT..TRIES_AT + 4].try_into().map_err(|_| damaged())?);
    kept.data = bytes[frame.copy(index)][..room].to_vec();
    Ok((Some(kept), frame.bytes()))
}

fn number(bytes: &[u8], at: usize) -> Option<u64> {
    Some(u64::from_ne_bytes(bytes.get(at..at.checked_add(8)?)?.try_into().ok()?))
}

fn fields(table: &[u8]) -> Option<Kept> {
    let mut reader = Reader(table);
    let (slot, class, build) = (reader.text()?, reader.text()?, reader.number()?);
    let count = reader.number()?;
    let mut regions = Vec::new();
    for _ in 0..count {
        regions.push((reader.text()?, usize::try_from(reader.number()?).ok()?));
    }
    Some(Kept { slot, class, build, regions, tries: 0, at_ns: 0, data: Vec::new() })
}

struct Reader<'a>(&'a [u8]);

impl Reader<'_> {
    fn number(&mut self) -> Option<u64> {
        let (bytes, rest) = self.0.split_first_chunk::<8>()?;
        self.0 = rest;
        Some(u64::from_ne_bytes(*bytes))
    }

    fn text(&mut self) -> Option<String> {
        let (bytes, rest) = self.0.split_first_chunk::<2>()?;
        let (text, rest) = rest.split_at_checked(usize::from(u16::from_ne_bytes(*bytes)))?;
        self.0 = rest;
        String::from_utf8(text.to_vec()).ok()
    }
}

/// Where what lies in a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame {
    head: usize,
    capacity: usize,
    table: usize,
}

/// Room for names that are not known yet.
const TABLE_SLACK: usize = 1024;

impl Frame {
    /// One for copies of that many bytes, now described by a table of `table` bytes.
    #[must_use]
    pub const fn new(capacity: usize, table: usize) -> Self {
        let head = (TABLE_AT + table + TABLE_SLACK).next_multiple_of(PAGE);
        Self { head, capacity: capacity.next_multiple_of(PAGE / 2), table: 0 }
    }

    fn read(bytes: &[u8]) -> Option<Self> {
        let length = |at| usize::try_from(number(bytes, at)?).ok();
        let table = u32::from_ne_bytes(bytes.get(24..28)?.try_into().ok()?) as usize;
        let frame = Self { head: length(8)?, capacity: length(16)?, table };
        let fits = frame.head.is_multiple_of(PAGE)
            && frame.head <= bytes.len()
            && frame.table <= frame.head.checked_sub(TABLE_AT)?
            && frame.capacity.is_multiple_of(STRIPE)
            && frame.capacity <= 2 * CHECKPOINT_BYTES
            && frame.bytes() <= bytes.len();
        fits.then_some(frame)
    }

    /// Bytes of the record, a multiple of a page.
    #[must_use]
    pub const fn bytes(&self) -> usize {
        (self.head + COPIES * self.capacity).next_multiple_of(PAGE)
    }

    /// Room for each copy.
    #[must_use]
    pub const fn capacity(&self) -> usize {
        self.capacity
    }

    /// Where the copy of that number lies.
    #[must_use]
    pub const fn copy(&self, index: usize) -> Range<usize> {
        let start = self.head + index * self.capacity;
        start..start + self.capacity
    }

    const fn table(&self) -> Range<usize> {
        TABLE_AT..TABLE_AT + self.table
    }

    fn sum(&self, table: &[u8]) -> u64 {
        let lengths = [self.head, self.capacity, self.table].map(|len| len as u64);
        Sum::of(table).finish(lengths[0] << 40 ^ lengths[1] << 8 ^ lengths[2])
    }

    /// Says in a record whose it is from now on; there is no copy then. False: the names are too long.
    #[must_use]
    pub fn describe(&mut self, record: &mut [u8], whose: Whose<'_>, regions: &[(&'static str, usize)]) -> bool {
        // Whoever reads a half-changed record finds no copy in it.
        record[COPY_AT..TABLE_AT].fill(0);
        record[TRIES_AT..TRIES_AT + 4].fill(0);
        order();
        let mut writer = Writer { bytes: &mut record[TABLE_AT..self.head], len: 0 };
        let mut fits = writer.text(whose.slot) && writer.text(whose.class) && writer.number(whose.build);
        fits &= writer.number(regions.len() as u64);
        fits &= regions.iter().all(|(name, len)| writer.text(name) && writer.number(*len as u64));
        self.table = if fits { writer.len } else { 0 };
        record[..8].copy_from_slice(&RECORD_MARK);
        record[8..16].copy_from_slice(&(self.head as u64).to_ne_bytes());
        record[16..24].copy_from_slice(&(self.capacity as u64).to_ne_bytes());
        record[24..28].copy_from_slice(&(self.table as u32).to_ne_bytes());
        let sum = if fits { self.sum(&record[self.table()]) } else { 0 };
        record[32..40].copy_from_slice(&sum.to_ne_bytes());
        order();
        fits
    }

    /// Says in a record how a copy is to be known; a sum of 0: it is none.
    pub fn stamp(record: &mut [u8], index: usize, sum: u64, at_ns: u64) {
        let stamp = COPY_AT + index * 16;
        // What was copied is there before it is said to be.
        order();
        record[stamp..stamp + 8].copy_from_slice(&sum.to_ne_bytes());
        record[stamp + 8..stamp + 16].copy_from_slice(&at_ns.to_ne_bytes());
        order();
    }

    /// Says in a record how often it was taken up.
    pub fn count_tries(record: &mut [u8], tries: u32) {
        record[TRIES_AT..TRIES_AT + 4].copy_from_slice(&tries.to_ne_bytes());
    }
}

/// Bytes of a table.
#[must_use]
pub fn table_of(whose: Whose<'_>, regions: &[(&'static str, usize)]) -> usize {
    let names: usize = regions.iter().map(|(name, _)| name.len() + 10).sum();
    whose.slot.len() + whose.class.len() + 4 + 16 + names
}

/// What is killed leaves what it had written in the order in which it wrote it.
fn order() {
    std::sync::atomic::compiler_fence(std::sync::atomic::Ordering::SeqCst);
}

struct Writer<'a> {
    bytes: &'a mut [u8],
    len: usize,
}

impl Writer<'_> {
    fn write(&mut self, bytes: &[u8]) -> bool {
        let place = self.bytes.get_mut(self.len..self.len + bytes.len());
        let fits = place.is_some();
        place.into_iter().for_each(|place| place.copy_from_slice(bytes));
        self.len += bytes.len();
        fits
    }

    fn number(&mut self, number: u64) -> bool {
        self.write(&number.to_ne_bytes())
    }

    fn text(&mut self, text: &str) -> bool {
        u16::try_from(text.len()).is_ok_and(|len| self.write(&len.to_ne_bytes()) && self.write(text.as_bytes()))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn origin() -> Origin {
        Origin { boot: "6f2c8f0e-1b7d-4a52-9e63-0d6f6f1f8a11".to_owned(), directory: 77 }
    }

    const WHOSE: Whose<'_> = Whose { slot: "odometry", class: "EncoderOdometry", build: 5 };
    const REGIONS: [(&str, usize); 2] = [("pose", 24), ("trail", 100)];

    fn data(fill: u8) -> Vec<u8> {
        let mut data = vec![0; 192];
        data[..24].fill(fill);
        data[64..164].fill(fill + 1);
        data
    }

    /// A file with one record, whose copies were made at those moments.
    fn file(moments: [u64; 2]) -> Vec<u8> {
        let mut frame = Frame::new(192, table_of(WHOSE, &REGIONS));
        let mut record = vec![0; frame.bytes()];
        assert!(frame.describe(&mut record, WHOSE, &REGIONS));
        for (index, at_ns) in moments.into_iter().enumerate().filter(|(_, at_ns)| *at_ns > 0) {
            let copy = data(10 * (index as u8 + 1));
            record[frame.copy(index)][..copy.len()].copy_from_slice(&copy);
            let sum = sum_of(REGIONS.iter().map(|(_, len)| *len), &copy, at_ns);
            Frame::stamp(&mut record, index, sum, at_ns);
        }
        Frame::count_tries(&mut record, 2);
        [header(&origin()).as_slice(), &record].concat()
    }

    #[test]
    fn the_newest_whole_copy_is_read_back() {
        let bytes = file([100, 200]);
        let (kept, refused) = read(&bytes, &origin()).unwrap();
        let [found] = kept.as_slice() else { panic!("one") };
        assert_eq!(
            (found.slot.as_str(), found.class.as_str(), found.build, found.tries),
            ("odometry", "EncoderOdometry", 5, 2)
        );
        assert_eq!((found.at_ns, &found.data, refused.len()), (200, &data(20), 0));
        assert_eq!(found.regions, [("pose".to_owned(), 24), ("trail".to_owned(), 100)]);
        // Of the newer one a byte is wrong: the older one is there.
        let mut torn = bytes;
        torn[2 * PAGE + 2048 + 70] ^= 1;
        assert_eq!(read(&torn, &origin()).unwrap().0[0].at_ns, 100);
        torn[2 * PAGE + 3] ^= 1;
        let (kept, refused) = read(&torn, &origin()).unwrap();
        assert!(kept.is_empty() && refused[0].contains("no copy of slot odometry is whole"), "{refused:?}");
        assert_eq!(read(&file([0, 0]), &origin()).unwrap(), (Vec::new(), Vec::new()), "there was none yet");
    }

    #[test]
    fn of_several_records_of_a_slot_the_newest_counts() {
        let both = [file([100, 0]), file([0, 300])[PAGE..].to_vec()].concat();
        let (kept, _) = read(&both, &origin()).unwrap();
        assert_eq!(kept.iter().map(|kept| kept.at_ns).collect::<Vec<_>>(), [300]);
    }

    #[test]
    fn another_machine_time_directory_or_version_is_refused() {
        let bytes = file([100, 0]);
        let refused = |origin: &Origin| read(&bytes, origin).unwrap_err();
        assert!(refused(&Origin { boot: "other".to_owned(), ..origin() }).contains("started last"));
        assert!(refused(&Origin { directory: 78, ..origin() }).contains("another profile directory"));
        let mut newer = bytes.clone();
        newer[7] = 2;
        assert!(read(&newer, &origin()).unwrap_err().contains("another version"));
        assert!(read(&bytes[..100], &origin()).is_err());
    }

    proptest! {
        #[test]
        fn no_file_is_too_wild(
            changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..40),
            head in prop::collection::vec((0..TABLE_AT + 80, any::<u8>()), 0..8),
            cut in any::<prop::sample::Index>(),
        ) {
            let mut bytes = file([100, 200]);
            head.iter().for_each(|(at, byte)| bytes[PAGE + at] = *byte);
            changes.iter().for_each(|(index, byte)| { let at = PAGE + index.index(bytes.len() - PAGE); bytes[at] = *byte; });
            bytes.truncate(PAGE + cut.index(bytes.len() - PAGE));
            if let Ok((kept, _)) = read(&bytes, &origin()) {
                // What is taken up is one of the two copies, whatever happened to the rest.
                for kept in kept {
                    let whole = [data(10), data(20)];
                    let parts = |data: &[u8]| [data[..24].to_vec(), data[64..164].to_vec()];
                    prop_assert!(whole.iter().any(|data| parts(data) == parts(&kept.data)));
                }
            }
        }

        #[test]
        fn no_bytes_are_too_wild(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
            let page = header(&origin());
            let _ = read(&bytes, &origin());
            let _ = read(&[page.as_slice(), &RECORD_MARK, &bytes].concat(), &origin());
        }
    }
}
