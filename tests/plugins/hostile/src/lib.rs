//! Components that fail on purpose, where and how their properties say.
//!
//! Faults in `on_execute` are provoked by the SDK's shim; these are for all other callbacks, for constructors and drops.
#![allow(unsafe_code, reason = "faults on purpose")]

use std::sync::atomic::{AtomicU64, Ordering};

use component_sdk::prelude::*;

pub mod asked;
pub mod brake;
pub mod busy;

/// Fails in one of its callbacks, once in a process, or each time.
#[derive(Component)]
#[component(name = "Doomed", version = "1.0", periodic = "5ms")]
pub struct Doomed {
    /// In which callback.
    #[property(default = "none")]
    hook: String,
    /// `panic`, `segv`, `wild`, `copy`, `check`, `sleep`, `error`.
    #[property(default = "panic")]
    how: String,
    /// Fails in its third `on_execute` first, so that the callbacks after a fault are reached.
    #[property(default = false)]
    bait: bool,
    cycles: u64,
}

impl Doomed {
    fn visit(&self, hook: &str) -> Outcome {
        if self.hook == hook { fail(&self.how) } else { Ok(()) }
    }
}

fn fail(how: &str) -> Outcome {
    match how {
        "panic" => panic!("doomed"),
        "segv" => {
            // SAFETY: none; the write faults, which is its purpose.
            unsafe { std::hint::black_box(24 as *mut u32).write_volatile(1) };
            Ok(())
        }
        "wild" => {
            // SAFETY: none; the write faults, which is its purpose: user space ends below.
            unsafe { std::hint::black_box(0x7fff_ffff_f000 as *mut u32).write_volatile(1) };
            Ok(())
        }
        "copy" => {
            let mut into = vec![0u8; std::hint::black_box(4096)];
            // SAFETY: none; the C library's copy faults, which is its purpose.
            unsafe { std::hint::black_box(24 as *const u8).copy_to(into.as_mut_ptr(), into.len()) };
            Err(fault!("copied {}", into[0]))
        }
        "check" => {
            unsafe extern "C" {
                fn free(address: *mut u8);
            }
            let mut block = vec![0u64; 64];
            // SAFETY: none; no block begins there, which the C library's heap finds out.
            unsafe { free(std::hint::black_box(block.as_mut_ptr().cast::<u8>().add(24))) };
            Ok(())
        }
        "sleep" => {
            std::thread::sleep(std::time::Duration::from_secs(3600));
            Ok(())
        }
        _ => Err(fault!("doomed")),
    }
}

impl Callbacks for Doomed {
    fn initialize(&mut self, _: &mut Context<'_>) -> Outcome {
        self.visit("initialize")
    }
    fn start(&mut self, _: &mut Context<'_>) -> Outcome {
        self.visit("start")
    }
    fn on_execute(&mut self, _: &mut Context<'_>) -> Outcome {
        self.cycles += 1;
        match (self.bait && self.cycles == 3, self.hook.as_str()) {
            // A trap leads to `recover`, a panic to `on_error` and `reset`.
            (true, "recover") => fail("segv"),
            (true, _) => fail("panic"),
            _ => self.visit("execute"),
        }
    }
    fn update(&mut self, _: &mut Context<'_>) -> Outcome {
        self.visit("update")
    }
    fn stop(&mut self, _: &mut Context<'_>) -> Outcome {
        self.visit("stop")
    }
    fn destroy(&mut self, _: &mut Context<'_>) -> Outcome {
        self.visit("destroy")
    }
    fn on_error(&mut self, _: &mut Context<'_>, _: &FaultInfo<'_>) -> Outcome {
        self.visit("error")
    }
    fn reset(&mut self, _: &mut Context<'_>) -> Outcome {
        self.visit("reset")
    }
    fn recover(&mut self, _: &mut Context<'_>, _: &FaultInfo<'_>) -> Outcome {
        self.visit("recover")
    }
}

impl Drop for Doomed {
    fn drop(&mut self) {
        if self.hook == "drop" {
            let _ = fail(&self.how);
        }
    }
}

/// Fails in its constructor, on a part that is built by `Default`.
#[derive(Component)]
#[component(name = "Stillborn", version = "1.0", passive)]
pub struct Stillborn {
    #[allow(dead_code, reason = "its constructor is what matters")]
    part: Part,
}

struct Part;

impl Default for Part {
    fn default() -> Self {
        let _ = fail("segv");
        Self
    }
}

impl Callbacks for Stillborn {}

/// Counts the instances of the process; some of them cannot be initialised.
#[derive(Component)]
#[component(name = "Heir", version = "1.0", periodic = "5ms")]
pub struct Heir {
    /// The first one that fails.
    #[property(default = 2)]
    from: u64,
    /// The first one after it that does not.
    #[property(default = 4)]
    until: u64,
    /// `panic`, `segv`, `error`.
    #[property(default = "panic")]
    how: String,
    /// How long `initialize` takes from the second on, in milliseconds.
    #[property(default = 0)]
    slow: u64,
    #[port]
    said: DataOut<Range>,
    number: u64,
}

static HEIRS: AtomicU64 = AtomicU64::new(0);

impl Callbacks for Heir {
    fn on_execute(&mut self, _: &mut Context<'_>) -> Outcome {
        self.said.write(Range { range: self.number as f32, ..Range::default() });
        Ok(())
    }
    fn initialize(&mut self, cx: &mut Context<'_>) -> Outcome {
        self.number = HEIRS.fetch_add(1, Ordering::Relaxed) + 1;
        if self.number > 1 {
            std::thread::sleep(std::time::Duration::from_millis(self.slow));
        }
        if (self.from..self.until).contains(&self.number) {
            return fail(&self.how);
        }
        info!(cx, "heir {} is ready", self.number);
        Ok(())
    }
    fn recover(&mut self, cx: &mut Context<'_>, _: &FaultInfo<'_>) -> Outcome {
        info!(cx, "heir {} succeeds", self.number);
        Ok(())
    }
    fn destroy(&mut self, cx: &mut Context<'_>) -> Outcome {
        info!(cx, "heir {} ends", self.number);
        Ok(())
    }
    fn rehearse(&mut self, cx: &mut Context<'_>) -> Outcome {
        let mut said = self.said.loan();
        said.range = -1.0;
        info!(cx, "heir {} rehearses: {:?}", self.number, said.send());
        Ok(())
    }
}

/// Keeps a number in memory of its own, outside the instance, and one inside.
#[derive(Component)]
#[component(name = "Keeper", version = "1.0", periodic = "2ms")]
pub struct Keeper {
    /// Registers a region that is not there.
    #[property(default = false)]
    wild: bool,
    region: Option<&'static AtomicU64>,
    #[critical]
    inside: u64,
    told: bool,
}

impl Callbacks for Keeper {
    fn initialize(&mut self, cx: &mut Context<'_>) -> Outcome {
        let number: &'static AtomicU64 = Box::leak(Box::default());
        let address = if self.wild { std::ptr::without_provenance_mut(64) } else { number.as_ptr() };
        // SAFETY: a number of 8 bytes that is never freed; or, on purpose, none.
        cx.critical("outside", unsafe { std::slice::from_raw_parts_mut(address.cast(), 8) });
        self.region = Some(number);
        Ok(())
    }
    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        let Some(outside) = self.region else { return Err(fault!("no region")) };
        let number = outside.fetch_add(1, Ordering::Relaxed);
        if !std::mem::replace(&mut self.told, true) {
            info!(cx, "keeper goes on from {number} and {}", self.inside);
        }
        self.inside += 1;
        Ok(())
    }
}

/// Does not return from each tenth `on_execute`, in one of several ways; or traps inside the C library.
#[derive(Component)]
#[component(name = "Stuck", version = "1.0", periodic = "2ms")]
pub struct Stuck {
    /// `spin`, `sleep`, `malloc`, `lock`, `read`, `slow`, `memcpy`, `corrupt`, `free`.
    #[property(default = "spin")]
    how: String,
    cycles: u64,
}

impl Callbacks for Stuck {
    fn on_execute(&mut self, _: &mut Context<'_>) -> Outcome {
        self.cycles += 1;
        if self.cycles.is_multiple_of(10) {
            stick(&self.how);
        }
        Ok(())
    }
}

#[allow(clippy::empty_loop, reason = "a hang on purpose")]
fn stick(how: &str) {
    use std::hint::black_box;
    match how {
        "spin" => loop {},
        "sleep" => std::thread::sleep(std::time::Duration::from_secs(3600)),
        "malloc" => loop {
            black_box(vec![black_box(1u8); 100]);
        },
        "lock" => {
            let lock = std::sync::Mutex::new(());
            let _first = lock.lock();
            let _second = lock.lock();
        }
        "read" => {
            let (mut reader, _writer) = std::io::pipe().expect("a pipe");
            let _ = std::io::Read::read(&mut reader, &mut [0]);
        }
        "slow" => std::thread::sleep(std::time::Duration::from_millis(12)),
        "memcpy" => {
            let mut target = [0u8; 64];
            // SAFETY: none; the source is no memory, which is what is tested.
            unsafe { std::ptr::copy_nonoverlapping(black_box(64 as *const u8), target.as_mut_ptr(), black_box(64)) };
            black_box(target);
        }
        "corrupt" => {
            let memory = black_box(Box::into_raw(Box::new([0u64; 500])));
            let beyond = black_box(Box::new([0u64; 500]));
            // SAFETY: none; what lies behind the memory is the heap's own, which is what is tested.
            unsafe {
                memory.cast::<u64>().add(501).write_volatile(0xbad0);
                drop(Box::from_raw(memory));
            }
            drop(beyond);
        }
        _ => {
            let memory = black_box(Box::into_raw(Box::new([0u64; 500])));
            // SAFETY: none; the second drop frees what is free, which is what is tested.
            unsafe {
                drop(Box::from_raw(memory));
                drop(Box::from_raw(memory));
            }
        }
    }
}

/// Sends scans; every tenth one says that its ranges lie where nothing is.
#[derive(Component)]
#[component(name = "Forger", version = "1.0", periodic = "2ms")]
pub struct Forger {
    #[port]
    said: DataOut<LaserScan>,
    cycles: u64,
}

impl Callbacks for Forger {
    fn on_execute(&mut self, _: &mut Context<'_>) -> Outcome {
        self.cycles += 1;
        let mut scan = self.said.loan();
        if self.cycles.is_multiple_of(10) {
            // SAFETY: none; address, length and capacity of the sequence are forged, which is its purpose.
            unsafe { (&raw mut scan.ranges).cast::<[usize; 3]>().write([64, 1000, 0]) };
        } else {
            scan.ranges = [1.0, 2.0].into_iter().collect();
        }
        scan.send();
        Ok(())
    }
}

/// Logs every tenth scan that it hears.
#[derive(Component)]
#[component(name = "Auditor", version = "1.0", nonperiodic)]
pub struct Auditor {
    #[port(fifo = 64)]
    heard: DataIn<LaserScan>,
    received: u64,
}

impl Callbacks for Auditor {
    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        while let Some(scan) = self.heard.take() {
            self.received += 1;
            if self.received.is_multiple_of(10) {
                let ranges: &[f32] = &scan.ranges;
                info!(cx, "audited {} scans, the last with {ranges:?}", self.received);
            }
        }
        Ok(())
    }
}

export_components!(
    asked::Fragile,
    asked::Prober,
    brake::Brake,
    brake::Witness,
    busy::Asker,
    busy::Busy,
    busy::Depositor,
    busy::Eager,
    busy::Insistent,
    busy::Ledger,
    busy::Moody,
    busy::Overlong,
    Doomed,
    Stillborn,
    Heir,
    Keeper,
    Forger,
    Auditor,
    Stuck
);
