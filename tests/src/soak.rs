//! A long life under fault load: panics and traps as fast as they go, and what the process holds meanwhile.

use std::fs::File;
use std::io::{self, BufRead, BufReader};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use crate::profiles::{Profiles, application, plugin_dir, slot};
use crate::running::Running;

/// Memory that an instance which trapped leaves behind, at most: itself, its ports' ends, its place in lists. Its stack's
/// pages are given back.
pub const LEAK_BYTES_MAX: u64 = 256;
/// What memory may grow by for other reasons: buffers that reach their size, the allocator's rounding.
const SLACK_BYTES: u64 = 8 << 20;
/// Mappings, threads, descriptors may grow by that many.
const SLACK_COUNT: u64 = 16;

/// Slots of each class.
const SLOTS: usize = 4;
/// No fault for that long: something is wrong.
const STALLED: Duration = Duration::from_secs(60);
const PAUSE: Duration = Duration::from_millis(20);

/// What the process holds at one moment.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Faults so far.
    pub faults: u64,
    /// Resident memory.
    pub rss_bytes: u64,
    /// Page tables.
    pub tables_bytes: u64,
    /// Address space.
    pub space_bytes: u64,
    /// Mappings.
    pub mappings: u64,
    /// Threads.
    pub threads: u64,
    /// Descriptors.
    pub descriptors: u64,
}

/// What a soak found.
#[derive(Debug)]
pub struct Soak {
    /// What the process held, in order.
    pub samples: Vec<Sample>,
    /// Faults that the journal has.
    pub journaled: u64,
    /// Faults that came faster than they could be written down, and were counted.
    pub lost: u64,
    /// Instances that were left behind.
    pub quarantined: u64,
    /// How long it took.
    pub took: Duration,
    /// All that was not right.
    pub problems: Vec<String>,
}

/// Runs until there were `faults` faults, half of each kind; samples at each of `marks`, called with it.
///
/// # Panics
/// When the daemon does not come up.
#[must_use]
pub fn run(faults: u64, marks: &[u64], mut each: impl FnMut(&Sample)) -> Soak {
    let profiles = profiles(faults / 2);
    let mut daemon = Running::start_silent(profiles.path());
    let began = Instant::now();
    let mut journal = Tail::open(&daemon).expect("a daemon that is ready has a journal");
    let (mut samples, mut problems) = (Vec::new(), Vec::new());
    let mut since = Instant::now();
    while journal.faults + journal.lost < faults / 2 * 2 {
        let before = journal.faults + journal.lost;
        journal.read().expect("the journal can be read");
        let now = journal.faults + journal.lost;
        if !daemon.is_alive() || since.elapsed() > STALLED {
            problems.push(format!("it ended or stood still after {now} faults"));
            break;
        }
        if now > before {
            since = Instant::now();
        }
        if marks.get(samples.len()).is_some_and(|mark| now >= *mark) {
            samples.extend(sample(daemon.pid(), now).inspect(&mut each));
        }
        std::thread::sleep(PAUSE);
    }
    let took = began.elapsed();
    samples.extend(sample(daemon.pid(), journal.faults + journal.lost).inspect(&mut each));
    let slots = daemon.end().unwrap_or_else(|problem| {
        problems.push(problem);
        Vec::new()
    });
    let quarantined = slots.iter().filter_map(|slot| slot["quarantined"].as_u64()).sum();
    for slot in slots.iter().filter(|slot| slot["state"] != "active") {
        problems.push(format!("{} is {}", slot["slot"], slot["state"]));
    }
    let Tail { faults: journaled, lost, .. } = journal;
    let mut soak = Soak { samples, journaled, lost, quarantined, took, problems };
    soak.check();
    soak
}

/// Each class strikes `strikes` times, then all is quiet.
fn profiles(strikes: u64) -> Profiles {
    let rules = "<fault_tolerance><severity>reset</severity><reset limit=\"1000\" within=\"1ms\"/></fault_tolerance>";
    let inside = |executor: &str| {
        let property = |name: &str, value: u64| format!("<property name=\"{name}\" type=\"int\">{value}</property>");
        let properties = [property("after", 2), property("limit", strikes)].concat();
        format!("<executor>{executor}</executor><properties>{properties}</properties>{rules}")
    };
    let of = |class: &'static str, executor: &'static str| {
        (0..SLOTS).map(move |number| slot(&format!("{executor}{number}"), class, &inside(executor)))
    };
    let slots: Vec<String> = of("Panic", "panics").chain(of("NullWrite", "traps")).collect();
    let profiles = Profiles::new(&application(&slots, &[]));
    profiles.describe(&plugin_dir().join("libtorture.so"));
    for class in ["Panic", "NullWrite"] {
        profiles.replace(&format!("{class}.xml"), "<period>1ms</period>", "<period>200us</period>");
    }
    profiles.executors(&["panics", "traps"]);
    profiles
}

/// The journal as it grows: what was read is not read again.
struct Tail {
    reader: BufReader<File>,
    line: Vec<u8>,
    faults: u64,
    lost: u64,
}

impl Tail {
    fn open(daemon: &Running) -> io::Result<Self> {
        let reader = BufReader::with_capacity(1 << 20, File::open(daemon.journal_file())?);
        Ok(Self { reader, line: Vec::new(), faults: 0, lost: 0 })
    }

    fn read(&mut self) -> io::Result<()> {
        while self.reader.read_until(b'\n', &mut self.line)? > 0 && self.line.ends_with(b"\n") {
            let line = String::from_utf8_lossy(&self.line);
            self.faults += u64::from(line.contains("\"kind\":\"fault\""));
            if line.contains("\"kind\":\"lost\"") {
                let entry: Value = serde_json::from_str(&line).unwrap_or_default();
                self.lost += entry["count"].as_u64().unwrap_or(0);
            }
            self.line.clear();
        }
        Ok(())
    }
}

/// What the process holds now; `None`: it is gone.
fn sample(pid: u32, faults: u64) -> Option<Sample> {
    let read = |name: &str| std::fs::read_to_string(format!("/proc/{pid}/{name}")).ok();
    let status = read("status")?;
    let field = |name: &str| {
        let line = status.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(':'));
        line.and_then(|line| line.split_whitespace().next()?.parse::<u64>().ok()).unwrap_or(0)
    };
    Some(Sample {
        faults,
        rss_bytes: field("VmRSS") << 10,
        tables_bytes: field("VmPTE") << 10,
        space_bytes: field("VmSize") << 10,
        mappings: read("maps")?.lines().count() as u64,
        threads: field("Threads"),
        descriptors: std::fs::read_dir(format!("/proc/{pid}/fd")).ok()?.count() as u64,
    })
}

impl Sample {
    /// The head of the table.
    pub const HEAD: &str = "  faults    rss KiB  tables KiB   space MiB  mappings  threads  descriptors";

    /// One line of the table.
    #[must_use]
    pub fn text(&self) -> String {
        let Self { faults, mappings, threads, descriptors, .. } = self;
        let (rss, tables, space) = (self.rss_bytes >> 10, self.tables_bytes >> 10, self.space_bytes >> 20);
        format!("{faults:8} {rss:10} {tables:11} {space:11} {mappings:9} {threads:8} {descriptors:12}")
    }

    /// One line of JSON.
    #[must_use]
    pub fn json(&self) -> Value {
        json!({"faults": self.faults, "rss_bytes": self.rss_bytes, "tables_bytes": self.tables_bytes,
            "space_bytes": self.space_bytes, "mappings": self.mappings, "threads": self.threads,
            "descriptors": self.descriptors})
    }
}

impl Soak {
    /// From the first sample on nothing grows but what quarantined instances leave behind.
    fn check(&mut self) {
        let (Some(first), Some(last)) = (self.samples.first(), self.samples.last()) else { return };
        // Half of the faults are traps.
        let instances = self.quarantined.saturating_sub(first.faults / 2);
        let allowed = instances * LEAK_BYTES_MAX + SLACK_BYTES;
        let memory = |sample: &Sample| sample.rss_bytes + sample.tables_bytes;
        let grown = memory(last).saturating_sub(memory(first));
        if grown > allowed {
            self.problems.push(format!("memory grew by {grown} bytes for {instances} instances left behind"));
        }
        for (what, first, last) in [
            ("mappings", first.mappings, last.mappings),
            ("threads", first.threads, last.threads),
            ("descriptors", first.descriptors, last.descriptors),
        ] {
            if last > first + SLACK_COUNT {
                self.problems.push(format!("{what} grew from {first} to {last}"));
            }
        }
    }

    /// What a quarantined instance left behind, on average, between the first sample and the last.
    #[must_use]
    pub fn leak_bytes(&self) -> u64 {
        let (Some(first), Some(last)) = (self.samples.first(), self.samples.last()) else { return 0 };
        let instances = self.quarantined.saturating_sub(first.faults / 2).max(1);
        (last.rss_bytes + last.tables_bytes).saturating_sub(first.rss_bytes + first.tables_bytes) / instances
    }
}
