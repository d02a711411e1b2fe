// Threads of the program: workers that share its memory. They are there before it starts, as a thread that waits cannot make another.

/** Words of a thread's slot: its state, its argument, its number. */
const SLOT = 3;
const FREE = 0, TAKEN = 1, BEGUN = 2;
/** The highest number of a file that is open, and one. */
const OPEN = 64;

/** Memory that `count` threads share: slots, the number of threads, and the positions in files. */
export function shared(count) {
  const words = (length) => new Int32Array(new SharedArrayBuffer(4 * length));
  const files = { which: words(OPEN), at: new Float64Array(new SharedArrayBuffer(8 * OPEN)) };
  return { slots: words(SLOT * count), started: words(1), files };
}

/** The call by which the program starts a thread: its number, or -6 where none is free ("try again"). */
export function spawner({ slots, started }) {
  return (argument) => {
    for (let i = 0; i < slots.length; i += SLOT) {
      if (Atomics.compareExchange(slots, i, FREE, TAKEN) !== FREE) continue;
      slots[i + 1] = argument;
      slots[i + 2] = Atomics.add(started, 0, 1) + 1;
      Atomics.store(slots, i, BEGUN);
      Atomics.notify(slots, i);
      return slots[i + 2];
    }
    return -6;
  };
}

/** Is thread `which`: waits until it is started, `begin(number, argument)`, again and again. Never returns. */
export function serve({ slots }, which, begin) {
  const i = SLOT * which;
  for (;;) {
    for (let state = Atomics.load(slots, i); state !== BEGUN; state = Atomics.load(slots, i)) Atomics.wait(slots, i, state);
    begin(slots[i + 2], slots[i + 1]);
    Atomics.store(slots, i, FREE);
  }
}
