//! The largest connected patch of matching pixels.
//!
//! Decision: runs of each row joined by union-find, one pass, cost by the number of runs and not of pixels. Not chosen: flood fill
//! with a stack of pixels; same result, several times the memory traffic.

/// A connected patch, in pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Blob {
    /// Number of pixels.
    pub area: u32,
    /// Sum of the pixels' columns: the centroid is this through `area`.
    sum_u: u64,
    /// First and last row.
    rows: [u32; 2],
}

impl Blob {
    /// Column of the centroid, from the left edge.
    #[must_use]
    pub fn column(&self) -> f64 {
        self.sum_u as f64 / f64::from(self.area.max(1)) + 0.5
    }

    /// Mean width: area through height. Steady where a bounding box jumps with every stray pixel.
    #[must_use]
    pub fn width(&self) -> f64 {
        f64::from(self.area) / f64::from(self.rows[1] - self.rows[0] + 1)
    }

    fn of_run(run: &Run, row: u32) -> Self {
        let sum_u = (u64::from(run.start) + u64::from(run.end) - 1) * u64::from(run.end - run.start) / 2;
        Self { area: run.end - run.start, sum_u, rows: [row, row] }
    }

    fn join(&mut self, other: &Self) {
        self.area += other.area;
        self.sum_u += other.sum_u;
        self.rows = [self.rows[0].min(other.rows[0]), self.rows[1].max(other.rows[1])];
    }
}

/// Matching pixels `start..end` of one row, and the patch they belong to.
#[derive(Clone, Copy, Debug)]
struct Run {
    start: u32,
    end: u32,
    patch: usize,
}

/// Patches under construction. Keeps its memory from image to image.
#[derive(Clone, Debug, Default)]
pub struct BlobFinder {
    /// `parent[i]` is a patch that `i` was joined to, or `i` itself.
    parent: Vec<usize>,
    blobs: Vec<Blob>,
    above: Vec<Run>,
    row: Vec<Run>,
}

impl BlobFinder {
    /// The largest patch of pixels (`width` of them a row, three bytes each, `step` bytes from row to row) that `matches` accepts.
    pub fn largest(
        &mut self,
        data: &[u8],
        width: usize,
        step: usize,
        matches: impl Fn([u8; 3]) -> bool,
    ) -> Option<Blob> {
        self.parent.clear();
        self.blobs.clear();
        self.above.clear();
        if width == 0 || step < width * 3 {
            return None;
        }
        for (number, row) in (0_u32..).zip(data.chunks_exact(step)) {
            self.take_row(number, &row[..width * 3], &matches);
        }
        self.blobs.iter().copied().max_by_key(|blob| blob.area)
    }

    fn take_row(&mut self, number: u32, pixels: &[u8], matches: &impl Fn([u8; 3]) -> bool) {
        self.row.clear();
        let mut start = None;
        for (u, pixel) in (0_u32..).zip(pixels.chunks_exact(3)) {
            match (matches([pixel[0], pixel[1], pixel[2]]), start) {
                (true, None) => start = Some(u),
                (false, Some(first)) => {
                    self.row.push(Run { start: first, end: u, patch: 0 });
                    start = None;
                }
                _ => {}
            }
        }
        if let Some(first) = start {
            self.row.push(Run { start: first, end: (pixels.len() / 3) as u32, patch: 0 });
        }
        self.connect(number);
    }

    /// Gives each run of the row the patch of a run above that it touches, or a new one.
    fn connect(&mut self, number: u32) {
        for index in 0..self.row.len() {
            let run = self.row[index];
            let patch = self.blobs.len();
            self.parent.push(patch);
            self.blobs.push(Blob::of_run(&run, number));
            self.row[index].patch = patch;
            for other in 0..self.above.len() {
                let above = self.above[other];
                if above.start < run.end && run.start < above.end {
                    self.unite(patch, above.patch);
                }
            }
        }
        std::mem::swap(&mut self.above, &mut self.row);
    }

    fn unite(&mut self, a: usize, b: usize) {
        let (a, b) = (self.root(a), self.root(b));
        if a != b {
            let joined = std::mem::take(&mut self.blobs[a]);
            self.blobs[b].join(&joined);
            self.parent[a] = b;
        }
    }

    fn root(&mut self, mut patch: usize) -> usize {
        while self.parent[patch] != patch {
            // Halving the path on the way keeps later walks short.
            self.parent[patch] = self.parent[self.parent[patch]];
            patch = self.parent[patch];
        }
        patch
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Draws `#` as matching pixels.
    fn largest(picture: &[&str]) -> Option<Blob> {
        let width = picture[0].len();
        let data: Vec<u8> = picture.iter().flat_map(|row| row.bytes()).flat_map(|c| [c, 0, 0]).collect();
        BlobFinder::default().largest(&data, width, width * 3, |[c, _, _]| c == b'#')
    }

    #[test]
    fn a_shape_that_joins_late_is_one_patch() {
        let blob = largest(&["#...#", "#...#", "#####", "....."]);
        assert_eq!(blob.map(|blob| blob.area), Some(9));
        assert!(blob.is_some_and(|blob| (blob.column() - 2.5).abs() < 1e-9));
    }

    #[test]
    fn the_larger_of_two_wins() {
        let blob = largest(&["##...", "##.##", "...##", "...##"]).unwrap_or_default();
        assert_eq!(blob.area, 6);
        assert!((blob.column() - 4.0).abs() < 1e-9 && (blob.width() - 2.0).abs() < 1e-9);
    }

    #[test]
    fn nothing_gives_nothing_and_a_short_buffer_is_no_reason_to_panic() {
        assert_eq!(largest(&["....", "...."]), None);
        assert_eq!(BlobFinder::default().largest(&[1, 2, 3, 4], 3, 9, |_| true), None);
        assert_eq!(BlobFinder::default().largest(&[1, 2, 3, 4], 0, 0, |_| true), None);
    }
}
