//! Did you mean: the nearest right name to a wrong one.

use crate::model::limits;

/// Similarity (0 to 1) from which a name is worth suggesting; below it suggestions look random.
const LIKELY: f64 = 0.72;

/// The candidate nearest to `wrong`, if it is near enough to be what was meant.
#[must_use]
pub fn nearest<'a>(wrong: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    // What is longer than any name is near none, and to find that out would take seconds.
    if wrong.len() > 8 * limits::NAME_CHARS {
        return None;
    }
    let wrong_lower = wrong.to_lowercase();
    let scored = candidates.into_iter().map(|name| (score(&wrong_lower, &name.to_lowercase()), name));
    let best = scored.filter(|(score, _)| *score >= LIKELY).max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(a.1)))?;
    Some(best.1)
}

/// Transposed and missing letters count little (`Jaro-Winkler` alone rewards a common prefix too much).
fn score(wrong: &str, right: &str) -> f64 {
    let edits = strsim::normalized_damerau_levenshtein(wrong, right);
    f64::midpoint(strsim::jaro_winkler(wrong, right), edits).max(edits)
}

/// A hint that names the nearest candidate, or lists those there are. `None`: there are none.
#[must_use]
pub fn hint<'a>(wrong: &str, candidates: &[&'a str], quote: impl Fn(&'a str) -> String) -> Option<String> {
    if let Some(name) = nearest(wrong, candidates.iter().copied()) {
        return Some(format!("did you mean {}?", quote(name)));
    }
    let quoted: Vec<String> = candidates.iter().map(|name| quote(name)).collect();
    let list = listed(quoted.iter().map(String::as_str));
    (!candidates.is_empty()).then(|| format!("possible here: {list}"))
}

/// Names in a row: all of a few, the first of many and how many more there are.
#[must_use]
pub fn listed<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    const FEW: usize = 12;
    let names: Vec<&str> = names.into_iter().collect();
    let shown: Vec<&str> = names.iter().copied().take(FEW).collect();
    let more = names.len() - shown.len();
    if more == 0 { shown.join(", ") } else { format!("{} and {more} more", shown.join(", ")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slips_are_found_and_strangers_are_not() {
        let names = ["severity", "secondary", "reset", "fault_tolerance"];
        assert_eq!(nearest("severty", names), Some("severity"));
        assert_eq!(nearest("fault_tolerence", names), Some("fault_tolerance"));
        assert_eq!(nearest("RESET", names), Some("reset"));
        assert_eq!(nearest("banana", names), None);
    }

    #[test]
    fn of_many_names_the_first_are_listed() {
        assert_eq!(
            hint("banana", &["severity", "reset"], str::to_owned).as_deref(),
            Some("possible here: severity, reset")
        );
        assert_eq!(hint("banana", &[], str::to_owned), None);
        let many: Vec<String> = (0..40).map(|number| format!("slot{number}")).collect();
        assert!(listed(many.iter().map(String::as_str)).ends_with("slot10, slot11 and 28 more"));
    }
}
