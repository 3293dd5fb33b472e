//! A number that tells simulations apart.

use serde::{Deserialize, Serialize};

/// FNV-1a (64 bits) of the bits of all numbers that were added.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub struct Digest(u64);

const BASIS: u64 = 0xcbf2_9ce4_8422_2325;
const PRIME: u64 = 0x0000_0100_0000_01b3;

impl Default for Digest {
    /// Of no numbers.
    fn default() -> Self {
        Self(BASIS)
    }
}

impl Digest {
    /// Adds numbers, in this order.
    pub fn add(&mut self, values: &[f64]) {
        for byte in values.iter().flat_map(|v| v.to_bits().to_le_bytes()) {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(PRIME);
        }
    }
}

impl std::fmt::Display for Digest {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:016x}", self.0)
    }
}

impl From<Digest> for String {
    fn from(digest: Digest) -> Self {
        digest.to_string()
    }
}

impl TryFrom<String> for Digest {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        let digits = Some(&text).filter(|t| t.len() == 16 && t.bytes().all(|b| b.is_ascii_hexdigit()));
        let number = digits.and_then(|t| u64::from_str_radix(t, 16).ok());
        number.map(Self).ok_or_else(|| format!("\"{text}\" is no digest: 16 hexadecimal digits are"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_fnv_1a_of_the_bytes() {
        // the 64-bit FNV-1a of eight zero bytes
        let mut digest = Digest::default();
        digest.add(&[0.0]);
        let expected = (0..8).fold(BASIS, |hash: u64, _| hash.wrapping_mul(PRIME));
        assert_eq!(digest.to_string(), format!("{expected:016x}"));
        assert_eq!(Digest::try_from(digest.to_string()), Ok(digest));
    }

    #[test]
    fn a_bit_a_sign_and_the_order_count() {
        let of = |values: &[f64]| {
            let mut digest = Digest::default();
            digest.add(values);
            digest
        };
        assert_ne!(of(&[1.0]), of(&[1.0 + f64::EPSILON]));
        assert_ne!(of(&[0.0]), of(&[-0.0]));
        assert_ne!(of(&[1.0, 2.0]), of(&[2.0, 1.0]));
    }
}
