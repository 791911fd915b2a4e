//! Checks metadata rules; each violation becomes a finding.

use crate::base::error::{Error, Place, Result};
use crate::base::finding::{Code, Report, checked};

/// Checks metadata rules.
pub(super) struct Rules<'a, 'r> {
    /// False after a violation.
    pub(super) sound: bool,
    pub(super) report: &'a mut Report<'r>,
}

impl Rules<'_, '_> {
    /// Reports a value that breaks a rule.
    pub(super) fn require(
        &mut self,
        holds: bool,
        key: &str,
        found: impl std::fmt::Display,
        expected: &str,
    ) -> Result<()> {
        self.hold(key, |place| match holds {
            true => Ok(()),
            false => Err(Error::malformed(place.clone(), found.to_string(), expected)),
        })
    }

    /// Reports the error of a failed rule.
    pub(super) fn hold(
        &mut self,
        key: &str,
        rule: impl FnOnce(&Place) -> Result<()>,
    ) -> Result<()> {
        let checked = rule(&Place::Key(key.to_owned()));
        self.report(Code::MetadataValue, checked)
    }

    pub(super) fn report(&mut self, code: Code, rule: Result<()>) -> Result<()> {
        self.sound &= rule.is_ok();
        checked(rule, code, self.report).map(|_| ())
    }
}
