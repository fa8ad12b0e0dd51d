//! Did you mean: the nearest right name to a wrong one.

/// Similarity (0 to 1) from which a name is worth suggesting; below it suggestions look random.
const LIKELY: f64 = 0.72;

/// The candidate nearest to `wrong`, if it is near enough to be what was meant.
#[must_use]
pub fn nearest<'a>(wrong: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
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

/// A hint that names the nearest candidate, or lists all where they are few.
#[must_use]
pub fn hint<'a>(wrong: &str, candidates: &[&'a str], quote: impl Fn(&'a str) -> String) -> Option<String> {
    const FEW: usize = 12;
    if let Some(name) = nearest(wrong, candidates.iter().copied()) {
        return Some(format!("did you mean {}?", quote(name)));
    }
    if candidates.is_empty() || candidates.len() > FEW {
        return None;
    }
    let all: Vec<String> = candidates.iter().map(|name| quote(name)).collect();
    Some(format!("possible here: {}", all.join(", ")))
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
}
