/** A scene: bytes, or a `Blob` or `File` of a browser, which is read from where it is; or several files by name. */
export type Source = Uint8Array | ArrayBuffer | Blob | Record<string, Uint8Array | ArrayBuffer | Blob>;

/** Options of the bake by the names of their fields; `trisplat schema bake` describes all of them. */
export interface BakeOptions {
  preset?: 'fast' | 'default' | 'small';
  /** Engine or viewer to write for. */
  target?: string;
  /** Most triangles of the file. */
  max_triangles?: number;
  /** Most bytes of all files together. */
  max_bytes?: number | null;
  /** Trains a soft scene solid first: takes minutes, comes closer. */
  harden?: boolean;
  /** Regions that are kept: "x0,y0,z0,x1,y1,z1" or "x,y,z,radius", in the coordinates of the file. */
  crop?: string[];
  /** Which axis of the file points up, if not the one that is found. */
  up?: string;
  [option: string]: unknown;
}

/** How far a bake is: the stage that runs, and the part of it that is done, 0 to 1. */
export interface Progress {
  stage?: string;
  fraction: number;
  finished?: Record<string, unknown>;
}

export interface How {
  /** Ends the job. */
  signal?: AbortSignal;
  /** How many; all cores in a page that is cross-origin isolated, else 1. */
  threads?: number;
  onProgress?: (progress: Progress) => void;
}

export interface BakeHow extends How {
  /** Name of the file to write; its ending says the format: .glb, .gltf, .obj, .ply or .html. "scene.glb" unless given. */
  output?: string;
  /** Names of the files that are baked, where several are given; those are merged. The first unless given. */
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

/** What a file holds (`trisplat schema info`). */
export function info(source: Source, how?: How): Promise<Record<string, unknown>>;
