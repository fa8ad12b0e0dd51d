//! The plugins' side of the conformance tests: a component runs one case in each callback and logs how it went.
//!
//! The names of a plugin's cases stand in one list, a macro that hands them to another macro: the plugin makes a table of
//! functions of them, the tests one test each.
//!
//! ```
//! /// All cases.
//! #[macro_export]
//! macro_rules! sum_cases {
//!     ($then:ident $($arguments:tt)*) => { $then! { $($arguments)* one_and_one_is_two, nothing_is_added_to_nothing } };
//! }
//! ```

use std::fmt::Debug;

use component_sdk::context::Context;
use component_sdk::status::Status;
use component_sdk::{error, info};

/// A case; what went wrong.
pub type Case<C> = fn(&mut C, &mut Context<'_>) -> Result<(), String>;

/// Makes a table `ALL` of the functions of these names, for components of that type.
#[macro_export]
macro_rules! table {
    ($component:ty; $($name:ident),+ $(,)?) => {
        /// By name, in the order in which they run.
        pub(crate) const ALL: &[(&str, $crate::Case<$component>)] = &[$((stringify!($name), $name)),+];
    };
}

/// Runs the case of that number and logs how it went; the number of the next one.
pub fn run<C>(all: &[(&str, Case<C>)], number: usize, component: &mut C, cx: &mut Context<'_>) -> usize {
    let Some((name, case)) = all.get(number) else { return number };
    match case(component, cx) {
        Ok(()) => info!(cx, "case {name}: ok"),
        Err(why) => error!(cx, "case {name}: {why}"),
    }
    if number + 1 == all.len() {
        info!(cx, "all cases are done");
    }
    number + 1
}

/// Compares.
///
/// # Errors
/// Both, where they differ.
#[allow(clippy::needless_pass_by_value, reason = "what is compared is made for it")]
pub fn same<T: PartialEq + Debug>(found: T, wanted: T) -> Result<(), String> {
    if found == wanted { Ok(()) } else { Err(format!("{found:?} instead of {wanted:?}")) }
}

/// What a case needs to go on.
///
/// # Errors
/// The status, as text.
pub fn text<T>(result: Result<T, Status>) -> Result<T, String> {
    result.map_err(|status| format!("{status:?}"))
}
