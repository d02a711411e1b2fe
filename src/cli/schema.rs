//! `trisplat schema NAME`: JSON Schemas, generated from their types.

use super::files::Stdout;
use std::io::Write;
use trisplat_bake::{
    ArrangeDetails, BackdropDetails, BackgroundDetails, BakeOptions, ChunkDetails, ColorDetails, CropDetails,
    ExposureDetails, LitDetails, LodDetails, OrderDetails, PlaceDetails, PruneDetails, ReshapeDetails,
    SolidDetails, TeacherDetails, TextureDetails, TilesDetails, ViewpointDetails, WeldDetails,
    refit::RefitDetails, unseen::UnseenDetails,
};
use trisplat_dataset::Description;
use trisplat_dataset::capture::{
    FeaturesDetails, MatchesDetails, ModelDetails, PhotosDetails, VerdictDetails,
};
use trisplat_formats::{check::Checked, info::Info, output::WriteDetails};
use trisplat_job::EvalReport;
use trisplat_job::watched::TrialRun;
use trisplat_scale::Manifest;
use trisplat_scene::{
    Error, Result,
    report::{Report, stage_schema},
};
use trisplat_surface::{CollisionDetails, SurfaceDetails};
use trisplat_train::{TrainDetails, TrainOptions};

/// Which schema.
#[derive(Debug, clap::Args)]
pub struct SchemaArgs {
    /// What it describes.
    #[arg(value_enum)]
    pub name: SchemaName,
}

/// The schemas; each is checked in as `schemas/NAME.schema.json`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum SchemaName {
    /// The file given to `trisplat bake --config`.
    Bake,
    /// The file given to `trisplat train --config`.
    Train,
    /// The file written by `--report`.
    Report,
    /// The output of `trisplat info --json` for a file.
    Info,
    /// The output of `trisplat info --json` for a data set.
    Dataset,
    /// The file `manifest.json` written by `trisplat plan`.
    Plan,
    /// The file written by `trisplat eval --report`.
    Eval,
    /// What `trisplat validate --json` prints.
    Validate,
}

impl SchemaName {
    /// The schema as pretty JSON with a final newline.
    pub fn text(self) -> String {
        let schema = match self {
            SchemaName::Bake => config_schema(schemars::schema_for!(BakeOptions)),
            SchemaName::Train => config_schema(schemars::schema_for!(TrainOptions)),
            SchemaName::Report => report_schema(),
            SchemaName::Info => schemars::schema_for!(Info),
            SchemaName::Dataset => schemars::schema_for!(Description),
            SchemaName::Plan => schemars::schema_for!(Manifest),
            SchemaName::Eval => schemars::schema_for!(EvalReport),
            SchemaName::Validate => schemars::schema_for!(Checked),
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

/// A report with the details of each stage.
fn report_schema() -> schemars::Schema {
    let mut generator = schemars::generate::SchemaSettings::draft2020_12().into_generator();
    let g = &mut generator;
    let stages = vec![
        stage_schema::<PhotosDetails>(g),
        stage_schema::<FeaturesDetails>(g),
        stage_schema::<MatchesDetails>(g),
        stage_schema::<ModelDetails>(g),
        stage_schema::<VerdictDetails>(g),
        stage_schema::<BackgroundDetails>(g),
        stage_schema::<CropDetails>(g),
        stage_schema::<ArrangeDetails>(g),
        stage_schema::<TrialRun>(g),
        stage_schema::<TeacherDetails>(g),
        stage_schema::<CollisionDetails>(g),
        stage_schema::<SurfaceDetails>(g),
        stage_schema::<TilesDetails>(g),
        stage_schema::<PruneDetails>(g),
        stage_schema::<SolidDetails>(g),
        stage_schema::<ColorDetails>(g),
        stage_schema::<UnseenDetails>(g),
        stage_schema::<ExposureDetails>(g),
        stage_schema::<BackdropDetails>(g),
        stage_schema::<ReshapeDetails>(g),
        stage_schema::<RefitDetails>(g),
        stage_schema::<TextureDetails>(g),
        stage_schema::<LitDetails>(g),
        stage_schema::<WeldDetails>(g),
        stage_schema::<PlaceDetails>(g),
        stage_schema::<ViewpointDetails>(g),
        stage_schema::<ChunkDetails>(g),
        stage_schema::<OrderDetails>(g),
        stage_schema::<LodDetails>(g),
        stage_schema::<WriteDetails>(g),
        stage_schema::<TrainDetails>(g),
    ];
    let mut schema = generator.into_root_schema_for::<Report>();
    if let Some(stage) = schema.pointer_mut("/$defs/StageReport").and_then(|s| s.as_object_mut()) {
        stage.insert("oneOf".to_owned(), serde_json::json!(stages));
    }
    schema
}

/// Prints the schema to standard output.
pub fn run(args: &SchemaArgs) -> Result<()> {
    Stdout.write_all(args.name.text().as_bytes()).map_err(|e| Error::io("-", e))
}
