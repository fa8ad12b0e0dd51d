//! Finds a place for each label near its mark: the one of 24 that covers least.

use std::f64::consts::TAU;

const HEIGHT: f64 = 18.0;
/// Width of a letter of the label font, in pixels; an upper bound for the usual sans-serif faces.
const LETTER: f64 = 6.6;
const DIRECTIONS: u32 = 12;
const DISTANCES: [f64; 2] = [30.0, 62.0];

/// A rectangle along the axes, in pixels, y downwards.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Box2 {
    pub(super) left: f64,
    pub(super) top: f64,
    pub(super) right: f64,
    pub(super) bottom: f64,
}

impl Box2 {
    pub(super) fn around(centre: (f64, f64), radius: f64) -> Self {
        let (x, y) = centre;
        Self { left: x - radius, top: y - radius, right: x + radius, bottom: y + radius }
    }

    pub(super) fn centre(&self) -> (f64, f64) {
        ((self.left + self.right) / 2.0, (self.top + self.bottom) / 2.0)
    }

    pub(super) fn size(&self) -> (f64, f64) {
        (self.right - self.left, self.bottom - self.top)
    }

    /// The point of this box nearest to `from`: where a line from there ends.
    pub(super) fn anchor(&self, from: (f64, f64)) -> (f64, f64) {
        (from.0.clamp(self.left, self.right), from.1.clamp(self.top, self.bottom))
    }

    fn overlap(&self, other: &Self) -> f64 {
        let width = self.right.min(other.right) - self.left.max(other.left);
        let height = self.bottom.min(other.bottom) - self.top.max(other.top);
        width.max(0.0) * height.max(0.0)
    }

    fn outside(&self, frame: &Self) -> f64 {
        let (width, height) = self.size();
        width * height - self.overlap(frame)
    }
}

/// One box per mark, within `frame` if possible, clear of `taken`, of all marks and of each other.
pub(super) fn place(marks: &[(f64, f64)], texts: &[String], frame: Box2, mut taken: Vec<Box2>) -> Vec<Box2> {
    taken.extend(marks.iter().map(|mark| Box2::around(*mark, 11.0)));
    let mut placed = Vec::new();
    for (mark, text) in marks.iter().zip(texts) {
        let cost = |spot: &Box2| {
            let covered: f64 = taken.iter().map(|other| spot.overlap(other)).sum();
            covered + 4.0 * spot.outside(&frame)
        };
        // The first of equals wins, so the near ring is preferred to the far one.
        let best = candidates(*mark, text).min_by(|a, b| cost(a).total_cmp(&cost(b)));
        if let Some(best) = best {
            taken.push(best);
            placed.push(best);
        }
    }
    placed
}

fn candidates(mark: (f64, f64), text: &str) -> impl Iterator<Item = Box2> {
    let (width, (x, y)) = (text.chars().count() as f64 * LETTER + 10.0, mark);
    let around = move |distance: f64, direction: u32| {
        let angle = TAU * (f64::from(direction) / f64::from(DIRECTIONS) - 0.25);
        // Sideways a label needs half its width more room than upwards.
        let centre = (x + angle.cos() * (distance + width / 2.0 - 12.0), y + angle.sin() * distance);
        Box2 {
            left: centre.0 - width / 2.0,
            top: centre.1 - HEIGHT / 2.0,
            right: centre.0 + width / 2.0,
            bottom: centre.1 + HEIGHT / 2.0,
        }
    };
    DISTANCES.into_iter().flat_map(move |distance| (0..DIRECTIONS).map(move |direction| around(distance, direction)))
}

#[cfg(test)]
mod tests {
    use super::{Box2, place};

    #[test]
    fn labels_of_near_marks_do_not_cover_each_other() {
        let marks = [(200.0, 100.0), (208.0, 104.0), (214.0, 100.0)];
        let texts = ["avoider crash.segv", "sonar crash.fpe", "odometry crash.abort"].map(String::from);
        let frame = Box2 { left: 0.0, top: 0.0, right: 600.0, bottom: 300.0 };
        let placed = place(&marks, &texts, frame, Vec::new());
        for (index, one) in placed.iter().enumerate() {
            assert!(one.outside(&frame) < 1e-6);
            assert!(placed[index + 1..].iter().all(|other| one.overlap(other) == 0.0));
        }
    }
}
