//! CRC-16/CCITT as the frames use it (polynomial 0x1021, start 0xFFFF, not reflected).

/// Check sum of `bytes`.
///
/// Bit by bit: a frame has at most 71 bytes and a table would cost a small board 512 bytes of flash.
#[must_use]
pub fn crc16(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xFFFF, |crc, byte| (0..8).fold(crc ^ (u16::from(*byte) << 8), |crc, _| shift(crc)))
}

fn shift(crc: u16) -> u16 {
    if crc & 0x8000 == 0 { crc << 1 } else { (crc << 1) ^ 0x1021 }
}

#[cfg(test)]
mod tests {
    #[test]
    fn agrees_with_the_published_check_value() {
        assert_eq!(super::crc16(b"123456789"), 0x29B1);
    }
}
