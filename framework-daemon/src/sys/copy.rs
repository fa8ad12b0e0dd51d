//! A copy with its checksum, in one pass over the memory: what is summed up is what was read, and the sums hide behind the
//! loads and stores.
//!
//! The sum is NH (Black, Halevi, Krawczyk, Krovetz, Rogaway: *UMAC: Fast and Secure Message Authentication*, CRYPTO '99,
//! section 4) over blocks of 1 KiB: each word of 64 bits adds `(low + key) * (high + key)`, halves of 32 bits each. Between blocks
//! the eight lanes are scrambled as in XXH3 (Collet, *xxHash*, `XXH3_scrambleAcc`), so that their order counts. By AVX2 that
//! is four instructions for 32 bytes; CRC-32C would take three times as long as the copy itself. It tells torn and damaged
//! copies, not forged ones: the key is no secret.
#![allow(unsafe_code, reason = "address of unsafe: copies from memory that a component spoke of")]

/// Parts of a copy begin at multiples of this.
pub const STRIPE: usize = 64;

const LANES: usize = 8;
/// Stripes in a block.
const STRIPES: usize = 16;
/// Primes of xxHash: of 32 bits, for the lanes, and of 64 bits, for the end.
const PRIME_32: u64 = 0x9E37_79B1;
const PRIME_64: u64 = 0x9FB2_1C65_1E98_DF25;

type Words = [u64; LANES];

static KEY: [Words; STRIPES + 1] = key();

/// SplitMix64 (Steele, Lea, Flood 2014) from a fixed seed.
const fn key() -> [Words; STRIPES + 1] {
    let (mut key, mut state, mut index) = ([[0; LANES]; STRIPES + 1], 0x0B5E_55ED_C0FF_EE00_u64, 0);
    while index < (STRIPES + 1) * LANES {
        state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut word = (state ^ (state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        word = (word ^ (word >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        key[index / LANES][index % LANES] = word ^ (word >> 31);
        index += 1;
    }
    key
}

/// A sum in the making.
#[derive(Clone, Copy, Debug)]
pub struct Sum {
    lanes: Words,
    /// Stripe of the block that comes next.
    stripe: usize,
    bytes: u64,
}

impl Default for Sum {
    fn default() -> Self {
        Self { lanes: KEY[STRIPES], stripe: 0, bytes: 0 }
    }
}

impl Sum {
    /// Of bytes that lie in the daemon's own memory.
    #[must_use]
    pub fn of(bytes: &[u8]) -> Self {
        let mut sum = Self::default();
        sum.add(bytes);
        sum
    }

    /// Adds bytes; as long as a stripe is, what follows begins a new one.
    pub fn add(&mut self, bytes: &[u8]) {
        // SAFETY: a slice is readable; nothing is written.
        unsafe { self.pass::<false>(bytes.as_ptr(), std::ptr::null_mut(), bytes.len()) };
    }

    /// Copies `len` bytes and adds them. What lies behind them up to the next multiple of [`STRIPE`] becomes zero.
    ///
    /// # Safety
    /// `to` must have room for `len` bytes rounded up to [`STRIPE`] and belong to nobody else. Where `from` is not readable
    /// this traps: the caller must be where that is contained.
    pub unsafe fn copy(&mut self, from: *const u8, to: *mut u8, len: usize) {
        // SAFETY: the caller's promise.
        unsafe { self.pass::<true>(from, to, len) };
    }

    /// The sum, of the bytes and of a number that goes with them. Never 0.
    #[must_use]
    pub fn finish(&self, number: u64) -> u64 {
        let mut sum = self.bytes.wrapping_mul(PRIME_64) ^ number;
        for lane in self.lanes {
            sum = (sum ^ lane).wrapping_mul(PRIME_64);
            sum ^= sum >> 32;
        }
        sum.max(1)
    }

    /// # Safety
    /// `from` must be readable; where `COPY`, `to` as in [`Self::copy`].
    unsafe fn pass<const COPY: bool>(&mut self, from: *const u8, to: *mut u8, len: usize) {
        let whole = len / STRIPE;
        // SAFETY: so many stripes lie within `len`.
        unsafe { self.stripes::<COPY>(from, to, whole) };
        let (done, rest) = (whole * STRIPE, len % STRIPE);
        if rest > 0 {
            let mut tail = [0; STRIPE];
            // SAFETY: the rest of `len`; the tail is one stripe, for which `to` has room.
            unsafe {
                std::ptr::copy_nonoverlapping(from.add(done), tail.as_mut_ptr(), rest);
                let to = if COPY { to.add(done) } else { to };
                self.stripes::<COPY>(tail.as_ptr(), to, 1);
            }
        }
        self.bytes += len as u64;
    }

    /// # Safety
    /// As [`Self::pass`], for that many stripes.
    unsafe fn stripes<const COPY: bool>(&mut self, from: *const u8, to: *mut u8, count: usize) {
        let mut done = 0;
        #[cfg(target_arch = "x86_64")]
        if self.stripe == 0 && count >= STRIPES && std::arch::is_x86_feature_detected!("avx2") {
            done = count / STRIPES * STRIPES;
            // SAFETY: the processor has it; the caller's promise.
            unsafe { avx2::blocks::<COPY>(&mut self.lanes, from, to, count / STRIPES) };
        }
        let (from, to) = (from.wrapping_add(done * STRIPE), to.wrapping_add(done * STRIPE));
        // SAFETY: what is left of the caller's.
        unsafe { self.stripes_by_word::<COPY>(from, to, count - done) };
    }

    /// # Safety
    /// As [`Self::stripes`].
    unsafe fn stripes_by_word<const COPY: bool>(&mut self, from: *const u8, to: *mut u8, count: usize) {
        for stripe in 0..count {
            // SAFETY: one of the stripes; read and written wherever it lies.
            let words = unsafe { from.add(stripe * STRIPE).cast::<Words>().read_unaligned() };
            if COPY {
                // SAFETY: as above.
                unsafe { to.add(stripe * STRIPE).cast::<Words>().write_unaligned(words) };
            }
            for ((lane, word), key) in self.lanes.iter_mut().zip(words).zip(KEY[self.stripe]) {
                *lane = lane.wrapping_add(product(word, key));
            }
            self.stripe += 1;
            if self.stripe == STRIPES {
                self.scramble();
            }
        }
    }

    fn scramble(&mut self) {
        self.stripe = 0;
        for (lane, key) in self.lanes.iter_mut().zip(KEY[STRIPES]) {
            *lane = (*lane ^ (*lane >> 47) ^ key).wrapping_mul(PRIME_32);
        }
    }
}

#[inline]
const fn product(word: u64, key: u64) -> u64 {
    let low = (word as u32).wrapping_add(key as u32);
    let high = ((word >> 32) as u32).wrapping_add((key >> 32) as u32);
    low as u64 * high as u64
}

/// The same for whole blocks, with 256 bits at a time.
#[cfg(target_arch = "x86_64")]
mod avx2 {
    use std::arch::x86_64::{
        __m256i, _mm256_add_epi32, _mm256_add_epi64, _mm256_loadu_si256, _mm256_mul_epu32, _mm256_set1_epi64x,
        _mm256_slli_epi64, _mm256_srli_epi64, _mm256_storeu_si256, _mm256_xor_si256,
    };

    use super::{KEY, PRIME_32, STRIPE, STRIPES, Words};

    /// # Safety
    /// As `Sum::stripes`, for that many blocks, on a processor with AVX2.
    #[target_feature(enable = "avx2")]
    pub(super) unsafe fn blocks<const COPY: bool>(lanes: &mut Words, from: *const u8, to: *mut u8, count: usize) {
        let (mut low, mut high) = load(lanes);
        for block in 0..count {
            for (stripe, key) in KEY[..STRIPES].iter().enumerate() {
                let at = (block * STRIPES + stripe) * STRIPE;
                let (from, to) = (from.wrapping_add(at).cast::<__m256i>(), to.wrapping_add(at).cast::<__m256i>());
                let (key_low, key_high) = load(key);
                // SAFETY: one of the stripes.
                unsafe {
                    let (first, second) = (_mm256_loadu_si256(from), _mm256_loadu_si256(from.add(1)));
                    if COPY {
                        _mm256_storeu_si256(to, first);
                        _mm256_storeu_si256(to.add(1), second);
                    }
                    low = add(low, first, key_low);
                    high = add(high, second, key_high);
                }
            }
            let (key_low, key_high) = load(&KEY[STRIPES]);
            (low, high) = (scramble(low, key_low), scramble(high, key_high));
        }
        let lanes = lanes.as_mut_ptr().cast::<__m256i>();
        // SAFETY: eight words are two vectors.
        unsafe {
            _mm256_storeu_si256(lanes, low);
            _mm256_storeu_si256(lanes.add(1), high);
        }
    }

    #[target_feature(enable = "avx2")]
    #[inline]
    fn load(words: &Words) -> (__m256i, __m256i) {
        let words = words.as_ptr().cast::<__m256i>();
        // SAFETY: eight words are two vectors.
        unsafe { (_mm256_loadu_si256(words), _mm256_loadu_si256(words.add(1))) }
    }

    #[target_feature(enable = "avx2")]
    #[inline]
    fn add(lanes: __m256i, words: __m256i, key: __m256i) -> __m256i {
        let halves = _mm256_add_epi32(words, key);
        _mm256_add_epi64(lanes, _mm256_mul_epu32(halves, _mm256_srli_epi64::<32>(halves)))
    }

    #[target_feature(enable = "avx2")]
    #[inline]
    fn scramble(lanes: __m256i, key: __m256i) -> __m256i {
        let prime = _mm256_set1_epi64x(PRIME_32.cast_signed());
        let mixed = _mm256_xor_si256(_mm256_xor_si256(lanes, _mm256_srli_epi64::<47>(lanes)), key);
        let high = _mm256_mul_epu32(_mm256_srli_epi64::<32>(mixed), prime);
        _mm256_add_epi64(_mm256_mul_epu32(mixed, prime), _mm256_slli_epi64::<32>(high))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn copied(from: &[u8]) -> (Vec<u8>, u64) {
        let mut to = vec![0xAA; from.len().next_multiple_of(STRIPE)];
        let mut sum = Sum::default();
        // SAFETY: both are there, and as long as they must be.
        unsafe { sum.copy(from.as_ptr(), to.as_mut_ptr(), from.len()) };
        to.truncate(from.len());
        (to, sum.finish(7))
    }

    fn by_word(bytes: &[u8]) -> u64 {
        let mut sum = Sum::default();
        let whole = bytes.len() / STRIPE * STRIPE;
        // SAFETY: a slice is readable.
        unsafe { sum.stripes_by_word::<false>(bytes.as_ptr(), std::ptr::null_mut(), whole / STRIPE) };
        let mut tail = [0; STRIPE];
        let rest = &bytes[whole..];
        tail[..rest.len()].copy_from_slice(rest);
        if !rest.is_empty() {
            // SAFETY: as above.
            unsafe { sum.stripes_by_word::<false>(tail.as_ptr(), std::ptr::null_mut(), 1) };
        }
        sum.bytes = bytes.len() as u64;
        sum.finish(7)
    }

    proptest! {
        #[test]
        fn a_copy_is_what_it_was_and_its_sum_that_of_its_bytes(bytes in prop::collection::vec(any::<u8>(), 0..5000)) {
            let (copy, sum) = copied(&bytes);
            prop_assert_eq!(&copy, &bytes);
            prop_assert_eq!(sum, Sum::of(&bytes).finish(7));
            prop_assert_eq!(sum, by_word(&bytes), "with vectors and without");
        }

        #[test]
        fn whatever_is_changed_is_seen(
            bytes in prop::collection::vec(any::<u8>(), 1..3000),
            changes in prop::collection::vec((any::<prop::sample::Index>(), 1..=255u8), 1..4),
        ) {
            let mut other = bytes.clone();
            changes.iter().for_each(|(index, by)| other[index.index(bytes.len())] ^= by);
            prop_assume!(other != bytes);
            prop_assert_ne!(Sum::of(&bytes).finish(7), Sum::of(&other).finish(7));
        }
    }

    #[test]
    fn signs_blocks_and_lengths_count() {
        let zeros = vec![0_u8; 8192];
        let sum = |bytes: &[u8]| Sum::of(bytes).finish(7);
        let with = |places: &[usize]| {
            let mut bytes = zeros.clone();
            places.iter().for_each(|place| bytes[*place] = 0x80);
            sum(&bytes)
        };
        let all =
            [sum(&zeros), sum(&zeros[1..]), with(&[7, 71]), with(&[7, 1031]), with(&[7, 2055]), with(&[1031, 2055])];
        let mut different = all.to_vec();
        different.sort_unstable();
        different.dedup();
        assert_eq!(different.len(), all.len());
        assert_ne!(sum(&zeros), Sum::of(&zeros).finish(8));
    }
}
