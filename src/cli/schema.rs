//! `trisplat schema NAME`: JSON Schemas, generated from the types they describe.

use crate::bake::options::BakeOptions;
use crate::bench::bake::BakeRow;
use crate::bench::evaluate::EvalReport;
use crate::dataset::Description;
use crate::error::{Error, Result};
use crate::formats::bvh::BvhHeader;
use crate::formats::check::Checked;
use crate::formats::info::Info;
use crate::report::Report;
use crate::train::options::TrainOptions;
use std::io::Write;

/// Which schema.
#[derive(Debug, clap::Args)]
pub struct SchemaArgs {
    /// What it describes.
    #[arg(value_enum)]
    pub name: SchemaName,
}

/// The schemas there are; each is checked in as `schemas/NAME.schema.json`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum SchemaName {
    /// The file given to `trisplat bake --config`.
    Bake,
    /// The file given to `trisplat train --config`.
    Train,
    /// The file written by `--report`.
    Report,
    /// What `trisplat info --json` prints of a file.
    Info,
    /// What `trisplat info --json` prints of a data set.
    Dataset,
    /// The file written by `trisplat eval --report`.
    Eval,
    /// What `trisplat validate --json` prints.
    Validate,
    /// The header of a BVH file.
    Bvh,
    /// The rows of `trisplat bench bake --json`.
    Bench,
    /// The rows of `trisplat bench fps --json`.
    #[cfg(feature = "gpu")]
    Fps,
}

impl SchemaName {
    /// The schema as pretty JSON with a final newline.
    pub fn text(self) -> String {
        let schema = match self {
            SchemaName::Bake => config_schema(schemars::schema_for!(BakeOptions)),
            SchemaName::Train => config_schema(schemars::schema_for!(TrainOptions)),
            SchemaName::Report => schemars::schema_for!(Report),
            SchemaName::Info => schemars::schema_for!(Info),
            SchemaName::Dataset => schemars::schema_for!(Description),
            SchemaName::Eval => schemars::schema_for!(EvalReport),
            SchemaName::Validate => schemars::schema_for!(Checked),
            SchemaName::Bvh => schemars::schema_for!(BvhHeader),
            SchemaName::Bench => schemars::schema_for!(Vec<BakeRow>),
            #[cfg(feature = "gpu")]
            SchemaName::Fps => schemars::schema_for!(Vec<crate::bench::fps::FpsRow>),
        };
        let mut text = serde_json::to_string_pretty(&schema).unwrap_or_default();
        text.push('\n');
        text
    }
}

/// Config files may name their schema, for editors.
fn config_schema(mut schema: schemars::Schema) -> schemars::Schema {
    if let Some(properties) = schema.get_mut("properties").and_then(|p| p.as_object_mut()) {
        properties.insert(
            "$schema".to_owned(),
            serde_json::json!({ "type": "string", "description": "Where this schema is; for editors." }),
        );
    }
    schema
}

/// Prints the schema to standard output.
pub fn run(args: &SchemaArgs) -> Result<()> {
    std::io::stdout().write_all(args.name.text().as_bytes()).map_err(|e| Error::io("-", e))
}
