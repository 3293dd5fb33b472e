//! A share of a sweep's files.

use std::str::FromStr;

use crate::scenario::error::Error;

/// Shard `index` of `count`, counted from 0 as array jobs of Slurm and Kubernetes are. It has every `count`-th file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    index: usize,
    count: usize,
}

impl Shard {
    /// The whole sweep.
    pub const ALL: Shard = Shard { index: 0, count: 1 };

    /// The shard's own among `files` files.
    pub fn files(self, files: usize) -> impl Iterator<Item = usize> {
        (self.index..files).step_by(self.count)
    }
}

impl FromStr for Shard {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        let numbers = text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
        match numbers {
            Some((index, count)) if index < count => Ok(Self { index, count }),
            _ => Err(Error::Option {
                option: "--shard",
                value: format!("{text:?}"),
                expected: "it must be I/N, shard I of N, with I from 0 to N - 1",
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_have_every_file_once() {
        for files in [0, 1, 5, 12] {
            for count in 1..8 {
                let mut all: Vec<usize> = (0..count).flat_map(|index| Shard { index, count }.files(files)).collect();
                all.sort_unstable();
                assert_eq!(all, (0..files).collect::<Vec<_>>());
            }
        }
    }

    #[test]
    fn only_i_of_n_below_n_is_a_shard() {
        assert_eq!("2/3".parse::<Shard>().unwrap(), Shard { index: 2, count: 3 });
        for text in ["3/3", "0/0", "1", "a/2", "-1/2", "1/2/3", ""] {
            assert!(text.parse::<Shard>().is_err(), "{text}");
        }
    }
}
