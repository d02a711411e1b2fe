// The system under the program: the calls of WASI preview 1 that it makes, over files in memory.
import { FOLDER, Files, Written, plain } from './files.js';

const OK = 0, BADF = 8, EXIST = 20, INVAL = 28, ISDIR = 31, NOENT = 44, NOSYS = 52, NOTDIR = 54, NOTEMPTY = 55, SPIPE = 70;
const CHARACTERS = 2, DIRECTORY = 3, REGULAR = 4;
const CREATE = 1, MUST_BE_FOLDER = 2, MUST_BE_NEW = 4, TRUNCATE = 8;
const APPEND = 1;
/** The folder of all files, open from the start. */
const ROOT = 3;
const ALL_RIGHTS = 0xffffffffffffffffn;

/** The program has ended by itself. */
export class Exit extends Error {
  constructor(code) {
    super(`exit ${code}`);
    this.code = code;
  }
}

/** The system of one run. */
export class System {
  #memory;
  #files;
  #args;
  #line;
  #reads;
  #open = new Map([[ROOT, { path: '', what: FOLDER, at: 0 }]]);
  #texts = { 1: '', 2: '' };
  #decoder = new TextDecoder();
  #encoder = new TextEncoder();

  /**
   * `memory`: the program's; `files`: bytes or blobs by name; `args`: its arguments; `line(text, stream)`: called with each line that it
   * prints on stream 1 or 2; `more`: files of the first thread alone; `reads`: what all threads know of the files that are open.
   */
  constructor({ memory, files, more, args, line, reads = null }) {
    [this.#memory, this.#files, this.#args, this.#line, this.#reads] = [memory, new Files(files, more), args, line, reads];
  }

  /** The open file of this number: of this thread, or of the thread that opened it for all. */
  #opened(fd) {
    const own = this.#open.get(fd);
    const file = this.#files.given[(this.#reads?.which[fd] ?? 0) - 1];
    return own ?? (file && this.#shared({ what: file }, fd));
  }

  /** `opened`, whose place in the file all threads share. */
  #shared(opened, fd) {
    const { at } = this.#reads;
    return Object.defineProperty(opened, 'at', { get: () => at[fd], set: (place) => (at[fd] = place) });
  }

  /** Files that the program has written, by name. */
  written() {
    return this.#files.taken();
  }

  /** The module `wasi_snapshot_preview1`. */
  imports() {
    const calls = [
      'args_get', 'args_sizes_get', 'environ_get', 'environ_sizes_get', 'clock_time_get', 'random_get', 'sched_yield', 'proc_exit',
      'fd_close', 'fd_read', 'fd_write', 'fd_seek', 'fd_sync', 'fd_filestat_get', 'fd_fdstat_get', 'fd_prestat_get', 'fd_prestat_dir_name',
      'fd_readdir', 'path_open', 'path_filestat_get', 'path_rename', 'path_unlink_file', 'path_create_directory', 'path_remove_directory',
      'path_readlink',
    ];
    const bound = Object.fromEntries(calls.map((name) => [name, (...given) => this[name](...given)]));
    // Calls that the program does not make: links, times of files, sleep, sockets.
    return new Proxy(bound, { get: (known, name) => known[name] ?? (() => NOSYS) });
  }

  // Looked at anew for each call, as memory grows.
  get #view() {
    return new DataView(this.#memory.buffer);
  }

  #bytes(at, length) {
    return new Uint8Array(this.#memory.buffer, at >>> 0, length);
  }

  // A copy, as decoders take no shared memory.
  #text(at, length) {
    return this.#decoder.decode(this.#bytes(at, length).slice());
  }

  /** The path that a name in an open folder means; null where there is no such folder. */
  #path(fd, at, length) {
    const folder = this.#open.get(fd);
    if (folder?.what !== FOLDER) return null;
    return plain(this.#text(at, length), folder.path);
  }

  /** The vectors of a read or write, each as bytes of the memory. */
  #vectors(at, count) {
    const view = this.#view;
    return Array.from({ length: count }, (_, i) => this.#bytes(view.getUint32(at + 8 * i, true), view.getUint32(at + 8 * i + 4, true)));
  }

  #strings(list, pointers, at) {
    const view = this.#view;
    list.forEach((text, i) => {
      view.setUint32(pointers + 4 * i, at, true);
      const bytes = this.#encoder.encode(`${text}\0`);
      this.#bytes(at, bytes.length).set(bytes);
      at += bytes.length;
    });
    return OK;
  }

  #sizes(list, count, length) {
    this.#view.setUint32(count, list.length, true);
    this.#view.setUint32(length, list.reduce((sum, text) => sum + this.#encoder.encode(text).length + 1, 0), true);
    return OK;
  }

  args_get(pointers, at) {
    return this.#strings(this.#args, pointers, at);
  }

  args_sizes_get(count, length) {
    return this.#sizes(this.#args, count, length);
  }

  environ_get() {
    return OK;
  }

  environ_sizes_get(count, length) {
    return this.#sizes([], count, length);
  }

  clock_time_get(clock, _precision, at) {
    const ms = clock === 0 ? Date.now() : performance.now();
    this.#view.setBigUint64(at, BigInt(Math.round(ms * 1e6)), true);
    return OK;
  }

  random_get(at, length) {
    for (let done = 0; done < length; done += 65536) {
      const part = new Uint8Array(Math.min(65536, length - done));
      crypto.getRandomValues(part);
      this.#bytes(at + done, part.length).set(part);
    }
    return OK;
  }

  sched_yield() {
    return OK;
  }

  proc_exit(code) {
    throw new Exit(code);
  }

  fd_close(fd) {
    if (this.#reads) this.#reads.which[fd] = 0;
    return this.#open.delete(fd) ? OK : BADF;
  }

  fd_read(fd, vectors, count, told) {
    const file = this.#opened(fd);
    if (fd === 0) return this.#tell(told, 0);
    if (!file || file.what === FOLDER) return file ? ISDIR : BADF;
    const done = this.#readInto(file.what, file.at, vectors, count);
    file.at += done;
    return this.#tell(told, done);
  }

  #readInto(what, at, vectors, count) {
    let done = 0;
    for (const to of this.#vectors(vectors, count)) {
      const got = what.read(at + done, to);
      done += got;
      if (got < to.length) break;
    }
    return done;
  }

  #tell(at, count) {
    this.#view.setUint32(at, count, true);
    return OK;
  }

  fd_write(fd, vectors, count, told) {
    const parts = this.#vectors(vectors, count);
    const length = parts.reduce((sum, part) => sum + part.length, 0);
    if (fd === 1 || fd === 2) {
      for (const part of parts) this.#print(fd, this.#decoder.decode(part.slice()));
      return this.#tell(told, length);
    }
    const file = this.#open.get(fd);
    if (!(file?.what instanceof Written)) return BADF;
    if (file.append) file.at = file.what.size;
    for (const part of parts) {
      file.what.write(file.at, part);
      file.at += part.length;
    }
    return this.#tell(told, length);
  }

  #print(fd, text) {
    const lines = (this.#texts[fd] + text).split('\n');
    this.#texts[fd] = lines.pop();
    lines.forEach((line) => this.#line(line, fd));
  }

  fd_seek(fd, offset, whence, told) {
    const file = this.#opened(fd);
    if (fd < ROOT) return SPIPE;
    if (!file || file.what === FOLDER) return file ? ISDIR : BADF;
    const at = [0, file.at, file.what.size][whence] + Number(offset);
    if (!(at >= 0)) return INVAL;
    file.at = at;
    this.#view.setBigUint64(told, BigInt(at), true);
    return OK;
  }

  fd_sync() {
    return OK;
  }

  #stat(at, what) {
    const view = this.#view;
    this.#bytes(at, 64).fill(0);
    view.setUint8(at + 16, what === FOLDER ? DIRECTORY : what ? REGULAR : CHARACTERS);
    view.setBigUint64(at + 24, 1n, true);
    view.setBigUint64(at + 32, BigInt(what === FOLDER || !what ? 0 : what.size), true);
    return OK;
  }

  fd_filestat_get(fd, at) {
    if (fd < ROOT) return this.#stat(at, null);
    const file = this.#open.get(fd);
    return file ? this.#stat(at, file.what) : BADF;
  }

  fd_fdstat_get(fd, at) {
    const file = this.#open.get(fd);
    if (!file && fd >= ROOT) return BADF;
    const view = this.#view;
    this.#bytes(at, 24).fill(0);
    view.setUint8(at, !file ? CHARACTERS : file.what === FOLDER ? DIRECTORY : REGULAR);
    view.setUint16(at + 2, file?.append ? APPEND : 0, true);
    view.setBigUint64(at + 8, ALL_RIGHTS, true);
    view.setBigUint64(at + 16, ALL_RIGHTS, true);
    return OK;
  }

  fd_prestat_get(fd, at) {
    if (fd !== ROOT) return BADF;
    this.#view.setUint8(at, 0);
    this.#view.setUint32(at + 4, 1, true);
    return OK;
  }

  fd_prestat_dir_name(fd, at) {
    if (fd !== ROOT) return BADF;
    this.#bytes(at, 1).set([0x2f]);
    return OK;
  }

  fd_readdir(fd, at, length, cookie, told) {
    const folder = this.#open.get(fd);
    if (folder?.what !== FOLDER) return folder ? NOTDIR : BADF;
    const names = this.#files.list(folder.path);
    let used = 0;
    for (let i = Number(cookie); i < names.length && used < length; i++) {
      const name = this.#encoder.encode(names[i]);
      const entry = new Uint8Array(24 + name.length);
      const view = new DataView(entry.buffer);
      view.setBigUint64(0, BigInt(i + 1), true);
      view.setUint32(16, name.length, true);
      const what = this.#files.get(folder.path === '' ? names[i] : `${folder.path}/${names[i]}`);
      view.setUint8(20, what === FOLDER ? DIRECTORY : REGULAR);
      entry.set(name, 24);
      const part = entry.subarray(0, length - used);
      this.#bytes(at + used, part.length).set(part);
      used += part.length;
    }
    return this.#tell(told, used);
  }

  path_open(folder, _follow, name, length, how, _rights, _inherited, flags, told) {
    const path = this.#path(folder, name, length);
    if (path === null) return BADF;
    let what = this.#files.get(path);
    if (what && how & CREATE && how & MUST_BE_NEW) return EXIST;
    if (!what && !(how & CREATE)) return NOENT;
    if (what === FOLDER && how & (CREATE | TRUNCATE)) return ISDIR;
    if (what && what !== FOLDER && how & MUST_BE_FOLDER) return NOTDIR;
    if (!what || how & TRUNCATE) {
      if (this.#files.get(parent(path)) !== FOLDER) return NOENT;
      what = new Written();
      this.#files.set(path, what);
    }
    let fd = ROOT + 1;
    while (this.#open.has(fd)) fd++;
    const opened = { path, what, at: 0, append: !!(flags & APPEND) };
    const which = this.#files.given.indexOf(what) + 1;
    if (this.#reads) this.#reads.which[fd] = which;
    if (this.#reads && which > 0) {
      this.#reads.at[fd] = 0;
      delete opened.at;
      this.#shared(opened, fd);
    }
    this.#open.set(fd, opened);
    return this.#tell(told, fd);
  }

  path_filestat_get(folder, _follow, name, length, at) {
    const what = this.#files.get(this.#path(folder, name, length));
    return what ? this.#stat(at, what) : NOENT;
  }

  path_rename(folder, name, length, toFolder, toName, toLength) {
    const [from, to] = [this.#path(folder, name, length), this.#path(toFolder, toName, toLength)];
    if (!this.#files.get(from) || this.#files.get(parent(to)) !== FOLDER) return NOENT;
    this.#files.rename(from, to);
    return OK;
  }

  path_unlink_file(folder, name, length) {
    const path = this.#path(folder, name, length);
    const what = this.#files.get(path);
    if (!what || what === FOLDER) return what ? ISDIR : NOENT;
    this.#files.delete(path);
    return OK;
  }

  path_create_directory(folder, name, length) {
    const path = this.#path(folder, name, length);
    if (this.#files.get(path)) return EXIST;
    if (this.#files.get(parent(path)) !== FOLDER) return NOENT;
    this.#files.set(path, FOLDER);
    return OK;
  }

  path_remove_directory(folder, name, length) {
    const path = this.#path(folder, name, length);
    if (this.#files.get(path) !== FOLDER) return this.#files.get(path) ? NOTDIR : NOENT;
    if (this.#files.list(path).length > 0) return NOTEMPTY;
    this.#files.delete(path);
    return OK;
  }

  // There are no links.
  path_readlink(folder, name, length) {
    return this.#files.get(this.#path(folder, name, length)) ? INVAL : NOENT;
  }
}

function parent(path) {
  return path.slice(0, Math.max(0, path.lastIndexOf('/')));
}
