//! All cases by name.

use cases::table;

use crate::Hearer;
use crate::newest::*;
use crate::timed::*;

crate::push_cases!(table Hearer;);
