//! An instance with its bindings, and the recipe for another one.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use abi_stable::std_types::RStr;
use component_sdk::abi::class::{CallStatus, ClassDecl, Direction, Hook};
use component_sdk::abi::payload::PortHandle;

use super::checkpoint::{self, Region};
use super::slot::Slot;
use super::task::Tasks;
use crate::detect::deadline;
use crate::model::fault::{Evidence, Fault};
use crate::model::limits::{HANG, HANG_AT_START, HANG_AT_STOP, NEAR_BYTES, STACK_BYTES};
use crate::model::symptom::Symptom;
use crate::model::time::nanoseconds;
use crate::plugin::Class;
use crate::plugin::instance::{self, Instance};
use crate::port::border::Binding;
use crate::profile::plan::Execution;
use crate::sys::seat::{self, Note, Owner};
use crate::sys::{arch, clock};

/// Finds and loads a class when it is needed: `preload="none"`.
pub type Loader = Arc<dyn Fn() -> Result<Class, String> + Send + Sync>;

/// Where a class comes from.
#[derive(Clone)]
pub enum Source {
    /// Its library is loaded.
    Loaded(Class),
    /// Its library is loaded when the class is needed.
    Lazy(Loader),
}

/// How an instance for a slot is made.
#[derive(Clone)]
pub struct Recipe {
    /// Its number on the slot's shelf.
    pub number: usize,
    /// Name of its class.
    pub class_name: &'static str,
    /// Its class.
    pub source: Source,
    /// Property texts by name; the class's defaults hold for the others.
    pub properties: Vec<(String, String)>,
    /// What its callbacks may take.
    pub limits: Limits,
}

/// What callbacks may take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Stack of a fiber in bytes.
    pub stack_bytes: usize,
    /// Budget of `on_execute` in nanoseconds; beyond it an overrun.
    pub budget_ns: Option<u64>,
    /// Time in which a callback in operation must return, in nanoseconds; beyond it a hang.
    pub hang_ns: u64,
}

impl Limits {
    /// What a component profile says, with the defaults for what it does not say.
    #[must_use]
    pub fn new(execution: &Execution) -> Self {
        Self {
            stack_bytes: execution.stack.unwrap_or(STACK_BYTES),
            budget_ns: execution.deadline.map(|deadline| nanoseconds(deadline.budget)),
            hang_ns: nanoseconds(execution.deadline.map_or(HANG, |deadline| deadline.hang)),
        }
    }

    /// The fault of an `on_execute` that returned after `took_ns`, if that was too late.
    #[must_use]
    pub fn late(&self, took_ns: u64) -> Option<Fault> {
        let budget_ns = self.budget_ns.filter(|budget_ns| deadline::is_overrun(took_ns, *budget_ns))?;
        let now = clock::now_ns();
        let evidence = Evidence::Time { took_ns, budget_ns };
        // It happened when the budget was over.
        let at_ns = now - (took_ns - budget_ns);
        let injected = seat::is_left(Note::Injected);
        Some(Fault { at_ns, injected, ..Fault::told(Symptom::Overrun, now, evidence) })
    }

    /// True where time is measured exactly: a callback has a budget, or must return so soon that a tick of the kernel counts.
    #[must_use]
    pub const fn is_tight(&self) -> bool {
        self.budget_ns.is_some() || !clock::is_long(self.hang_ns)
    }

    /// Time in which that callback must return, in nanoseconds.
    #[must_use]
    pub const fn of(&self, hook: Hook) -> u64 {
        match hook {
            Hook::Initialize | Hook::Start => nanoseconds(HANG_AT_START),
            Hook::Stop | Hook::Destroy => nanoseconds(HANG_AT_STOP),
            Hook::Execute
            | Hook::Update
            | Hook::Event
            | Hook::Serve
            | Hook::Error
            | Hook::Reset
            | Hook::Recover
            | Hook::Rehearse
            | Hook::Emergency => self.hang_ns,
        }
    }
}

/// An instance in a slot.
pub struct Unit {
    /// The instance.
    pub instance: Instance,
    /// Its slot, and its number: no other instance ever has the same.
    pub owner: Owner,
    /// The slot's tasks, for those that it starts.
    pub tasks: Arc<Tasks>,
    /// Its class's name.
    pub class: &'static str,
    /// Stands for its plugin's file.
    pub build: u64,
    /// Number of the slot's recipe that it was made after.
    pub recipe: usize,
    /// What its callbacks may take.
    pub limits: Limits,
    /// It trapped: it may never be entered or dropped again.
    pub spent: bool,
    /// Its `start` went well.
    pub started: bool,
    /// It has had tasks: what they were given is not its own any more.
    pub gave_to_tasks: AtomicBool,
    /// Its checkpoint: fields of the instance, and what it registered.
    pub regions: Vec<Region>,
    bindings: Vec<Binding>,
    in_use: AtomicBool,
}

/// All that is there before the constructor runs.
pub struct Parts {
    owner: Owner,
    tasks: Arc<Tasks>,
    class: Class,
    bindings: Vec<Binding>,
    handles: Vec<PortHandle>,
    properties: Vec<String>,
    recipe: usize,
    limits: Limits,
}

impl Recipe {
    /// The class, loaded now where it was not.
    ///
    /// # Errors
    /// In words, when it cannot be loaded.
    pub fn class(&self) -> Result<Class, String> {
        match &self.source {
            Source::Loaded(class) => Ok(class.clone()),
            Source::Lazy(load) => load(),
        }
    }

    /// Gathers what the constructor needs: class, bindings to the slot's ports, property texts.
    ///
    /// # Errors
    /// In words, when the class cannot be loaded or does not fit the slot.
    pub fn gather(&self, slot: &Slot) -> Result<Parts, String> {
        let class = self.class()?;
        let decl = &class.exported().decl;
        let owner = Owner { slot: slot.name, instance: instance::next_number() };
        let bindings = bind(decl, slot, owner.instance)?;
        let handles = bindings.iter().map(Binding::handle).collect();
        let properties = decl.properties.iter().map(|property| self.property(property)).collect();
        let tasks = Arc::clone(&slot.tasks);
        Ok(Parts { owner, class, bindings, handles, properties, recipe: self.number, limits: self.limits, tasks })
    }

    fn property(&self, decl: &component_sdk::abi::class::PropertyDecl) -> String {
        let given = self.properties.iter().find(|(name, _)| name == decl.name.as_str());
        given.map_or_else(|| decl.default.to_string(), |(_, text)| text.clone())
    }
}

fn bind(decl: &ClassDecl, slot: &Slot, instance: u64) -> Result<Vec<Binding>, String> {
    decl.ports
        .iter()
        .map(|port| {
            let end = slot.end(&port.full_name(), port.direction == Direction::Input);
            let end = end.ok_or_else(|| format!("class {}: the slot has no port `{}`", decl.name, port.name))?;
            Binding::new(end, instance).ok_or_else(|| "no port handle is left".to_owned())
        })
        .collect()
}

impl Parts {
    /// Runs the constructor: plugin code, so on a fiber only.
    ///
    /// # Errors
    /// How the constructor ended, and its text.
    pub fn build(&self, texts: &[RStr<'_>]) -> Result<Instance, (CallStatus, String)> {
        Instance::create(self.class.exported(), &self.handles, texts)
    }

    /// Property texts in the class's order, as the constructor gets them.
    #[must_use]
    pub fn texts(&self) -> Vec<RStr<'_>> {
        self.properties.iter().map(|text| RStr::from_str(text)).collect()
    }

    /// The unit, once the instance is there.
    #[must_use]
    pub fn finish(self, instance: Instance) -> Box<Unit> {
        Box::new(Unit {
            regions: critical_fields(&self.class.exported().decl, instance.address()),
            instance,
            owner: self.owner,
            tasks: self.tasks,
            class: self.class.name(),
            build: self.class.plugin().build,
            recipe: self.recipe,
            limits: self.limits,
            spent: false,
            started: false,
            gave_to_tasks: AtomicBool::new(false),
            bindings: self.bindings,
            in_use: AtomicBool::new(false),
        })
    }

    /// The instance to be.
    #[must_use]
    pub const fn owner(&self) -> Owner {
        self.owner
    }

    /// What its callbacks may take.
    #[must_use]
    pub const fn limits(&self) -> Limits {
        self.limits
    }

    /// The class's name.
    #[must_use]
    pub fn class_name(&self) -> &'static str {
        self.class.name()
    }
}

/// The fields that the class calls critical.
fn critical_fields(decl: &ClassDecl, address: usize) -> Vec<Region> {
    let fields = decl.criticals.iter();
    // A description that is wrong must not lead out of the instance.
    let inside = fields.filter(|field| field.offset.checked_add(field.size).is_some_and(|end| end <= decl.size));
    inside.map(|field| Region { name: field.name.as_str(), address: address + field.offset, len: field.size }).collect()
}

impl Unit {
    /// Whose regions a checkpoint of it holds.
    #[must_use]
    pub const fn origin(&self) -> checkpoint::Instance {
        checkpoint::Instance { class: self.class, build: self.build }
    }

    /// Adds a region to its checkpoint, or moves it.
    pub fn register(&mut self, region: Region) {
        match self.regions.iter_mut().find(|known| known.name == region.name) {
            Some(known) => *known = region,
            None => self.regions.push(region),
        }
    }

    /// The instance trapped: it is never entered again, and nothing of it is freed, because its memory may be
    /// half-changed. What the daemon had for it is.
    pub fn quarantine(self) {
        self.bindings.iter().for_each(Binding::forget_scratch);
    }

    /// Fetches its memory to this processor, as far as it is one piece.
    pub fn bring_near(&self) {
        arch::bring_near(std::ptr::from_ref(self).addr(), size_of::<Self>());
        self.bindings.iter().for_each(Binding::bring_near);
        let size = self.instance.class().decl.size;
        arch::bring_near(self.instance.address(), size.min(NEAR_BYTES));
    }

    /// Good for another `start` or `reset` after the slot has stopped: not spent, and nothing of it went away with its tasks.
    #[must_use]
    pub fn is_whole(&self) -> bool {
        !self.spent && !self.gave_to_tasks.load(Ordering::Relaxed)
    }

    /// It takes the slot over: its ports lead somewhere.
    pub fn open(&self) {
        self.in_use.store(true, Ordering::Relaxed);
        self.bindings.iter().for_each(Binding::open);
    }

    /// It has the slot.
    #[must_use]
    pub fn is_in_use(&self) -> bool {
        self.in_use.load(Ordering::Relaxed)
    }

    /// It left the slot: its ports are closed.
    pub fn close(&self) {
        self.in_use.store(false, Ordering::Relaxed);
        self.bindings.iter().for_each(Binding::close);
    }
}
