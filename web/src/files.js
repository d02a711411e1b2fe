// Files in memory: what the program reads is given, what it writes is kept, and nothing touches a disk.

/** Bytes of a page of a file that is written, and of what is read of a `Blob` at a time. */
const PAGE = 1 << 20;
const READ_AHEAD = 4 << 20;

/** Bytes that are all there. */
class Bytes {
  #bytes;

  constructor(bytes) {
    this.#bytes = bytes;
  }

  get size() {
    return this.#bytes.length;
  }

  /** Copies what is at `at` into `to`; returns how much that was. */
  read(at, to) {
    const part = this.#bytes.subarray(at, at + to.length);
    to.set(part);
    return part.length;
  }
}

/** A `Blob` or `File` of a browser, read from where it is, piece by piece. Works in workers only. */
class Picked {
  #blob;
  #reader = new FileReaderSync();
  #piece = new Uint8Array(0);
  #from = 0;

  constructor(blob) {
    this.#blob = blob;
  }

  get size() {
    return this.#blob.size;
  }

  read(at, to) {
    if (at >= this.size) return 0;
    if (to.length >= READ_AHEAD) {
      const part = new Uint8Array(this.#reader.readAsArrayBuffer(this.#blob.slice(at, at + to.length)));
      to.set(part);
      return part.length;
    }
    if (at < this.#from || at >= this.#from + this.#piece.length) {
      this.#piece = new Uint8Array(this.#reader.readAsArrayBuffer(this.#blob.slice(at, at + READ_AHEAD)));
      this.#from = at;
    }
    const part = this.#piece.subarray(at - this.#from, at - this.#from + to.length);
    to.set(part);
    return part.length;
  }
}

/** A file that the program writes, in pages, so that it grows without being copied. */
export class Written {
  #pages = [];
  size = 0;

  read(at, to) {
    const length = Math.max(0, Math.min(to.length, this.size - at));
    this.#walk(at, length, (page, from, count, done) => to.set(page.subarray(from, from + count), done));
    return length;
  }

  write(at, bytes) {
    this.size = Math.max(this.size, at + bytes.length);
    while (this.#pages.length * PAGE < this.size) this.#pages.push(new Uint8Array(PAGE));
    this.#walk(at, bytes.length, (page, from, count, done) => page.set(bytes.subarray(done, done + count), from));
  }

  /** All bytes; gives its pages away. */
  take() {
    const bytes = new Uint8Array(this.size);
    for (let i = 0; i < this.#pages.length; i++) {
      const at = i * PAGE;
      bytes.set(this.#pages[i].subarray(0, Math.min(PAGE, this.size - at)), at);
      this.#pages[i] = null;
    }
    this.#pages = [];
    this.size = 0;
    return bytes;
  }

  #walk(at, length, visit) {
    for (let done = 0; done < length; ) {
      const from = (at + done) % PAGE;
      const count = Math.min(PAGE - from, length - done);
      visit(this.#pages[Math.floor((at + done) / PAGE)], from, count, done);
      done += count;
    }
  }
}

/** A path without a leading slash and without `.` and `..`, in a folder of such a path. */
export function plain(path, folder = '') {
  const parts = folder.split('/').filter(Boolean);
  for (const part of path.split('/')) {
    if (part === '..') parts.pop();
    else if (part !== '' && part !== '.') parts.push(part);
  }
  return parts.join('/');
}

/** Marks a folder. */
export const FOLDER = Symbol('folder');

/** Files by their whole paths, without a leading slash. */
export class Files {
  #at = new Map([['', FOLDER], ['tmp', FOLDER]]);
  /** Input files, in the same order for all threads of a job. */
  given;

  /** `given` and `more`: bytes, or blobs in a worker, by their names; `given` is the same for all threads of a job. */
  constructor(given, more = {}) {
    const readable = ([name, bytes]) => [name, ArrayBuffer.isView(bytes) ? new Bytes(bytes) : new Picked(bytes)];
    const all = Object.entries(given).map(readable);
    this.given = all.map(([, file]) => file);
    for (const [name, file] of [...all, ...Object.entries(more).map(readable)]) this.#at.set(plain(name), file);
  }

  get(path) {
    return this.#at.get(path);
  }

  set(path, what) {
    this.#at.set(path, what);
  }

  delete(path) {
    return this.#at.delete(path);
  }

  /** Moves a file, or a folder with all that is in it. */
  rename(from, to) {
    const moved = [...this.#at].filter(([path]) => path === from || path.startsWith(`${from}/`));
    for (const [path, what] of moved) {
      this.#at.delete(path);
      this.#at.set(to + path.slice(from.length), what);
    }
  }

  /** Names of what is in a folder. */
  list(folder) {
    const start = folder === '' ? '' : `${folder}/`;
    const inside = (path) => path !== folder && path.startsWith(start) && !path.slice(start.length).includes('/');
    return [...this.#at.keys()].filter(inside).map((path) => path.slice(start.length));
  }

  /** Files that the program has written, by path. */
  taken() {
    const written = [...this.#at].filter(([path, what]) => what instanceof Written && !path.startsWith('tmp/'));
    return Object.fromEntries(written.map(([path, file]) => [path, file.take()]));
  }
}
