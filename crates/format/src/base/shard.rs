//! A shard: one of several parts of a list that machines share.

use std::str::FromStr;

/// Part `number` of `of` parts: the items whose index modulo `of` is `number`. Sizes of parts
/// differ by at most one item.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shard {
    number: u64,
    of: u64,
}

impl Shard {
    /// True if the thing of this number, counted from 0, is in this part.
    pub fn has(self, number: u64) -> bool {
        number % self.of == self.number
    }
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let expected = "expected I/N, the part and the number of parts, such as 0/4";
        let (number, of) = text.split_once('/').ok_or(expected)?;
        let parse = |text: &str| text.parse().map_err(|_| expected.to_owned());
        let (number, of): (u64, u64) = (parse(number)?, parse(of)?);
        match number < of {
            true => Ok(Self { number, of }),
            false => Err(match of.checked_sub(1) {
                Some(last) => format!("parts are counted from 0: the last one is {last}/{of}"),
                None => expected.to_owned(),
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_thing_is_in_one_part() {
        let shards: Vec<Shard> = ["0/3", "1/3", "2/3"].iter().flat_map(|s| s.parse()).collect();
        for number in 0..20 {
            assert_eq!(shards.iter().filter(|shard| shard.has(number)).count(), 1);
        }
        for bad in ["", "1", "3/3", "0/0", "a/2", "1/b", "-1/2", "1/2/3"] {
            assert!(bad.parse::<Shard>().is_err(), "{bad}");
        }
    }
}
