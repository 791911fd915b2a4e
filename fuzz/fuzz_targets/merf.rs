#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| mipvog_bake_fuzz::targets::merf(bytes));
