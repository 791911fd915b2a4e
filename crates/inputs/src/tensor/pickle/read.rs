//! Interprets a pickle from start to end.

use super::storages::Storages;
use super::{convert, machine};
use crate::base::error::Result;
use crate::base::limits::Limits;
use crate::tensor::value::Value;

/// Interprets a pickle that starts at `base` in its file.
pub(in crate::tensor) fn read(
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
    use crate::model::grid::Element;
    use crate::tensor::zip::Data;

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

    /// A dictionary `{"a": 7, "b": VALUE}`, whose value some instructions make.
    fn beside(value: &[u8]) -> Result<Value> {
        let head = b"\x80\x04}(X\x01\x00\x00\x00aK\x07X\x01\x00\x00\x00b";
        run(&[head, value, b"u."].concat())
    }

    #[test]
    fn foreign_things_stay_closed_and_are_named_where_they_are_needed() {
        for (value, named) in [
            (&b"cos\nsystem\nX\x02\x00\x00\x00ls\x85R"[..], "os.system"),
            (b"\x8c\x02os\x8c\x06system\x93", "os.system"),
            // A Namespace: an object of a class, with a state.
            (b"cargparse\nNamespace\n)\x81}X\x01\x00\x00\x00cK\x01sb", "argparse.Namespace"),
            (b"cpathlib\nPosixPath\n)}\x92", "pathlib.PosixPath"),
            (b"(cm\nOld\nK\x01o}b", "m.Old"),
            // Functions that return functions, and lists and dictionaries of unknown classes.
            (b"cfunctools\npartial\n)R)R", "functools.partial"),
            (b"ccollections\ndeque\n)R(K\x01K\x02e", "collections.deque"),
            (b"cm\nMap\n)RK\x01K\x02s", "m.Map"),
        ] {
            let value = beside(value).expect(named);
            assert!(matches!(value.get("a"), Some(Value::Int(7))), "{named}");
            let closed = value.get("b").expect("there");
            assert!(closed.entries().is_empty() && closed.tensor().is_none(), "{named}");
            for error in [
                closed.number("b").expect_err(named),
                closed.boolean("b").expect_err(named),
                closed.vector3("b").expect_err(named),
            ] {
                assert!(matches!(error.kind(), ErrorKind::Unsupported { .. }), "{error}");
                assert!(error.to_string().contains(named), "{error}");
                assert_eq!(error.place(), &Place::Key("b".to_owned()));
            }
        }
        let error = run(b"\x80\x02\x82\x01.").expect_err("refused");
        assert!(error.to_string().contains("0x82"), "{error}");
    }

    #[test]
    fn values_that_are_no_classes_are_read() {
        for (value, wanted) in [
            // A set of protocol 4, a frozen one, and one of protocol 2.
            (&b"\x8f(K\x01K\x02\x90"[..], "[Int(1), Int(2)]"),
            (b"(K\x01K\x02\x91", "[Int(1), Int(2)]"),
            (b"c__builtin__\nset\n](K\x01K\x02e\x85R", "[Int(1), Int(2)]"),
            (
                b"ccollections\ndefaultdict\ncm\nf\n\x85RX\x01\x00\x00\x00kK\x01s",
                "[(\"k\", Int(1))]",
            ),
            (b"ccollections\nCounter\n}X\x01\x00\x00\x00kK\x01s\x85R", "[(\"k\", Int(1))]"),
            // 2^63 and 2^64 - 1, of torch.initial_seed(), and -2^64.
            (b"\x8a\x09\x00\x00\x00\x00\x00\x00\x00\x80\x00", "Float(9.223372036854776e18)"),
            (b"\x8a\x09\xff\xff\xff\xff\xff\xff\xff\xff\x00", "Float(1.8446744073709552e19)"),
            (b"\x8a\x09\x00\x00\x00\x00\x00\x00\x00\x00\xff", "Float(-1.8446744073709552e19)"),
            // Unsupported keys do not hide each other.
            (b"}(K\x01\x85K\x05K\x02\x85K\x06u", "key 0"),
        ] {
            let read = beside(value).expect(wanted);
            let shown = format!("{:?}", read.get("b").expect("there"));
            assert!(shown.contains(wanted), "{shown}");
        }
        let Some(Value::Dict(entries)) =
            beside(b"}(K\x01\x85K\x05K\x02\x85K\x06u").expect("read").get("b").cloned()
        else {
            panic!("a dictionary")
        };
        assert_eq!(entries.len(), 2);
    }

    #[test]
    fn arrays_of_other_types_keep_their_shape_and_are_refused_when_read() {
        let dtype = |code: &str, state: &[u8]| {
            let length = (code.len() as u32).to_le_bytes();
            [
                b"cnumpy\ndtype\n(X",
                &length[..],
                code.as_bytes(),
                b"K\x00K\x01tR(K\x03",
                state,
                b"tb",
            ]
            .concat()
        };
        let little = b"X\x01\x00\x00\x00<NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\x00";
        let big = b"X\x01\x00\x00\x00>NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\x00";
        let array = |dtype: &[u8], values: &[u8]| {
            let made = b"cnumpy._core.multiarray\n_reconstruct\n(cnumpy\nndarray\nK\x00\x85C\x01btR(K\x01K\x02\x85";
            [&made[..], dtype, b"\x89", values, b"tb"].concat()
        };
        for (array, named) in [
            (array(&dtype("u4", little), b"C\x08abcdefgh"), "type u4"),
            (array(&dtype("f4", big), b"C\x08abcdefgh"), "type >f4"),
            (array(&dtype("O8", little), b"]"), "Python objects"),
        ] {
            let read = beside(&array).expect(named);
            let tensor = read.get("b").and_then(Value::tensor).expect("an array");
            assert_eq!(tensor.shape(), [2]);
            let mut budget = crate::base::limits::Budget::new(&Limits::default());
            for error in [
                tensor.read_f32(&mut budget).expect_err(named),
                tensor.volume(&Limits::default()).expect_err(named),
                tensor.storage(&mut budget).expect_err(named),
            ] {
                assert!(matches!(error.kind(), ErrorKind::Unsupported { .. }), "{error}");
                assert!(error.to_string().contains(named), "{error}");
                assert_eq!(error.place(), &Place::Tensor("b".to_owned()));
            }
        }
        let seed = [
            b"cnumpy._core.multiarray\nscalar\n",
            &dtype("u8", little)[..],
            b"C\x08\xff\xff\xff\xff\xff\xff\xff\xff\x86R",
        ]
        .concat();
        let read = beside(&seed).expect("a number");
        assert_eq!(
            read.get("b").expect("there").number("b").expect("a number"),
            18446744073709551615.0
        );
    }

    #[test]
    fn instructions_that_are_unknown_are_named() {
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
