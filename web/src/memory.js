// The program's memory: shared, so that it may have threads, or its own where a browser shares none.

const PAGES = 65536;
/** At least what the program begins with. */
const FIRST_PAGES = 256;
const HEADER = 8, IMPORTS = 2;
const FUNCTION = 0, TABLE = 1, MEMORY = 2;
const SHARED = 2;

/** True if this browser shares memory; some do in pages that are cross-origin isolated only. */
export function canShare() {
  try {
    return !!new WebAssembly.Memory({ initial: 1, maximum: 1, shared: true });
  } catch {
    return false;
  }
}

/** Memory for the program: as much as 4 GiB, less where the system refuses to promise that. */
export function memoryOfProgram(shared) {
  for (let maximum = PAGES; ; maximum /= 2) {
    try {
      return new WebAssembly.Memory({ initial: FIRST_PAGES, maximum, shared });
    } catch (error) {
      if (maximum <= 2 * FIRST_PAGES) throw error;
    }
  }
}

/** The same module for memory of its own: it then runs as one thread. */
export function unshared(bytes) {
  const module = new Uint8Array(bytes).slice();
  let at = HEADER;
  const number = () => {
    let value = 0;
    for (let shift = 0; ; shift += 7) {
      const byte = module[at++];
      value += (byte & 0x7f) * 2 ** shift;
      if (byte < 0x80) return value;
    }
  };
  const skip = (bytes) => (at += bytes);
  while (at < module.length) {
    const section = module[at++];
    const size = number();
    if (section !== IMPORTS) {
      skip(size);
      continue;
    }
    for (let left = number(); left > 0; left--) {
      for (const _name of ['module', 'field']) skip(number());
      const kind = module[at++];
      if (kind === MEMORY) {
        module[at] &= ~SHARED;
        return module;
      }
      if (kind === TABLE) skip(1);
      if (kind === FUNCTION) number();
      else if (module[at++] & 1) (number(), number());
      else number();
    }
  }
  throw new Error('the program imports no memory');
}
