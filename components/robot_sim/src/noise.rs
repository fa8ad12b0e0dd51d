//! Seeded noise: the same seed gives the same run on every machine.
//!
//! Decision: splitmix64, ten lines, instead of the `rand` crate, whose streams may change with its versions; a
//! recorded run must replay years later.

/// One stream of pseudo-random numbers.
#[derive(Debug, Clone)]
pub struct Noise(u64);

impl Noise {
    /// The stream number `stream` of `seed`; streams of one seed are independent of each other.
    #[must_use]
    pub fn new(seed: u64, stream: u64) -> Self {
        let mut noise = Self(seed ^ stream.wrapping_mul(0xD1B5_4A32_D192_ED03));
        noise.bits();
        noise
    }

    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        mixed ^ (mixed >> 31)
    }

    /// Evenly spread from 0 to below 1.
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Bell-shaped around 0 with standard deviation 1 (Box-Muller).
    pub fn bell(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.unit()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.unit()).cos()
    }
}

#[cfg(test)]
mod tests {
    use super::Noise;

    #[test]
    fn bell_is_centred_with_unit_width() {
        let mut noise = Noise::new(1, 0);
        let samples: Vec<f64> = (0..20_000).map(|_| noise.bell()).collect();
        let mean = samples.iter().sum::<f64>() / 20_000.0;
        let variance = samples.iter().map(|sample| (sample - mean).powi(2)).sum::<f64>() / 20_000.0;
        assert!(mean.abs() < 0.03 && (variance - 1.0).abs() < 0.05, "mean {mean}, variance {variance}");
    }

    #[test]
    fn streams_of_one_seed_differ() {
        assert_ne!(Noise::new(7, 0).bits(), Noise::new(7, 1).bits());
    }
}
