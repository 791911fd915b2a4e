//! Many mutants for each fuzz target; `fuzz/README.md` says how to run for hours.

mipvog_testing::tests_of_targets! { 10_000, 2 }
