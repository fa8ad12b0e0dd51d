//! The entry symbol and the shims behind it: what turns a Rust type into a component class.
//!
//! The panic is caught here, inside the plugin: the daemon's `catch_unwind` belongs to another copy of `std` and would
//! abort.
#![allow(unsafe_code, reason = "address of unsafe: an instance crosses the border as a pointer")]

use std::marker::PhantomData;
use std::panic::{AssertUnwindSafe, PanicHookInfo, catch_unwind};

use abi_stable::StableAbi;
use abi_stable::prefix_type::PrefixTypeTrait;
use abi_stable::std_types::{RStr, RString};
use abi_stable::type_layout::TypeLayout;

use super::calls::Incoming;
use super::class::{
    CallArgs, CallStatus, ComponentClass, CreateArgs, CreateResult, Hook, PluginModule, PluginModuleRef,
};
use super::host::{self, HostApi};
use super::inject;
use crate::component::{Callbacks, ComponentError, FaultInfo, Outcome};
use crate::context::Context;
use crate::property::Builder;

/// Exports component classes: `export_components!(AvoidancePrimary, AvoidanceSecondary);`, once in a crate.
#[macro_export]
macro_rules! export_components {
    ($($class:ty),+ $(,)?) => {
        const _: () = {
            static CLASSES: &[$crate::abi::class::ComponentClass] =
                &[$($crate::abi::export::Shims::<$class>::CLASS),+];

            extern "C" fn classes() -> $crate::abi::export::Classes {
                $crate::abi::export::Classes::from_slice(CLASSES)
            }

            extern "C" fn root() -> $crate::abi::class::PluginModuleRef {
                $crate::abi::export::root(classes)
            }

            // One symbol for each crate, named after it: a test may link several.
            #[allow(unsafe_code, reason = "the one symbol of a plugin; its prefix is reserved")]
            #[unsafe(export_name = concat!("component_plugin_", env!("CARGO_CRATE_NAME")))]
            pub static COMPONENT_PLUGIN: $crate::abi::header::PluginHeader = $crate::abi::header::PluginHeader::new(
                concat!(env!("CARGO_PKG_NAME"), " ", env!("CARGO_PKG_VERSION")),
                if cfg!(panic = "unwind") {
                    $crate::abi::header::PANIC_UNWIND
                } else {
                    $crate::abi::header::PANIC_ABORT
                },
                $crate::abi::export::layout,
                root,
            );
        };
    };
}

/// What `classes` returns.
pub type Classes = abi_stable::std_types::RSlice<'static, ComponentClass>;

/// The root module of a plugin with these classes.
#[must_use]
pub fn root(classes: extern "C" fn() -> Classes) -> PluginModuleRef {
    PluginModule { install, classes }.leak_into_prefix()
}

/// The layout of the root module.
#[must_use]
pub extern "C" fn layout() -> &'static TypeLayout {
    <PluginModuleRef as StableAbi>::LAYOUT
}

extern "C" fn install(host: &'static HostApi) {
    host::set(host);
    std::panic::set_hook(Box::new(hook));
}

/// Carries message, file and line out; no backtrace: with `RUST_BACKTRACE=1` the symboliser takes 50 to 150 ms.
fn hook(info: &PanicHookInfo<'_>) {
    let payload = info.payload();
    let message = payload
        .downcast_ref::<&str>()
        .copied()
        .or_else(|| payload.downcast_ref::<String>().map(String::as_str))
        .unwrap_or("panic with a payload that is no text");
    let (file, line) = info.location().map_or(("", 0), |location| (location.file(), location.line()));
    (host::get().note_panic)(RStr::from_str(message), RStr::from_str(file), line);
}

/// The shims of one class.
pub struct Shims<T>(PhantomData<T>);

impl<T: Callbacks> Shims<T> {
    /// The class as it is exported.
    pub const CLASS: ComponentClass =
        ComponentClass { decl: T::DECL, create: Self::create, call: Self::call, drop: Self::drop };

    extern "C" fn create(args: &CreateArgs<'_>) -> CreateResult {
        let built = catch_unwind(AssertUnwindSafe(|| {
            T::build(&mut Builder::new(args, T::DECL.properties.as_slice()))
                .map(|instance| Box::into_raw(Box::new(instance)))
        }));
        match built {
            Ok(Ok(instance)) => {
                CreateResult { instance: instance.cast(), status: CallStatus::Done, error: RString::new() }
            }
            Ok(Err(error)) => failed(CallStatus::Error, error.to_string()),
            Err(payload) => {
                swallow(payload);
                failed(CallStatus::Panic, String::new())
            }
        }
    }

    extern "C" fn call(instance: *mut (), args: &CallArgs<'_>) -> CallStatus {
        let outcome = catch_unwind(AssertUnwindSafe(|| {
            if args.inject != 0 {
                inject::provoke(args.inject)?;
            }
            // SAFETY: the daemon passes what `create` of this same class returned, one call at a time, and never
            // again after `drop` or after a trap.
            enter(unsafe { &mut *instance.cast::<T>() }, args)
        }));
        finish(outcome)
    }

    extern "C" fn drop(instance: *mut ()) -> CallStatus {
        finish(catch_unwind(AssertUnwindSafe(|| {
            // SAFETY: as in `call`; this is the last use of the instance.
            drop(unsafe { Box::from_raw(instance.cast::<T>()) });
            Ok(())
        })))
    }
}

fn failed(status: CallStatus, error: String) -> CreateResult {
    CreateResult { instance: std::ptr::null_mut(), status, error: error.into() }
}

fn enter<T: Callbacks>(component: &mut T, args: &CallArgs<'_>) -> Outcome {
    let cx = &mut Context::new(args.now_ns, host::get());
    let fault = FaultInfo {
        symptom: args.fault.symptom.as_str(),
        slot: args.fault.slot.as_str(),
        message: args.fault.message.as_str(),
    };
    match args.hook {
        Hook::Initialize => component.initialize(cx),
        Hook::Start => component.start(cx).and_then(|()| component.attend(cx)),
        Hook::Execute => component.on_execute(cx),
        Hook::Update => component.update(cx),
        Hook::Event => component.on_event(cx),
        Hook::Stop => component.stop(cx),
        Hook::Destroy => component.destroy(cx),
        Hook::Error => component.on_error(cx, &fault),
        Hook::Reset => component.reset(cx),
        Hook::Recover => component.recover(cx, &fault),
        Hook::Rehearse => component.rehearse(cx),
        Hook::Serve => component.serve(cx, &Incoming::new(&args.serve)),
        Hook::Emergency => component.on_emergency(cx),
    }
}

pub(super) fn finish(outcome: std::thread::Result<Result<(), ComponentError>>) -> CallStatus {
    match outcome {
        Ok(Ok(())) => CallStatus::Done,
        Ok(Err(error)) => {
            (host::get().note_error)(RStr::from_str(&error.to_string()));
            CallStatus::Error
        }
        Err(payload) => {
            swallow(payload);
            CallStatus::Panic
        }
    }
}

/// Drops a panic's payload; one whose own drop panics is leaked, for that panic would cross the border.
fn swallow(payload: Box<dyn std::any::Any + Send>) {
    if let Err(second) = catch_unwind(AssertUnwindSafe(|| drop(payload))) {
        Box::leak(second);
    }
}
