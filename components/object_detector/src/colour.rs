//! Which pixels have the target's colour: hue, saturation and brightness within limits.
//!
//! Decision: hue and saturation instead of distances in RGB, because shade changes all three channels of a lit surface but hardly
//! its hue. Integers until the last step: most pixels are grey and drop out before any division.

use std::f64::consts::TAU;

/// A range of colours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Colour {
    /// Hue in degrees: 0 red, 120 green, 240 blue.
    pub hue: f64,
    /// Farthest from `hue`, in degrees, 0 to 180.
    pub tolerance: f64,
    /// Least saturation, 0 grey to 1 pure.
    pub min_saturation: f64,
    /// Least brightness of the brightest channel, 0 to 1.
    pub min_value: f64,
}

impl Colour {
    /// The test for one pixel, with the limits scaled once for the whole image.
    #[must_use]
    pub fn matcher(&self) -> Matcher {
        let scale = |share: f64| (share.clamp(0.0, 1.0) * 255.0) as i32;
        Matcher {
            hue: self.hue,
            tolerance: self.tolerance,
            saturation: scale(self.min_saturation),
            value: scale(self.min_value),
        }
    }
}

/// See [`Colour::matcher`].
#[derive(Clone, Copy, Debug)]
pub struct Matcher {
    hue: f64,
    tolerance: f64,
    saturation: i32,
    value: i32,
}

impl Matcher {
    /// Whether a pixel is of the colour.
    #[must_use]
    pub fn matches(&self, [red, green, blue]: [u8; 3]) -> bool {
        let [r, g, b] = [red, green, blue].map(i32::from);
        let brightest = r.max(g).max(b);
        let spread = brightest - r.min(g).min(b);
        if brightest < self.value || spread == 0 || spread * 255 < self.saturation * brightest {
            return false;
        }
        let off = (hue(r, g, b, brightest, spread) - self.hue).rem_euclid(360.0);
        off.min(360.0 - off) <= self.tolerance
    }
}

/// Hue in degrees of a pixel that is not grey.
fn hue(r: i32, g: i32, b: i32, brightest: i32, spread: i32) -> f64 {
    let (offset, difference) = match brightest {
        v if v == r => (0.0, g - b),
        v if v == g => (120.0, b - r),
        _ => (240.0, r - g),
    };
    offset + 60.0 * f64::from(difference) / f64::from(spread)
}

/// A pinhole camera looking straight ahead.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Horizontal field of view in rad.
    pub field_of_view: f64,
}

impl Camera {
    /// Focal length in pixels of an image of `width` pixels.
    #[must_use]
    pub fn focal_length(&self, width: u32) -> f64 {
        f64::from(width) / 2.0 / (self.field_of_view.clamp(0.1, TAU / 2.1) / 2.0).tan()
    }

    /// Direction of column `u` (left positive) in an image of `width` pixels, in rad.
    #[must_use]
    pub fn bearing(&self, u: f64, width: u32) -> f64 {
        (f64::from(width) / 2.0 - u).atan2(self.focal_length(width))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn red() -> Matcher {
        Colour { hue: 0.0, tolerance: 18.0, min_saturation: 0.5, min_value: 0.2 }.matcher()
    }

    #[test]
    fn lit_and_shaded_red_match_and_grey_does_not() {
        assert!(red().matches([210, 30, 30]) && red().matches([90, 14, 12]) && red().matches([200, 20, 60]));
        assert!(!red().matches([120, 120, 120]) && !red().matches([0, 0, 0]) && !red().matches([196, 190, 178]));
        assert!(!red().matches([70, 90, 150]) && !red().matches([200, 160, 30]));
    }

    #[test]
    fn the_middle_is_ahead_and_the_left_edge_is_half_the_field_of_view() {
        let camera = Camera { field_of_view: 1.2 };
        assert!(camera.bearing(160.0, 320).abs() < 1e-12);
        assert!((camera.bearing(0.0, 320) - 0.6).abs() < 1e-12);
    }
}
