//! Bakes of every family, many times by many threads: what waits for itself does so now and then.

use crate::common::families;

#[test]
fn bytes_do_not_depend_on_threads_and_no_bake_waits_for_itself() {
    families::bytes_do_not_depend_on_threads(20);
}
