//! Interprets a pickle from start to end.

use super::storages::Storages;
use super::{convert, machine};
use crate::base::error::Result;
use crate::base::limits::Limits;
use crate::input::tensor::value::Value;

/// Interprets a pickle that starts at `base` in its file.
pub(in crate::input::tensor) fn read(
    bytes: &[u8],
    base: u64,
    storages: &dyn Storages,
    limits: &Limits,
) -> Result<Value> {
    let (arena, root) = machine::Machine::new(bytes, base, storages, limits).run()?;
    convert::tree(arena, root, base, limits)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::error::{Error, ErrorKind, Place};
    use crate::input::tensor::zip::Data;
    use crate::model::grid::Element;

    struct NoStorages;

    impl Storages for NoStorages {
        fn find(&self, key: &str, _: Option<Element>, _: u64) -> Result<Data> {
            Err(Error::usage(format!("storage {key}")))
        }
    }

    fn run(bytes: &[u8]) -> Result<Value> {
        let limits = Limits { pickle_objects: 10_000, ..Limits::default() };
        read(bytes, 1000, &NoStorages, &limits)
    }

    #[test]
    fn plain_values_come_out() {
        let value = run(b"\x80\x02}(X\x01\x00\x00\x00aK\x07X\x01\x00\x00\x00b](NI\x01e")
            .expect_err("INT is protocol 0");
        assert_eq!(value.place(), &Place::Offset(1021));
        let value =
            run(b"\x80\x02}(X\x01\x00\x00\x00aK\x07X\x01\x00\x00\x00b](N\x88\x8a\x01\xfeeu.")
                .expect("a dictionary");
        assert!(matches!(value.get("a"), Some(Value::Int(7))));
        let Some(Value::List(list)) = value.get("b") else { panic!("{value:?}") };
        assert!(matches!(list.as_slice(), [Value::None, Value::Bool(true), Value::Int(-2)]));
    }

    #[test]
    fn foreign_names_and_instructions_are_named() {
        let error = run(b"\x80\x02cos\nsystem\nX\x02\x00\x00\x00ls\x85R.").expect_err("refused");
        assert!(error.to_string().contains("os.system"), "{error}");
        assert_eq!(error.place(), &Place::Offset(1002));
        let error = run(b"\x80\x04\x8c\x02os\x8c\x06system\x93.").expect_err("refused");
        assert!(error.to_string().contains("os.system"), "{error}");
        let error = run(b"\x80\x02\x82\x01.").expect_err("refused");
        assert!(error.to_string().contains("0x82"), "{error}");
    }

    #[test]
    fn endless_values_end() {
        let error = run(b"\x80\x02]q\x00h\x00a.").expect_err("holds itself");
        assert!(matches!(error.kind(), ErrorKind::Malformed { .. }), "{error}");
        // Each list holds the one before ten times.
        let mut laughs = b"\x80\x02]q\x00".to_vec();
        for level in 0..20u8 {
            laughs.extend([b']', b'q', level + 1, b'(']);
            for _ in 0..10 {
                laughs.extend([b'h', level]);
            }
            laughs.push(b'e');
        }
        laughs.push(b'.');
        let error = run(&laughs).expect_err("ten to the twentieth");
        assert!(matches!(error.kind(), ErrorKind::OverLimit { .. }), "{error}");
        let mut deep = b"\x80\x02".to_vec();
        deep.extend([b']'; 5000]);
        deep.extend([b'a'; 4999]);
        deep.push(b'.');
        assert!(run(&deep).is_err());
    }

    #[test]
    fn every_prefix_and_flip_is_no_panic() {
        let whole =
            b"\x80\x02}q\x01(X\x01\x00\x00\x00acnumpy\ndtype\n(X\x02\x00\x00\x00f4K\x00K\x01tR\
            (K\x03X\x01\x00\x00\x00<NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\x00tb0u.";
        for end in 0..whole.len() {
            assert!(run(&whole[..end]).is_err(), "{end}");
        }
        for at in 0..whole.len() {
            for bit in 0..8 {
                let mut bytes = whole.to_vec();
                bytes[at] ^= 1 << bit;
                let _ = run(&bytes);
            }
        }
    }
}
