//! The results of a batch as JUnit XML, for CI systems.

use std::fmt::Write;

use super::manifest::SceneResult;
use crate::base::text::printable;
use crate::report_page::escaped;

/// A test suite with a case for each scene.
pub fn junit<'a>(results: impl Iterator<Item = &'a SceneResult> + Clone) -> String {
    let failed = results.clone().filter(|result| result.is_failed()).count();
    let seconds: f64 = results.clone().filter_map(|result| result.seconds).sum();
    // XML does not allow control characters.
    let escaped = |text: &str| escaped(&printable(text));
    let mut xml = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuites>\n<testsuite name=\"mipvog-bake\" \
         tests=\"{}\" failures=\"{failed}\" time=\"{seconds:.3}\">\n",
        results.clone().count()
    );
    for result in results {
        let (input, output) = (escaped(&result.input), escaped(&result.output));
        let seconds = result.seconds.unwrap_or(0.0);
        write!(xml, "<testcase classname=\"{input}\" name=\"{output}\" time=\"{seconds:.3}\"").ok();
        match &result.error {
            Some(error) => {
                let (error, code) = (escaped(error), result.exit_code);
                let failure = format!("<failure type=\"exit code {code}\" message=\"{error}\"/>");
                writeln!(xml, ">{failure}</testcase>").ok();
            }
            None => xml += "/>\n",
        }
    }
    xml + "</testsuite>\n</testsuites>\n"
}
