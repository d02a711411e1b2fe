//! What several tests share.
#![allow(dead_code)]

pub(crate) mod dual;
pub(crate) mod edits;
pub(crate) mod oracle;
pub(crate) mod png;
pub(crate) mod regressions;
