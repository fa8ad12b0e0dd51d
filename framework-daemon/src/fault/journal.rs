//! The journal: append-only, one JSON object a line, each with a checksum as its last field.
//!
//! A line is written by one `write` system call, so that after `kill -9` only the last one can be incomplete, and its
//! checksum says so. Whoever wants to keep or to end it moves the file away: it goes on in a new one of the same name, without a
//! signal or an option that says how large it may become.

use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::fs::{FileExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use serde::Serialize;
use serde_json::{Map, Value};

use crate::model::fault::{Evidence, FaultEvent, Stage};
use crate::plugin::symbols::Origin;
use crate::sys::place::{self, Claim};
use crate::sys::{clock, last_words};

/// An open journal.
#[derive(Debug)]
pub struct Journal {
    file: File,
    path: PathBuf,
    sequence: u64,
    /// The last line is incomplete: the next one must not be glued to it.
    torn: bool,
    last: Option<Value>,
    leaves_emergency: bool,
    /// It is this process's alone.
    is_own: bool,
    /// So is its place, where that can be locked.
    claim: Option<Claim>,
}

impl Journal {
    /// Opens a journal for appending; its directory is made where there is none.
    ///
    /// # Errors
    /// When the file cannot be opened.
    pub fn open(path: &Path) -> io::Result<Self> {
        make_directory(path)?;
        let file = open(path)?;
        let tail = tail(&file)?;
        let torn = !tail.is_empty() && !tail.ends_with('\n');
        Ok(Self {
            file,
            path: path.to_owned(),
            sequence: 0,
            torn,
            last: last_line(&tail),
            leaves_emergency: leaves_emergency(&tail),
            is_own: false,
            claim: None,
        })
    }

    /// Opens it for this process alone, as long as that lives: what lies beside it is this run's, too. From now on it follows its
    /// name, where somebody moves the file away; and so that nobody comes in by the name meanwhile, its place has a lock of its own,
    /// which does not move with it.
    ///
    /// # Errors
    /// When another process has it; the error names it. When the file cannot be opened.
    pub fn open_alone(path: &Path) -> io::Result<Self> {
        make_directory(path)?;
        let claim = match Claim::take(&beside(path)) {
            Ok(Ok(claim)) => Some(claim),
            Ok(Err(holder)) => return Err(taken(holder)),
            Err(error) => {
                warn_of_no_lock(&beside(path), &error);
                None
            }
        };
        let mut journal = Self::open(path)?;
        journal.lock()?;
        (journal.is_own, journal.claim) = (true, claim);
        Ok(journal)
    }

    fn lock(&self) -> io::Result<()> {
        match place::lock(&self.file) {
            Ok(holder) => holder.map_or(Ok(()), |holder| Err(taken(holder))),
            Err(error) => {
                warn_of_no_lock(&self.path, &error);
                Ok(())
            }
        }
    }

    /// Sees to it that its place stays this process's, where somebody moved the lock away, too.
    ///
    /// # Errors
    /// When another process came in meanwhile, or no lock can be made there.
    pub fn hold_place(&mut self) -> io::Result<()> {
        match &mut self.claim {
            Some(claim) => claim.renew()?.map_or(Ok(()), |holder| Err(taken(holder))),
            None => Ok(()),
        }
    }

    /// Where it is.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What the last run wrote last; `None`: nothing, or it is damaged.
    #[must_use]
    pub const fn last(&self) -> Option<&Value> {
        self.last.as_ref()
    }

    /// True where its last lines tell of an emergency stop that nobody took back.
    #[must_use]
    pub const fn leaves_emergency(&self) -> bool {
        self.leaves_emergency
    }

    /// The number of a line that is written later.
    pub const fn number(&mut self) -> u64 {
        self.sequence += 1;
        self.sequence
    }

    /// Writes a fault under that number, and of which earlier one it is a consequence; returns the line, whether or not it could
    /// be written.
    pub fn fault(
        &mut self,
        number: u64,
        event: &FaultEvent,
        origin: &Origin,
        root: Option<u64>,
    ) -> (Map<String, Value>, io::Result<()>) {
        match describe(event, origin, root) {
            Ok(fields) => self.line(number, event.fault.stage.kind(), event.fault.at_ns, fields),
            Err(error) => (Map::new(), Err(error)),
        }
    }

    /// Writes anything else that belongs into the record.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn note(&mut self, kind: &str, fields: Map<String, Value>) -> io::Result<()> {
        self.tell(kind, fields).1
    }

    /// As [`Self::note`]; returns the line, whether or not it could be written.
    pub fn tell(&mut self, kind: &str, fields: Map<String, Value>) -> (Map<String, Value>, io::Result<()>) {
        let number = self.number();
        self.line(number, kind, clock::now_ns(), fields)
    }

    fn line(
        &mut self,
        number: u64,
        kind: &str,
        mono_ns: u64,
        fields: Map<String, Value>,
    ) -> (Map<String, Value>, io::Result<()>) {
        let mut object = Map::new();
        object.insert("kind".into(), kind.into());
        object.insert("seq".into(), number.into());
        object.insert("mono_ns".into(), mono_ns.into());
        object.insert("wall".into(), wall_seconds().into());
        object.extend(fields);
        let result = self.append(&object);
        (object, result)
    }

    fn append(&mut self, object: &Map<String, Value>) -> io::Result<()> {
        let mut line = seal(object)?;
        if self.is_own && !place::holds(&self.path, &self.file) {
            self.go_on_in_place();
        }
        if self.torn {
            line.insert(0, '\n');
        }
        let result = self.file.write_all(line.as_bytes());
        self.torn = result.is_err();
        result
    }
}

impl Journal {
    /// Somebody moved the file away, to keep it or to make room: a new one of the same name takes over, under the same
    /// descriptors. Where none can be made the old one goes on.
    fn go_on_in_place(&mut self) {
        let moved = open(&self.path).and_then(|new| last_words::move_journal(new.as_fd()));
        // What was opened is closed by now, which would have ended a lock.
        match moved.and_then(|()| self.lock()) {
            Ok(()) => tracing::info!("the journal goes on in a new file {}", self.path.display()),
            Err(error) => return tracing::debug!("journal {}: {error}", self.path.display()),
        }
        self.torn = tail(&self.file).is_ok_and(|tail| !tail.is_empty() && !tail.ends_with('\n'));
    }
}

/// Where the lock of a journal's place lies.
fn beside(journal: &Path) -> PathBuf {
    place::suffixed(journal, ".lock")
}

fn make_directory(journal: &Path) -> io::Result<()> {
    let directory = journal.parent().filter(|directory| !directory.as_os_str().is_empty());
    directory.map_or(Ok(()), std::fs::create_dir_all)
}

fn taken(holder: i32) -> io::Error {
    io::Error::other(format!("another daemon (process {holder}) writes it: name another one with --journal FILE"))
}

fn warn_of_no_lock(path: &Path, error: &io::Error) {
    tracing::warn!("{}: cannot be locked ({error}); no other daemon may write that journal", path.display());
}

fn open(path: &Path) -> io::Result<File> {
    // Not blocking: a pipe without a reader would hang here for ever.
    let file = OpenOptions::new().create(true).append(true).read(true).custom_flags(libc::O_NONBLOCK).open(path)?;
    if !file.metadata()?.is_file() {
        return Err(io::Error::other("it is no regular file: name a file with --journal FILE"));
    }
    Ok(file)
}

/// What is written of a fault.
fn describe(event: &FaultEvent, origin: &Origin, consequence_of: Option<u64>) -> io::Result<Map<String, Value>> {
    #[derive(Serialize)]
    struct Diagnosis<'a> {
        faulty: &'a str,
        severity: crate::model::symptom::Severity,
        #[serde(skip_serializing_if = "Option::is_none")]
        consequence_of: Option<u64>,
        /// Whose answer it is left to.
        #[serde(skip_serializing_if = "Option::is_none")]
        left_to: Option<&'a str>,
    }
    #[derive(Serialize)]
    struct Found<'a> {
        #[serde(flatten)]
        evidence: &'a Evidence,
        #[serde(flatten)]
        origin: &'a Origin,
    }
    let mut line = Map::new();
    line.insert("slot".into(), event.slot.into());
    line.insert("class".into(), event.class.into());
    line.insert("symptom".into(), event.fault.symptom.name().into());
    line.insert("injected".into(), event.fault.injected.into());
    line.insert("thread_lost".into(), event.fault.thread_lost.into());
    line.insert("memory".into(), to_value(&event.fault.memory)?);
    line.insert("evidence".into(), to_value(&Found { evidence: &event.fault.evidence, origin })?);
    let diagnosis = Diagnosis { faulty: event.slot, severity: event.severity, consequence_of, left_to: event.cause };
    line.insert("diagnosis".into(), to_value(&diagnosis)?);
    if event.fault.stage != Stage::Confirmed {
        line.insert("outcome".into(), event.fault.stage.kind().into());
        return Ok(line);
    }
    line.insert("action".into(), to_value(&event.answer)?);
    line.insert("successor".into(), event.successor.map_or(Value::Null, Value::from));
    line.insert("outcome".into(), to_value(&event.outcome)?);
    if let Some(age_ns) = event.checkpoint_ns {
        line.insert("checkpoint".into(), age_ns.into());
    }
    line.insert("times".into(), to_value(&event.times)?);
    Ok(line)
}

/// More than any line has.
const TAIL_BYTES: u64 = 64 << 10;

/// The end of the file.
fn tail(file: &File) -> io::Result<String> {
    let len = file.metadata()?.len();
    let start = len.saturating_sub(TAIL_BYTES);
    let mut tail = vec![0; (len - start) as usize];
    let read = file.read_at(&mut tail, start)?;
    Ok(String::from_utf8_lossy(&tail[..read]).into_owned())
}

fn last_line(tail: &str) -> Option<Value> {
    tail.split_inclusive('\n').rfind(|line| line.ends_with('\n')).and_then(unseal)
}

fn leaves_emergency(tail: &str) -> bool {
    let told =
        tail.lines().rev().filter_map(unseal).find_map(|line| match line.get("kind").and_then(Value::as_str)? {
            "clear" => Some(false),
            "emergency" => Some(line.get("step").and_then(Value::as_str) != Some("forgotten")),
            _ => None,
        });
    told.unwrap_or(false)
}

impl AsFd for Journal {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.file.as_fd()
    }
}

fn to_value(value: &impl Serialize) -> io::Result<Value> {
    serde_json::to_value(value).map_err(io::Error::other)
}

/// Seconds since 1970, for display.
fn wall_seconds() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs_f64()
}

/// The object as a line with `crc` as its last field: the CRC-32 of all before `,"crc"`.
fn seal(object: &Map<String, Value>) -> io::Result<String> {
    let mut line = serde_json::to_string(object)?;
    line.pop();
    let checksum = crc32fast::hash(line.as_bytes());
    line.push_str(&format!(",\"crc\":\"{checksum:08x}\"}}\n"));
    Ok(line)
}

/// Reads a line back; `None`: it is incomplete or damaged.
#[must_use]
pub fn unseal(line: &str) -> Option<Value> {
    let (body, tail) = line.trim_end().rsplit_once(",\"crc\":\"")?;
    let checksum = u32::from_str_radix(tail.strip_suffix("\"}")?, 16).ok()?;
    (crc32fast::hash(body.as_bytes()) == checksum).then(|| serde_json::from_str(line).ok())?
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_line_is_read_back_and_a_damaged_one_is_not() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("deep/journal.jsonl");
        let mut journal = Journal::open(&path).unwrap();
        journal.note("start", Map::from_iter([("slots".into(), 3.into())])).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        assert_eq!(unseal(&text).unwrap()["slots"], 3);
        assert!(unseal(&text.replace('3', "4")).is_none());
        assert!(unseal(&text[..text.len() - 4]).is_none());
    }

    #[test]
    fn a_torn_line_does_not_spoil_the_next() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("journal.jsonl");
        std::fs::write(&path, "{\"kind\":\"fault\",\"se").unwrap();
        Journal::open(&path).unwrap().note("start", Map::new()).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(unseal(text.lines().last().unwrap()).is_some(), "{text}");
        assert_eq!(Journal::open(&path).unwrap().last().unwrap()["kind"], "start");
        assert!(Journal::open(directory.path()).is_err());
    }

    #[test]
    fn an_emergency_stop_that_nobody_took_back_is_seen() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("journal.jsonl");
        let mut journal = Journal::open(&path).unwrap();
        let seen = || Journal::open(&path).unwrap().leaves_emergency();
        let step = |step: &str| Map::from_iter([("step".into(), step.into())]);
        assert!(!seen());
        journal.note("emergency", step("raised")).unwrap();
        journal.note("stop", Map::new()).unwrap();
        assert!(seen());
        journal.note("clear", Map::new()).unwrap();
        assert!(!seen());
        journal.note("emergency", step("restored")).unwrap();
        assert!(seen());
        journal.note("emergency", step("forgotten")).unwrap();
        assert!(!seen());
    }

    proptest! {
        #[test]
        fn no_line_is_too_wild(line in ".*") {
            let _ = unseal(&line);
        }
    }
}
