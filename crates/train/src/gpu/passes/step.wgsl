// Everything of one step that is not the scene or the photo. The twin of `StepUniform` in uniform.rs.

struct Step {
    rotation: array<vec4<f32>, 3>, // columns, each with a component of the translation
    position: vec4<f32>,           // of the camera; depth of the near plane
    lens: vec4<f32>,               // focal lengths and principal point, px
    frame: vec4<u32>,              // width and height in px; tiles across and down
    limits: vec4<f32>,             // cutoff, its log2, alpha cap, smallest transmittance
    edges: vec4<f32>,              // fade_px, min_ratio, width of the coverage's ramp; is linear
    modes: vec4<u32>,              // window, order by pixel, geometry, numbers per slot
    background: vec4<f32>,         // as blended; -
    scene: vec4<u32>,              // triangles, coefficients stored, degree in use, pinned triangles
    anneal: vec4<f32>,             // opacity floor, opacity gain, sigma scale; rows hold opacity and sigma themselves
    rates: vec4<f32>,              // corners, opacity, sigma, SH degree 0; bias-corrected
    update: vec4<f32>,             // higher SH degrees, scale of second moments; is sparse, photo counts as first
    regularisers: vec4<f32>,       // weights of mean opacity and 1 / mean area, over triangles; -; -
    loss: vec4<f32>,               // scales of L1 and SSIM; beta of distortion and of normals, each over pixels
    depths: vec4<f32>,             // mapped depth m = a - b / z: a, b; -; -
    parts: vec4<u32>,              // frozen triangles; these are drawn without a window; triangles of a chunk; pairs of a part of the slots
}

const WINDOW_SOFT: u32 = 0u;
const WINDOW_COVERAGE: u32 = 1u;

// Numbers of a slot: gradients of a splat summed over the pixels of a tile. Written by splat_sums.wgsl.
const RGB: u32 = 0u;
const OPACITY: u32 = 3u;
const SIGMA: u32 = 4u;
const RATIO: u32 = 5u; // of edge i at 3 i, then that times p - origin
const PIXELS: u32 = 14u;
const ERROR: u32 = 15u;
const MAX_WEIGHT: u32 = 16u;
const SUM_WEIGHT: u32 = 17u;
const PLANE: u32 = 18u; // by 1/z, that times p - origin, by the normal

// Layout of a scene's rows: number j of triangle i of a chunk is at j * triangles of the chunk + i.
const ROW_OPACITY: u32 = 9u;
const ROW_SIGMA: u32 = 10u;
const ROW_SH: u32 = 11u;

// The triangles of a pass: those of one binding. The twin of `Chunk` in scene.rs.
struct Chunk {
    first: u32,
    count: u32,
    writes: u32, // 0 counts, 1 writes
}

// Parameters of one use of a pass. The twin of `Job` in job.rs.
struct Job {
    writes: u32,    // 0 counts, 1 writes
    length_at: u32, // where in `counts` the length is
    shift: u32,     // lowest bit of the digit
    identity: u32,  // values are indices
}

// Places in `counts`. The twin of `Count` in job.rs.
const TRIANGLES_1: u32 = 0u; // and one
const SPLATS: u32 = 1u;
const SPLATS_1: u32 = 2u;
const PAIRS: u32 = 3u;
const PIXELS_1: u32 = 4u;
const LAYERS: u32 = 5u;
const WANTED_SPLATS: u32 = 6u; // when more than there is room for
const WANTED_PAIRS: u32 = 7u;
const WANTED_LAYERS: u32 = 8u;
const TOUCHED: u32 = 9u;
const DROPPED: u32 = 10u;
const LOSS_L1: u32 = 11u; // sums, bits of f32
const LOSS_MSE: u32 = 12u;
const LOSS_SSIM: u32 = 13u;
const LOSS_GEOMETRY: u32 = 14u;
const SUM_AREA: u32 = 15u;
const PHOTO_TILES: u32 = 16u;
const SCENE_GROUPS: u32 = 17u;
const FRAME_GROUPS: u32 = 18u;

// The index of a workgroup of a dispatch that may have two dimensions.
fn workgroup_index(workgroup: vec3<u32>, count: vec3<u32>) -> u32 {
    return workgroup.x + workgroup.y * count.x;
}
