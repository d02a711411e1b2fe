/** A scene: bytes, or a `Blob` or `File` of a browser, which is read from where it is; or several files by name. */
export type Source = Uint8Array | ArrayBuffer | Blob | Record<string, Uint8Array | ArrayBuffer | Blob>;

/** Options of the bake by the names of their fields; `trisplat schema bake` describes all of them. */
export interface BakeOptions {
  preset?: 'fast' | 'default' | 'small';
  /** Engine or viewer to write for. */
  target?: string;
  /** Maximum number of triangles of the file. */
  max_triangles?: number;
  /** Maximum number of bytes of all files together. */
  max_bytes?: number | null;
  /** Trains a soft scene solid first: takes minutes, comes closer. */
  harden?: boolean;
  /** Regions that are kept: "x0,y0,z0,x1,y1,z1" or "x,y,z,radius", in the coordinates of the file. */
  crop?: string[];
  /** Up axis of the file; found by the program unless given. */
  up?: string;
  [option: string]: unknown;
}

/** Progress of a bake: the running stage, and the finished part of it, 0 to 1. */
export interface Progress {
  stage?: string;
  fraction: number;
  finished?: Record<string, unknown>;
}

export interface How {
  /** Ends the job. */
  signal?: AbortSignal;
  /** Number of threads; by default all cores in a page that is cross-origin isolated, else 1. */
  threads?: number;
  onProgress?: (progress: Progress) => void;
}

export interface BakeHow extends How {
  /** Name of the file to write; its ending says the format: .glb, .gltf, .obj, .ply or .html. "scene.glb" unless given. */
  output?: string;
  /** Names of the files to bake and merge; by default the first one. */
  inputs?: string[];
}

/** All files that were written, by name, and the report (`trisplat schema report`). */
export interface Baked {
  files: Record<string, Uint8Array>;
  report: Record<string, unknown>;
}

/** Bakes a scene; returns the bytes of the file. Fails with one message that names the place and the remedy. */
export function bake(source: Source, options?: BakeOptions, how?: BakeHow): Promise<Uint8Array>;

/** Bakes a scene; returns all files, as for .gltf with its .bin. */
export function bakeFiles(source: Source, options?: BakeOptions, how?: BakeHow): Promise<Baked>;

/** Describes a file (`trisplat schema info`). */
export function info(source: Source, how?: How): Promise<Record<string, unknown>>;
